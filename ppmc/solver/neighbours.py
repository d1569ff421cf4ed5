"""Cell-sorted particles and neighbour lists with a skin.

The list is *full* (every pair appears in both rows) and its order is fixed by the particle order alone: cells are
visited in one order, particles inside a cell ascend. All later sums gather over a row, so results are bit-identical
for any thread count.

Rows of :class:`NeighbourList` hold candidates within the cutoff; :class:`Pairs` holds, for one set of positions,
those with a weight, compacted into the same row slots, so that the operator never tests a distance.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.cells import sort_into_cells
from ppmc.solver.neighbour_search import find_neighbours
from ppmc.solver.smoothing import SUPPORT, pair_weight

ROWS_A_BLOCK, MOST_BLOCKS = 256, 64
WINDOWS = 6  # windows of all blocks together, in particles
_NO_METRIC = np.empty((0, 6))


@dataclass
class Blocks:
    """Consecutive rows that are worked on together, with the window of particles that they reach.

    Sums over neighbours that are scattered, not gathered, run in one window a block; windows are then added in the
    order of the blocks. Blocks follow from the list alone, so such sums do not depend on the number of threads.

    Attributes
    ----------
    rows : ndarray, shape (blocks + 1,), int64
        First row of each block.
    low : ndarray, shape (blocks,), int64
        First particle of each window.
    offset : ndarray, shape (blocks + 1,), int64
        Where each window begins when they are stored one after the other.
    """

    rows: np.ndarray
    low: np.ndarray
    offset: np.ndarray


@dataclass
class Pairs:
    """Weighted pairs at one set of positions.

    Attributes
    ----------
    start : ndarray, shape (n + 1,), int64
        First slot of each row.
    count : ndarray, shape (n,), int32
        Number of neighbours with a positive weight.
    index : ndarray, shape (slots,), int32
    weight : ndarray, shape (slots,), float32
        Pair weight omega_ij, 1/mm^5; symmetric to the last bit. Moments, gradients and forces that share their weights
        are exact for linear fields and adjoint whatever these are, so that single precision costs nothing but a
        change of the kernel in its seventh digit.
    blocks : Blocks
        Blocks of rows, as in the list.
    moments : tuple of ndarray, optional
        Volumes, then inverse, trace and first moments taken with them (:func:`ppmc.solver.gradient.moment_inverses`),
        so that nothing takes the same sums again.
    """

    start: np.ndarray
    count: np.ndarray
    index: np.ndarray
    weight: np.ndarray
    blocks: Blocks
    moments: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None


@dataclass
class NeighbourList:
    """Candidate neighbours of every particle.

    Attributes
    ----------
    start : ndarray, shape (n + 1,), int64
        First slot of each row in `index`.
    index : ndarray, shape (pairs,), int32
        Candidate particle numbers.
    positions : ndarray, shape (n, 3)
        Positions the list was made from, mm; the list is valid until a particle has moved by half the skin.
    slack : float
        Distance, mm, that a particle may move from `positions` before the list must be rebuilt.
    blocks : Blocks
    spare : Pairs, optional
        Pairs of this list that nobody needs any more; the next ones take their arrays. Weights are most of what a run
        holds, and freshly allocated ones cost as much time as filling them.
    """

    start: np.ndarray
    index: np.ndarray
    positions: np.ndarray
    slack: float
    blocks: Blocks
    spare: Pairs | None = None


def cell_order(positions: np.ndarray, cutoff: float) -> np.ndarray:
    """Permutation that sorts particles by the cells that :func:`build_list` searches, stable inside a cell.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        Particle centres, mm.
    cutoff : float
        Distance, mm, within which neighbours are to be found.

    Returns
    -------
    ndarray, shape (n,), int32

    Raises
    ------
    ppmc.errors.NumericalError
        If the particles are spread over an implausible number of cells (some have been lost).
    """
    return sort_into_cells(positions, cutoff).order


def build_list(
    positions: np.ndarray, cutoff: float, slack: float, inverse_shape: np.ndarray | None = None, reach: float = 1.0
) -> NeighbourList:
    """List all particles within `cutoff` (mm) of each particle, itself left out.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        Particle centres, mm, best sorted with :func:`cell_order`.
    cutoff : float
        Support of the kernel plus skin, mm.
    slack : float
        Movement the skin allows, mm.
    inverse_shape : ndarray, shape (n, 6), optional
        Metric of the distance, as in :func:`weigh_pairs`.
    reach : float
        Largest axis of the shapes, by which the cells must be larger than `cutoff`.

    Returns
    -------
    NeighbourList
    """
    metric = _NO_METRIC if inverse_shape is None else inverse_shape
    radius = cutoff * reach
    start, index = find_neighbours(sort_into_cells(positions, radius), radius, cutoff, metric)
    return NeighbourList(start, index, positions.copy(), slack, _blocks(start, index))


def list_is_stale(neighbours: NeighbourList, positions: np.ndarray) -> bool:
    """Tell whether any particle has used up the skin of the list."""
    moved = positions - neighbours.positions
    return bool(np.einsum("ij,ij->i", moved, moved).max(initial=0.0) > neighbours.slack**2)


def weigh_pairs(
    neighbours: NeighbourList, positions: np.ndarray, smoothing_length: float, inverse_shape: np.ndarray | None = None
) -> Pairs:
    """Weights of all pairs at `positions`.

    Parameters
    ----------
    neighbours : NeighbourList
    positions : ndarray, shape (n, 3)
        Current centres, mm.
    smoothing_length : float
        h, mm.
    inverse_shape : ndarray, shape (n, 6), optional
        Inverse kernel shape tensors (XX, YY, ZZ, XY, YZ, XZ), dimensionless; spheres if left out. The mean of both
        particles' tensors is the metric of the pair.

    Returns
    -------
    Pairs
    """
    if neighbours.spare is not None:
        count, index, weight = neighbours.spare.count, neighbours.spare.index, neighbours.spare.weight
        neighbours.spare = None
    else:
        count = np.empty(len(positions), dtype=np.int32)
        index, weight = np.empty_like(neighbours.index), np.empty(len(neighbours.index), dtype=np.float32)
    metric = _NO_METRIC if inverse_shape is None else inverse_shape
    _weigh(neighbours.start, neighbours.index, positions, metric, smoothing_length, count, index, weight)
    return Pairs(neighbours.start, count, index, weight, neighbours.blocks)


def _blocks(start: np.ndarray, index: np.ndarray) -> Blocks:
    """Blocks of the rows of a list: as many as MOST_BLOCKS, fewer if their windows would take too much memory."""
    n = len(start) - 1
    count = min(MOST_BLOCKS, 1 << max(0, (n // ROWS_A_BLOCK).bit_length() - 1))
    rows = np.arange(count + 1) * n // count
    low, end = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    _reach(start, index, rows, low, end)
    while count > 1 and np.sum(end - low) > WINDOWS * n:
        count //= 2
        rows, low, end = rows[::2], np.minimum(low[::2], low[1::2]), np.maximum(end[::2], end[1::2])
    offset = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(end - low, out=offset[1:])
    return Blocks(np.ascontiguousarray(rows), low, offset)


@njit(cache=True, parallel=True)
def _reach(start, index, rows, low, end):
    for block in prange(low.shape[0]):
        first, last = rows[block], rows[block + 1] - 1
        for slot in range(start[rows[block]], start[rows[block + 1]]):
            j = np.int64(index[slot])
            first, last = min(first, j), max(last, j)
        low[block], end[block] = first, last + 1


@njit(cache=True, parallel=True)
def _weigh(start, candidates, x, g, h, count, index, weight):
    half2 = 0.5 * (SUPPORT * h) ** 2
    for i in prange(x.shape[0]):
        row = candidates[start[i] : start[i + 1]]
        names, weights = index[start[i] : start[i + 1]], weight[start[i] : start[i + 1]]
        spheres = g.shape[0] == 0
        m = (
            _within(x, i, row, half2, names, weights)
            if spheres
            else _within_metric(x, g, i, row, half2, names, weights)
        )
        for s in range(m):
            weights[s] = pair_weight(weights[s], h)
        count[i] = m


# Both write every candidate, and overwrite it with the next one if it was out of reach: loops without branches flow.
# One comparison leaves out what lies at the edge or beyond and what lies at the same point, which has no direction.


@njit(cache=True)
def _within(x, i, row, half2, names, distance2):
    x0, x1, x2, m = x[i, 0], x[i, 1], x[i, 2], 0
    for s in range(row.shape[0]):
        j = np.uint32(row[s])
        d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
        r2 = d0 * d0 + d1 * d1 + d2 * d2
        names[m], distance2[m] = j, r2
        m += 1 if abs(r2 - half2) < half2 else 0
    return m


@njit(cache=True)
def _within_metric(x, g, i, row, half2, names, distance2):
    x0, x1, x2, m = x[i, 0], x[i, 1], x[i, 2], 0
    g0, g1, g2, g3, g4, g5 = g[i, 0], g[i, 1], g[i, 2], g[i, 3], g[i, 4], g[i, 5]
    for s in range(row.shape[0]):
        j = np.uint32(row[s])
        d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
        r2 = (
            0.5 * (g0 + g[j, 0]) * d0 * d0
            + 0.5 * (g1 + g[j, 1]) * d1 * d1
            + 0.5 * (g2 + g[j, 2]) * d2 * d2
            + (g3 + g[j, 3]) * d0 * d1
            + (g4 + g[j, 4]) * d1 * d2
            + (g5 + g[j, 5]) * d0 * d2
        )
        names[m], distance2[m] = j, r2
        m += 1 if abs(r2 - half2) < half2 else 0
    return m
