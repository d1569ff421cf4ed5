"""Where material is: the cells that particles or voxels fill, the overlap of two states, and views of it along an axis.

A point stands for a piece of material, not for a place: a particle for its cube at the start carried along by F, a
voxel for its box. Every piece is cut into equal bits, and each bit gives its volume to the cell it lies in. So filled
volumes are right to a small part of a cell, and not a cell too wide all round.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit
from ppmc.particles import Particles

Array = NDArray[Any]

CELL_IN_SPACINGS = 0.5
MOST_CELLS = 20_000_000
BITS_A_CELL = 3.0
MOST_BITS = 16  # along each edge of a piece
HALF_FULL = 0.5
NEARLY_FULL = 0.7


@dataclass(frozen=True)
class Cells:
    """A grid of cubes that several states share.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        Lowest corner, mm.
    size : float
        Edge of a cube, mm.
    shape : tuple of 3 int
    """

    origin: np.ndarray
    size: float
    shape: tuple[int, int, int]

    def index(self, positions: np.ndarray) -> NDArray[np.int64]:
        """Return the flat index of each point's cell; points outside go to the nearest cell."""
        at = np.floor((positions - self.origin) / self.size).astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(np.clip(at, 0, np.array(self.shape) - 1).T), self.shape))

    def centres(self, axis: int) -> NDArray[np.float64]:
        """Return the middles of the cells along one axis, mm."""
        return np.asarray(self.origin[axis] + (np.arange(self.shape[axis]) + 0.5) * self.size)


def cells_around(clouds: Iterable[np.ndarray], margin: float, size: float) -> Cells:
    """Return cells that hold all clouds of points.

    Parameters
    ----------
    clouds : iterable of ndarray, shape (n, 3)
        mm; empty ones are passed over.
    margin : float
        Room around the outermost points, mm.
    size : float
        Edge of a cube, mm; larger where there would be more than `MOST_CELLS`.
    """
    clouds = [c for c in clouds if len(c)]
    low = np.min([c.min(axis=0) for c in clouds], axis=0) - margin
    high = np.max([c.max(axis=0) for c in clouds], axis=0) + margin
    shape = np.maximum(np.ceil((high - low) / size), 1)
    while np.prod(shape) > MOST_CELLS:
        size *= 1.2
        shape = np.maximum(np.ceil((high - low) / size), 1)
    return Cells(low, float(size), tuple(int(v) for v in shape))  # type: ignore[arg-type]


def fill_shares(
    parts: Iterable[Particles], cells: Cells, edges: np.ndarray | None = None, bits_a_cell: float = BITS_A_CELL
) -> NDArray[np.float64]:
    """Return the share of each cell's volume that is filled, shape of the grid; above 1 where pieces overlap.

    Parameters
    ----------
    parts : iterable of Particles
        Disjoint parts of one state; with the field ``deformation_gradient`` the pieces are deformed by it.
    cells : Cells
    edges : ndarray, shape (3, 3), optional
        Rows are the edges of undeformed pieces, in units of the cube root of their volume, such as those of voxels on
        a turned grid; cubes along the tool axes if left out.
    bits_a_cell : float
        Bits along the edge of a cell; more are finer and slower.
    """
    total = np.zeros(int(np.prod(cells.shape)))
    sides = np.eye(3) if edges is None else np.asarray(edges, dtype=float)
    for part in parts:
        n = len(part)
        if not n:
            continue
        side = np.cbrt(part.volume)
        F = part.fields.get("deformation_gradient")
        F = np.broadcast_to(np.eye(3), (n, 3, 3)) if F is None else np.asarray(F, dtype=float).reshape(n, 3, 3)
        stretch = float(np.percentile(np.abs(F).sum(axis=1).max(axis=1), 99.0))
        longest = stretch * float(side.max() * np.linalg.norm(sides, axis=1).max())
        bits = int(np.clip(np.ceil(bits_a_cell * longest / cells.size), 2, MOST_BITS))
        marks = (np.arange(bits) + 0.5) / bits - 0.5
        offsets = np.stack(np.meshgrid(marks, marks, marks, indexing="ij"), -1).reshape(-1, 3) @ sides
        share = part.volume * np.abs(np.linalg.det(F)) / (len(offsets) * cells.size**3)
        pieces = (part.positions.astype(float), np.ascontiguousarray(F * side[:, None, None]), share)
        _scatter(*pieces, offsets, cells.origin, cells.size, np.array(cells.shape), total)
    return total.reshape(cells.shape)


@njit
def _scatter(
    positions: Array, edges: Array, share: Array, offsets: Array, origin: Array, size: float, shape: Array, total: Array
) -> None:
    """Add the share of every bit of every piece to the cell it lies in; bits outside go to the nearest cell."""
    for i in range(positions.shape[0]):
        for b in range(offsets.shape[0]):
            cell = 0
            for d in range(3):
                x = positions[i, d]
                for e in range(3):
                    x += edges[i, d, e] * offsets[b, e]
                k = int(np.floor((x - origin[d]) / size))
                cell = cell * shape[d] + min(max(k, 0), shape[d] - 1)
            total[cell] += share[i]


def occupancy(parts: Iterable[Particles], cells: Cells, edges: np.ndarray | None = None) -> NDArray[np.float64]:
    """Return how full each cell is, 0 to 1, shape of the grid; arguments as `fill_shares`.

    Cells whose neighbourhood of 27 is nearly full count as full, and so do enclosed holes: neither cracks between
    particles that a flow has parted unevenly nor voxels of resin, which have no direction, are voids. A plane face
    keeps the share it cuts off, for there the mean stays below 2/3.
    """
    from scipy.ndimage import binary_fill_holes, uniform_filter

    share = np.minimum(fill_shares(parts, cells, edges), 1.0)
    solid = share >= HALF_FULL
    inner = (uniform_filter(share, 3, mode="constant") >= NEARLY_FULL) | (binary_fill_holes(solid) & ~solid)
    return np.asarray(np.where(inner, 1.0, share))


def overlap(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return intersection over union of two occupancies, Σ min / Σ max: 1 for equal ones, NaN if both are empty."""
    union = float(np.maximum(first, second).sum())
    return float(np.minimum(first, second).sum()) / union if union else float("nan")


def silhouette(occupied: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return how far each place is covered, 0 to 1, when looking along an axis (D's top views of short shots).

    A sheet thinner than a cell covers what lies behind it, though it fills no cell.
    """
    most = occupied.max(axis=axis)
    level = float(np.median(most[most > 0])) if (most > 0).any() else 1.0
    return np.asarray(np.minimum(most / level, 1.0))
