"""What `ppmc check` says about a scene's analysis: regions and paths that will meet no material, meshes, rendering."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.averages.build import build_path, build_regions
from ppmc.analysis.averages.regions import Region
from ppmc.analysis.averages.sources import Source
from ppmc.analysis.figures.rendering import probe
from ppmc.analysis.flow.comparisons import read_picture
from ppmc.analysis.mesh.mesh import read_mesh
from ppmc.errors import InputFileError
from ppmc.geometry.charge_bounds import charge_bounds
from ppmc.geometry.tools.toolset import compile_tools

if TYPE_CHECKING:
    from ppmc.scene import Scene


def findings(scene: Scene) -> list[str]:
    """Return lines on the section ``analysis``; meshes and surfaces are read, nothing is written.

    Raises
    ------
    InputFileError
        If the scene names a mesh, a mask or a charge's surface that cannot be read.
    SceneError
        If a path contradicts itself, or a draped charge misses its tool.
    """
    section = scene.analysis
    if section is None:
        return []
    lines = []
    bounds = _charge_bounds(scene)
    regions = build_regions(section)[1:]
    told = f"{len(regions)} regions, {len(section.every_path)} paths"
    if bounds is None:
        lines.append(told)
    else:
        stand_in = _stand_in(bounds)
        count = sum(len(build_path(name, spec, [stand_in])) for name, spec in section.every_path.items())
        lines.append(f"{told} with {count} inspection regions")
        away = [region.name for region in regions if not _meets(region, *bounds)]
        if away:
            lines.append(f"at the start no material is in region {', '.join(away)}: fine if the flow gets there")
    if section.mesh is not None:
        mesh = read_mesh(scene.locate(section.mesh.path), section.mesh.scale)
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        size = " x ".join(f"{v:.4g}" for v in high - low)
        lines.append(f"mesh {mesh.path.name}: {len(mesh.centres):,} elements, {size} mm")
    mask = section.front.mask
    if mask is not None:
        path = scene.locate(mask.path)
        if path.suffix != ".vtkhdf":
            marked = read_picture(path, mask.material)
            wide, tall = (n * mask.pixel for n in marked.shape)
            area = f"{marked.mean():.0%} of it material"
            lines.append(f"mask {path.name}: {wide:.4g} x {tall:.4g} mm seen along {section.front.axis}, {area}")
        elif not path.exists():
            raise InputFileError(f"{path}: no such file; analysis.front.mask names it")
    if section.views or section.animation:
        status = probe()
        lines.append(
            "three-dimensional views: VTK draws"
            if status.available
            else f"views fall back to matplotlib: {status.reason}"
        )
    return lines


def _charge_bounds(scene: Scene) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the bounds of the charge; None where the scene does not describe one."""
    if scene.charge is None:
        return None
    tools = compile_tools(scene.tooling, scene.directory) if scene.tooling else None
    return charge_bounds(scene.charge.domain, tools, scene.directory)


def _stand_in(bounds: tuple[np.ndarray, np.ndarray]) -> Source:
    """Return a source without points that has the charge's extent, to lay open-ended paths through."""
    low, high = bounds
    return Source("charge", "charge", None, 1, low, high, 1.0, lambda: iter(()))


def _meets(region: Region, low: np.ndarray, high: np.ndarray) -> bool:
    """Tell whether a region's enclosing box meets another box."""
    a, b = region.bounds()
    return bool((a < high).all() and (b > low).all())
