"""Orientations at points, as every exchange format gives them, and the checks they all pass."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.orientation import in_plane_from_normal, normalise

Array = NDArray[np.floating]
# Directions from text files carry few digits; a length off by more than this is no rounding.
LENGTH_TOLERANCE = 1e-2
ANGLE_TOLERANCE = 1e-2
FARTHEST = 1e9  # mm


@dataclass(frozen=True)
class OrientedPoints:
    """Points with platelet frames.

    Attributes
    ----------
    positions, fibre_direction, platelet_normal : ndarray, shape (n, 3)
        Position in mm, p and r.
    volume : ndarray, shape (n,), or None
        Volumes, mm^3.
    platelet_id : ndarray, shape (n,), or None
        Platelets, -1 for none.
    """

    positions: Array
    fibre_direction: Array
    platelet_normal: Array
    volume: Array | None = None
    platelet_id: NDArray[np.int64] | None = None

    @property
    def in_plane_direction(self) -> Array:
        """Q = r x p, shape (n, 3)."""
        return in_plane_from_normal(self.fibre_direction, self.platelet_normal)


def checked(points: OrientedPoints, path: Path) -> OrientedPoints:
    """Return points whose directions are of unit length and perpendicular to double precision.

    Raises
    ------
    InputFileError
        If there are no points, a number is not finite, or directions are neither of unit length nor perpendicular
        within one per cent; with the first point at fault.
    """
    n = len(points.positions)
    if n == 0:
        raise InputFileError(f"{path}: holds no point")
    for name, values in (("position", points.positions), ("p", points.fibre_direction), ("r", points.platelet_normal)):
        if values.shape != (n, 3):
            raise InputFileError(f"{path}: {name} has shape {values.shape}, must be ({n}, 3)")
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise InputFileError(f"{path}: {name} of point {bad[0] + 1} is not finite: {values[bad[0]].tolist()}")
    bad = np.flatnonzero((np.abs(points.positions) > FARTHEST).any(axis=1))
    if len(bad):
        where = points.positions[bad[0]].tolist()
        raise InputFileError(f"{path}: position of point {bad[0] + 1} is {where} mm: beyond any part; correct the unit")
    for name, values in (("p", points.fibre_direction), ("r", points.platelet_normal)):
        size = np.linalg.norm(values, axis=1)
        bad = np.flatnonzero(np.abs(size - 1.0) > LENGTH_TOLERANCE)
        if len(bad):
            raise InputFileError(
                f"{path}: {name} of point {bad[0] + 1} has length {size[bad[0]]:.4g}, must be 1 "
                f"({len(bad):,} points of {n:,})"
            )
    p, r = normalise(points.fibre_direction), normalise(points.platelet_normal)
    along = np.abs(np.sum(p * r, axis=1))
    bad = np.flatnonzero(along > ANGLE_TOLERANCE)
    if len(bad):
        raise InputFileError(
            f"{path}: p and r of point {bad[0] + 1} are not perpendicular (p.r = {along[bad[0]]:.3g}; "
            f"{len(bad):,} points of {n:,})"
        )
    r = normalise(r - np.sum(r * p, axis=1, keepdims=True) * p)
    return OrientedPoints(points.positions, p, r, points.volume, points.platelet_id)
