"""Where a scanned block stands in the tool's coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.files import VoxelGrid
from ppmc.scene.sections.ct import Registration


def rotation_matrix(about_x: float, about_y: float, about_z: float) -> NDArray[np.float64]:
    """Return the rotation by three angles (degrees) about the tool's x, then y, then z axis, shape (3, 3)."""
    cx, cy, cz = np.cos(np.radians([about_x, about_y, about_z]))
    sx, sy, sz = np.sin(np.radians([about_x, about_y, about_z]))
    turn_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    turn_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    turn_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(turn_z @ turn_y @ turn_x)


def registered(grid: VoxelGrid, place: Registration | None) -> VoxelGrid:
    """Return the grid placed as the scene says: rotated from its own place, its first voxel at the given origin."""
    if place is None:
        return grid
    turn = rotation_matrix(*place.rotation) @ grid.rotation
    rows = tuple((float(a), float(b), float(c)) for a, b, c in turn)
    return VoxelGrid(grid.shape, grid.spacing, grid.origin if place.origin is None else place.origin, rows)
