"""Frames from a file of oriented points: each particle takes the nearest point's, whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.orientations.frames import GIVEN, Frames
from ppmc.errors import SceneError
from ppmc.particles import Particles
from ppmc.scene.sections.charge import FileOrientation

Array = NDArray[np.floating]


def imported_frames(section: FileOrientation, points: Particles, positions: Array) -> Frames:
    """Return the frames of the nearest points.

    Parameters
    ----------
    section : FileOrientation
        With the search radius.
    points : Particles
        Orientations, in the coordinates of the tool.
    positions : ndarray, shape (n, 3)
        Particles, mm.

    Raises
    ------
    SceneError
        If particles have no point within the search radius; with the share that has.
    """
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(points.positions).query(positions)
    if section.search_radius is not None and (far := distance > section.search_radius).any():
        raise SceneError(
            f"charge.orientation: only {1 - far.mean():.2%} of the {len(far):,} particles have a point of "
            f"{section.file} within {section.search_radius:g} mm (the farthest is {distance.max():.4g} mm away); "
            "check charge.domain, or raise search_radius"
        )
    frames = Frames.of(points.p[nearest], points.r[nearest], GIVEN)
    frames.notes.update(points_in_file=len(points.positions), largest_distance_mm=float(distance.max()))
    if points.platelet_id is not None:
        frames = replace(frames, platelet_id=points.platelet_id[nearest])
    return frames
