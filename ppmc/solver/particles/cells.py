"""Particles sorted into the cells of a grid.

Cells follow one another along the shortest extent of the charge first and along the longest last, so that the
neighbours of a particle are never far from it in the order.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass, replace

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.errors import NumericalError

MAX_CELLS = 40_000_000
DIVISION = np.array([2.0, 1.0, 1.0])  # cells in the length searched, along the axes in order of extent


@dataclass
class Cells:
    """Particles sorted into cells.

    Attributes
    ----------
    order : ndarray, shape (n,), int32
        Particles, cell by cell.
    cell : ndarray, shape (n,), int32
        Cell of each particle.
    first : ndarray, shape (cells + 1,), int32
        First place of each cell in `order`.
    points : ndarray, shape (3, n)
        Coordinates in that order, along the axes as the cells count them, mm.
    axes : ndarray, shape (3,), int64
        Axis along which cells count fastest, second, slowest.
    shape : ndarray, shape (3,), int64
        Number of cells along these.
    edge, low : ndarray, shape (3,)
        Edges of a cell and lowest corner of the grid along these, mm.
    in_order : bool
        Whether the particles were sorted already, so that places are their numbers.
    """

    order: np.ndarray
    cell: np.ndarray
    first: np.ndarray
    points: np.ndarray
    axes: np.ndarray
    shape: np.ndarray
    edge: np.ndarray
    low: np.ndarray
    in_order: bool

    def in_their_order(self) -> "Cells":
        """Return the same cells for particles that have been put into `order`."""
        order = np.arange(len(self.order), dtype=np.int32)
        return replace(self, order=order, cell=self.cell[self.order], in_order=True)


def sort_into_cells(positions: np.ndarray, radius: float | np.ndarray) -> Cells:
    """Sort particles, stable inside a cell, so that all within `radius` of a cell lie in few runs of places.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    radius : float, or ndarray, shape (3,)
        Length searched, mm, along all axes or each.

    Returns
    -------
    Cells

    Raises
    ------
    ppmc.errors.NumericalError
        If the particles are spread over an implausible number of cells (some have been lost).
    """
    columns = [positions[:, k] for k in range(3)]  # nine times faster than along an axis of length three
    low, high = np.array([c.min() for c in columns]), np.array([c.max() for c in columns])
    span = (high - low) / radius
    if not np.all(np.isfinite(span)) or np.prod(span + 1.0) > MAX_CELLS:
        raise NumericalError(
            f"particles are spread over {low} to {high} mm: some have been lost;"
            " take smaller steps (solver.max_strain_increment) or look for gaps in the tooling"
        )
    n = len(positions)
    axes = np.argsort(high - low, kind="stable")
    edge = np.broadcast_to(radius, 3)[axes] / DIVISION
    shape = np.floor((high - low)[axes] / edge).astype(np.int64) + 1
    cell = np.empty(n, dtype=np.int32)
    _number_cells(positions, low[axes], edge, shape, axes, cell)
    first = np.zeros(int(np.prod(shape)) + 1, dtype=np.int32)
    order, points = np.arange(n, dtype=np.int32), np.empty((3, n))
    in_order = bool(_is_sorted(cell))
    if in_order:
        _find_first(cell, first)
    else:
        _sort_by_count(cell, first, order)
    _take(positions, axes, order, points)
    return Cells(order, cell, first, points, axes, shape, edge, low[axes], in_order)


@njit(cache=True, parallel=True)
def _number_cells(x, low, edge, shape, axes, cell):
    for i in prange(x.shape[0]):
        k = np.empty(3, dtype=np.int64)
        for c in range(3):
            k[c] = min(int((x[i, axes[c]] - low[c]) / edge[c]), shape[c] - 1)
        cell[i] = (k[2] * shape[1] + k[1]) * shape[0] + k[0]


@njit(cache=True)
def _is_sorted(cell):
    falls = 0
    for i in range(1, cell.shape[0]):
        falls += cell[i] < cell[i - 1]
    return falls == 0


@njit(cache=True, parallel=True)
def _find_first(cell, first):
    """First places of cells that the particles are sorted by already, as they are when their list is made."""
    n = cell.shape[0]
    for i in prange(n + 1):
        begin = 0 if i == 0 else cell[i - 1] + 1
        end = first.shape[0] if i == n else cell[i] + 1
        for k in range(begin, end):
            first[k] = i


@njit(cache=True)
def _sort_by_count(cell, first, order):
    for i in range(cell.shape[0]):
        first[cell[i] + 1] += 1
    for k in range(1, first.shape[0]):
        first[k] += first[k - 1]
    for i in range(cell.shape[0]):
        order[first[cell[i]]] = i
        first[cell[i]] += 1
    # Every entry has moved on to where the next cell begins.
    for k in range(first.shape[0] - 1, 0, -1):
        first[k] = first[k - 1]
    first[0] = 0


@njit(cache=True, parallel=True)
def _take(x, axes, order, points):
    for slot in prange(order.shape[0]):
        for c in range(3):
            points[c, slot] = x[order[slot], axes[c]]
