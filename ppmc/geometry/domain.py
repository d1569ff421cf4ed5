"""Closed domains that a charge may fill: the tool shapes taken as solids, and triangle surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.errors import SceneError
from ppmc.geometry.points import as_points
from ppmc.geometry.surfaces.surface import ClosedSurface, read_surface
from ppmc.geometry.tools.distance import no_offsets, signed_distances
from ppmc.geometry.tools.outline import outline_integrals
from ppmc.geometry.tools.packed import ToolArrays
from ppmc.geometry.tools.toolset import compile_tools, rotation_matrix
from ppmc.scene.sections.tooling import (
    BoxTool,
    CylinderTool,
    ExtrusionTool,
    MeshTool,
    RevolutionTool,
    RoundedBoxTool,
    SolidTool,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Domain:
    """A closed region of space.

    Attributes
    ----------
    volume : float
        Exact volume, mm^3 (closed form for primitives, of its triangles for a mesh).
    bounds : tuple of two ndarrays of shape (3,)
        Box around it, mm: lower and upper corner.
    name : str
        What to call it in messages.
    shape : ToolArrays or None
        The primitive as one tool.
    surface : ClosedSurface or None
        The mesh, in its final place.
    """

    volume: float
    bounds: tuple[FloatArray, FloatArray]
    name: str = "domain"
    shape: ToolArrays | None = None
    surface: ClosedSurface | None = None

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return for each point, shape (n, 3), whether it lies inside."""
        if self.surface is not None:
            return self.surface.contains(points)
        assert self.shape is not None
        phi, _ = signed_distances(self.shape, no_offsets(self.shape), as_points(points))
        return np.asarray(phi[0] < 0.0)


def closed_domain(shape: SolidTool, directory: Path | None = None, name: str = "charge.domain") -> Domain:
    """Return the region inside a solid shape.

    Parameters
    ----------
    shape : BoxTool, RoundedBoxTool, CylinderTool, ExtrusionTool, RevolutionTool or MeshTool
        The shape as the scene describes it; motion, wall and `inside` do not matter.
    directory : Path, optional
        Folder to which a mesh file is relative.
    name : str
        Key of the scene, for messages.

    Raises
    ------
    SceneError
        If the shape has no ends (a cylinder or extrusion without `length`), or its outline is faulty.
    InputFileError
        If a mesh file is missing, damaged or not a closed surface.
    """
    if isinstance(shape, MeshTool):
        surface = placed_surface(shape, directory)
        return Domain(surface.volume, surface.bounds, name, surface=surface)
    if isinstance(shape, CylinderTool | ExtrusionTool) and shape.length is None:
        raise SceneError(f"{name}: a {shape.shape} that is to be filled needs a `length`")
    arrays = compile_tools({name: shape.model_copy(update={"inside": False})}).arrays
    corners = np.array(np.meshgrid(*arrays.box[0].T, indexing="ij")).reshape(3, -1).T
    corners = corners @ arrays.frame[0] + arrays.origin[0]
    return Domain(_volume(shape, arrays), (corners.min(axis=0), corners.max(axis=0)), name, shape=arrays)


def placed_surface(shape: MeshTool, directory: Path | None = None) -> ClosedSurface:
    """Return the surface of a mesh shape in its drawn place."""
    path = shape.file if shape.file.is_absolute() else (directory or Path()) / shape.file
    surface = read_surface(path, unit=shape.unit, scale=shape.scale)
    moved = surface.points @ rotation_matrix(shape.rotation).T + np.array(shape.origin)
    return ClosedSurface(moved, surface.triangles, surface.name)


def _volume(shape: SolidTool, arrays: ToolArrays) -> float:
    """Return the exact volume of a primitive, mm^3."""
    if isinstance(shape, BoxTool):
        return math.prod(shape.size)
    if isinstance(shape, RoundedBoxTool):
        # Steiner's formula for the core box grown by the radius.
        a, b, c = 2.0 * arrays.size[0, :3]
        r = shape.edge_radius
        return float(
            a * b * c + 2 * r * (a * b + b * c + c * a) + math.pi * r * r * (a + b + c) + 4 / 3 * math.pi * r**3
        )
    if isinstance(shape, CylinderTool):
        assert shape.length is not None
        return _cylinder_volume(shape.radius, shape.length, shape.edge_radius)
    area, moment = outline_integrals(arrays.segments)
    if isinstance(shape, ExtrusionTool):
        assert shape.length is not None
        return area * shape.length
    assert isinstance(shape, RevolutionTool)
    return 2.0 * math.pi * moment + 2.0 * shape.spine * area


def _cylinder_volume(radius: float, length: float, rounding: float) -> float:
    """Return the volume of a cylinder with rounded end edges (Pappus)."""
    core = radius - rounding
    straight = math.pi * radius**2 * (length - 2 * rounding)
    quarter = 0.25 * math.pi * rounding**2
    ring = 2.0 * math.pi * quarter * (core + 4.0 * rounding / (3.0 * math.pi))
    return straight + 2.0 * (math.pi * core**2 * rounding + ring)
