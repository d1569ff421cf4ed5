"""From the scene's words to regions and paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.averages.averages import RegionAverages
from ppmc.analysis.averages.local import localise, material_normals, nearest_normals, turned_to
from ppmc.analysis.averages.paths import AXIS_NAMES, InspectionPath, circle_path, line_path, straight_path, swept_path
from ppmc.analysis.averages.regions import Region, box, cylinder, everything, frame_about, sphere
from ppmc.analysis.averages.sources import Source

if TYPE_CHECKING:
    from ppmc.scene import Scene
    from ppmc.scene.sections.analysis import (
        AnalysisSection,
        CirclePath,
        LinePath,
        RegionSection,
        StraightPath,
        SweptPath,
    )


def build_region(name: str, section: RegionSection) -> Region:
    """Return the region that a scene describes."""
    if section.shape == "slab":
        far = np.array([np.inf, np.inf, section.max])
        return box(name, [-np.inf, -np.inf, section.min], far, axes=frame_about(section.normal))
    if section.shape == "cylinder":
        return cylinder(
            name, section.centre, section.axis, section.height, section.radius, section.inner_radius,
            np.radians(section.start_angle), np.radians(section.end_angle), section.reference,
        )  # fmt: skip
    if section.shape == "sphere":
        return sphere(name, section.centre, section.radius)
    if section.min is not None and section.max is not None:
        return box(name, section.min, section.max)
    half = 0.5 * np.array(section.size)
    third = frame_about(np.cross(section.axis_1, section.axis_2), section.axis_1)
    return box(name, -half, half, axes=third, origin=section.centre)


def build_regions(section: AnalysisSection) -> tuple[Region, ...]:
    """Return the scene's regions after the whole file."""
    return (everything(), *(build_region(name, s) for name, s in section.regions.items()))


def build_path(
    name: str, section: StraightPath | CirclePath | SweptPath | LinePath, sources: Sequence[Source]
) -> InspectionPath:
    """Return the path that a scene describes; open ends reach as far as the material of any source."""
    low, high = extent(sources)
    if section.kind == "straight":
        axis = AXIS_NAMES.index(section.axis)
        lower, upper = np.full(3, -np.inf), np.full(3, np.inf)
        lower[axis], upper[axis] = low[axis], high[axis]
        lower = lower if section.min is None else np.array(section.min)
        upper = upper if section.max is None else np.array(section.max)
        return straight_path(name, axis, section.slices, lower, upper)
    if section.kind == "circle":
        width = 360.0 / section.points if section.width is None else section.width
        return circle_path(
            name,
            section.centre,
            section.axis,
            section.zero,
            section.inner_radius,
            section.outer_radius,
            section.height,
            section.points,
            width,
        )
    if section.kind == "swept":
        sweep = AXIS_NAMES.index(section.sweep)
        start = low[sweep] if section.start is None else section.start
        stop = high[sweep] if section.stop is None else section.stop
        along = AXIS_NAMES.index(section.along)
        return swept_path(
            name, along, sweep, section.length, section.width, section.centre, start, stop, section.points
        )
    return line_path(name, section.points, section.radius, section.steps, section.up)


def tool_normals(scene: Scene, points: np.ndarray, time: float) -> np.ndarray | None:
    """Return the normal of the nearest tool at each point, shape (n, 3); None if the scene has no tools.

    Parameters
    ----------
    scene : Scene
        Its section ``tooling`` names the tools.
    points : ndarray, shape (n, 3)
        mm; NaN rows give NaN normals.
    time : float
        s; tools stand where they are then.
    """
    if not scene.tooling:
        return None
    from ppmc.geometry.tools.toolset import compile_tools

    out = np.full(points.shape, np.nan)
    known = np.isfinite(points).all(axis=1)
    if known.any():
        out[known] = nearest_normals(*compile_tools(scene.tooling, scene.directory).distances(points[known], time))
    return out


def local_path(
    scene: Scene, path: InspectionPath, section: SweptPath, averages: RegionAverages, time: float
) -> InspectionPath:
    """Return a swept path in local axes, with the normal of the tool nearest to the material of each region (D6).

    Parameters
    ----------
    scene : Scene
        Its tools give the normals; without tools the platelets' own mean normals stand in.
    path : InspectionPath
    section : SweptPath
        What the path was made from.
    averages : RegionAverages
        Of the material, over the path's regions, in tool coordinates.
    time : float
        s; tools stand where they are then.
    """
    along, sweep = AXIS_NAMES.index(section.along), AXIS_NAMES.index(section.sweep)
    normals, origin = tool_normals(scene, averages.centroid, time), "the nearest tool"
    if normals is None:
        normals, origin = material_normals(averages.normal_tensor), "the platelets, as no tool is known"
    axes = np.eye(3)
    return localise(path, turned_to(normals, axes[3 - along - sweep]), axes[along], origin)


def extent(sources: Sequence[Source]) -> tuple[np.ndarray, np.ndarray]:
    """Return the bounds (mm) of the material of all sources; NaN if there is none."""
    known = [s for s in sources if s.count]
    if not known:
        return np.full(3, np.nan), np.full(3, np.nan)
    return np.min([s.lower for s in known], axis=0), np.max([s.upper for s in known], axis=0)
