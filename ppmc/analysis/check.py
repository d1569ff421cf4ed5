"""What `ppmc check` says about a scene's analysis: regions and paths that will meet no material, meshes, rendering."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.build import build_path, build_regions
from ppmc.analysis.comparisons import read_picture
from ppmc.analysis.mesh import read_mesh
from ppmc.analysis.regions import Region
from ppmc.analysis.rendering import probe
from ppmc.analysis.sources import Source
from ppmc.errors import InputFileError

if TYPE_CHECKING:
    from ppmc.scene import Scene


def findings(scene: Scene) -> list[str]:
    """Return lines on the section ``analysis``; nothing is read but the mesh, nothing is written.

    Raises
    ------
    InputFileError
        If the scene names a mesh or a mask that cannot be read.
    SceneError
        If a path contradicts itself.
    """
    section = scene.analysis
    if section is None:
        return []
    lines = []
    bounds = _charge_bounds(scene)
    regions = build_regions(section)[1:]
    stand_in = _stand_in(bounds)
    paths = [build_path(name, spec, [stand_in]) for name, spec in section.every_path.items()] if bounds else []
    count = sum(len(path) for path in paths)
    lines.append(f"{len(regions)} regions, {len(section.every_path)} paths with {count} inspection regions")
    if bounds is not None:
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
    """Return the bounds of a box-shaped charge; None where the charge is of another shape or not described."""
    domain = getattr(scene.charge, "domain", None)
    size = getattr(domain, "size", None)
    if size is None:
        return None
    low = np.array(getattr(domain, "origin", (0.0, 0.0, 0.0)), dtype=float)
    return low, low + np.array(size, dtype=float)


def _stand_in(bounds: tuple[np.ndarray, np.ndarray] | None) -> Source:
    """Return a source without points that has the charge's extent, to lay open-ended paths through."""
    low, high = bounds or (np.zeros(3), np.ones(3))
    return Source("charge", "charge", None, 1, low, high, 1.0, lambda: iter(()))


def _meets(region: Region, low: np.ndarray, high: np.ndarray) -> bool:
    """Tell whether a region's enclosing box meets another box."""
    a, b = region.bounds()
    return bool((a < high).all() and (b > low).all())
