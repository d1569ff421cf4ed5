"""Planar random orientations about the normals of regions, or about the local normal of a tool."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.orientations.directions import planar_random
from ppmc.charge.orientations.frames import REGIONAL, Frames
from ppmc.compile_cache import njit
from ppmc.errors import SceneError
from ppmc.geometry.points import as_points
from ppmc.geometry.tools.distance import no_offsets, tool_distance
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.charge import RegionalOrientation
from ppmc.scene.sections.tooling import Tool

Array = NDArray[np.floating]
# Maps points, shape (n, 3), to distances, shape (n,), and unit normals, shape (n, 3), of one tool.
Distance = Callable[[Array], tuple[Array, Array]]


@njit
def _distances(tools, offsets, points):  # type: ignore[no-untyped-def]
    """Return distances and normals of the one tool; on one thread, for forming makes many small calls."""
    phi, normals = np.empty(len(points)), np.empty_like(points)
    for k in range(len(points)):
        phi[k], normals[k, 0], normals[k, 1], normals[k, 2] = tool_distance(
            tools, 0, offsets, points[k, 0], points[k, 1], points[k, 2]
        )
    return phi, normals


def distance_of(name: str, tooling: Mapping[str, Tool] | None, folder: Path, key: str) -> Distance:
    """Return the signed distance of one tool at its drawn position.

    Raises
    ------
    SceneError
        If the scene has no such tool; `key` names the place that asks for it.
    """
    if not tooling or name not in tooling:
        known = ", ".join(tooling) if tooling else "none"
        raise SceneError(f"{key}: no tool '{name}' in the scene's tooling (it has {known})")
    arrays = compile_tools({name: tooling[name]}, folder).arrays
    offsets = no_offsets(arrays)

    def distance(points: Array) -> tuple[Array, Array]:
        phi, normals = _distances(arrays, offsets, as_points(points))
        return phi, normals

    return distance


def regional_frames(section: RegionalOrientation, positions: Array, generator: np.random.Generator) -> Frames:
    """Return frames about the normals of regions, one random direction a particle (D, section on model creation).

    Parameters
    ----------
    section : RegionalOrientation
        Boxes and their normals.
    positions : ndarray, shape (n, 3)
        Particles, mm.
    generator : numpy.random.Generator
        Source of the angles.
    """
    regions = list(section.regions.values())
    away = np.empty((len(regions), len(positions)))
    for k, region in enumerate(regions):
        beyond = np.maximum(np.maximum(np.array(region.min) - positions, positions - np.array(region.max)), 0.0)
        away[k] = np.linalg.norm(beyond, axis=1)
    chosen = away.argmin(axis=0)
    r = np.array([region.normal for region in regions])[chosen]
    frames = Frames.of(planar_random(r, generator), r, REGIONAL)
    frames.notes.update(
        regions=list(section.regions),
        particles_per_region=np.bincount(chosen, minlength=len(regions)).tolist(),
        share_outside_all_regions=float(np.mean(away.min(axis=0) > 0)),
    )
    return replace(frames, region_id=chosen.astype(np.int32))


def local_frames(distance: Distance, positions: Array, generator: np.random.Generator) -> Frames:
    """Return frames about a tool's local normal at every particle: what D names as the next step."""
    _, r = distance(positions)
    return Frames.of(planar_random(r, generator), r, REGIONAL)
