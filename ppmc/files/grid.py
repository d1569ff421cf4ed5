"""Where voxels stand in the tool's coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class VoxelGrid:
    """A regular grid of voxels.

    Attributes
    ----------
    shape : tuple of int
        Number of voxels (nz, ny, nx).
    spacing : tuple of float
        Edge lengths of a voxel (dx, dy, dz), mm.
    origin : tuple of float
        Centre of voxel [0, 0, 0] in tool coordinates (x, y, z), mm.
    direction : 3 x 3 nested tuple
        Columns are the grid's axes x, y, z in tool coordinates; a rotation.
    """

    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[tuple[float, float, float], ...] = field(default=_IDENTITY)

    def __post_init__(self) -> None:
        """Check what every user of a grid relies on.

        Raises
        ------
        ValueError
            If a count or spacing is not positive, or the direction is no rotation.
        """
        if len(self.shape) != 3 or min(self.shape) < 1:
            raise ValueError(f"a voxel grid needs three positive counts (nz, ny, nx), got {self.shape}")
        if not all(np.isfinite(self.spacing)) or min(self.spacing) <= 0:
            raise ValueError(f"voxel spacing must be positive, got {self.spacing}")
        if not all(np.isfinite(self.origin)):
            raise ValueError(f"voxel origin must be finite, got {self.origin}")
        R = self.rotation
        if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise ValueError("voxel direction must be a rotation matrix (orthonormal, determinant +1)")

    @property
    def rotation(self) -> NDArray[np.float64]:
        """The direction as an array, shape (3, 3)."""
        return np.asarray(self.direction, dtype=np.float64)

    @property
    def size(self) -> tuple[float, float, float]:
        """Edge lengths of the whole grid along its own axes x, y, z, mm; voxels counted whole."""
        nz, ny, nx = self.shape
        return (nx * self.spacing[0], ny * self.spacing[1], nz * self.spacing[2])

    @property
    def count(self) -> int:
        """Number of voxels."""
        return int(np.prod(self.shape, dtype=np.int64))

    def to_world(self, index: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return tool coordinates, shape (n, 3), of (fractional) voxel indices (i_x, i_y, i_z), shape (n, 3)."""
        return (np.asarray(index) * self.spacing) @ self.rotation.T + self.origin

    def to_index(self, position: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return fractional voxel indices (i_x, i_y, i_z), shape (n, 3), of tool coordinates, shape (n, 3)."""
        return ((np.asarray(position) - self.origin) @ self.rotation) / self.spacing

    def strided(self, k: int) -> VoxelGrid:
        """Return the grid of every k-th voxel, beginning with the first."""
        shape = tuple((n + k - 1) // k for n in self.shape)
        spacing = tuple(h * k for h in self.spacing)
        return VoxelGrid(shape, spacing, self.origin, self.direction)  # type: ignore[arg-type]
