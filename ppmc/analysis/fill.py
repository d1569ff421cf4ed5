"""Where material is: occupancy of cells, overlap of two states, and the time at which each place fills."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CELL_IN_SPACINGS = 2.0
MOST_CELLS = 50_000_000


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

    def occupied(self, positions: np.ndarray) -> NDArray[np.bool_]:
        """Return which cells hold a point, shape of the grid."""
        out = np.zeros(int(np.prod(self.shape)), dtype=bool)
        out[self.index(positions)] = True
        return out.reshape(self.shape)


def cells_around(clouds: Iterable[np.ndarray], spacing: float, cell: float | None = None) -> Cells:
    """Return cells that hold all clouds of points; two spacings wide unless given, for then a filled place has no gaps.

    Parameters
    ----------
    clouds : iterable of ndarray, shape (n, 3)
        mm.
    spacing : float
        Distance of neighbours, mm.
    cell : float, optional
        Edge of a cube, mm.
    """
    clouds = [c for c in clouds if len(c)]
    size = cell or CELL_IN_SPACINGS * spacing
    low = np.min([c.min(axis=0) for c in clouds], axis=0) - 0.5 * spacing
    high = np.max([c.max(axis=0) for c in clouds], axis=0) + 0.5 * spacing
    shape = np.maximum(np.ceil((high - low) / size), 1)
    while np.prod(shape) > MOST_CELLS:
        size *= 1.5
        shape = np.maximum(np.ceil((high - low) / size), 1)
    return Cells(low, float(size), tuple(int(v) for v in shape))  # type: ignore[arg-type]


def overlap(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Return intersection over union of two occupancies: 1 for equal ones, NaN if both are empty."""
    union = int((first | second).sum())
    return int((first & second).sum()) / union if union else float("nan")


def silhouette(occupied: NDArray[np.bool_], axis: int) -> NDArray[np.bool_]:
    """Return what is covered when looking along an axis, as in the papers' top views of short shots (D Figs 6, 7)."""
    return np.asarray(occupied.any(axis=axis))


def fill_times(frames: Iterable[tuple[float, np.ndarray]], cells: Cells, final: np.ndarray) -> np.ndarray:
    """Return the time at which the place of each final point was first reached.

    Parameters
    ----------
    frames : iterable of (float, ndarray of shape (n, 3))
        Times (s, ascending) and positions (mm).
    cells : Cells
        Around all frames.
    final : ndarray, shape (m, 3)
        Places to ask for, mm.

    Returns
    -------
    ndarray, shape (m,)
        s; as fine as the frames are, NaN for places no frame reached.
    """
    first = np.full(int(np.prod(cells.shape)), np.nan)
    for time, positions in frames:
        reached = np.unique(cells.index(positions))
        new = reached[np.isnan(first[reached])]
        first[new] = time
    return first[cells.index(final)]
