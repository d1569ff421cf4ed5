"""Cell-sorted particles and neighbour lists with a skin.

Each row holds what its own particle sees, in its own metric: between kernels of one shape every pair appears in both
rows, between others one may see what does not see it. The order is fixed by the particle order alone: cells are visited
in one order, particles inside a cell ascend. All later sums run over a row, so results are bit-identical for any thread
count.

Why not the mean of two metrics, which would make all weights symmetric? The rate of the packing that a particle sees in
its own kernel is -tr(G L M), with the metric G, and M is proportional to the inverse of G where neighbours are evenly
spread: a flow without divergence keeps the packing. With the weights of mean metrics the gradient L is another sum than
that rate, and a solve that holds its trace at zero is free to pack the charge: a bracket's flanges lacked a third.

Rows of :class:`NeighbourList` hold candidates within the cutoff; :class:`Pairs` holds, for one set of positions,
those with a weight, so that the operator never tests a distance. Both share their arrays, which are most of what a run
holds: a row's candidates with a weight come first, the others behind them, each part in the order of the list. Where
one of the others belongs in that order is written where its weight would be. A row is divided anew only when a
candidate has come within reach or left it, which few do from step to step.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass, field

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.cells import Cells, sort_into_cells
from ppmc.solver.particles.neighbour_search import find_neighbours, room_for
from ppmc.solver.particles.smoothing import SUPPORT, pair_weight

CHUNK = 64  # rows that share their buffers
ROWS_A_BLOCK, MOST_BLOCKS = 256, 64
ROW_SPARE = 4  # candidates by which the longest row may grow from one list to the next without a second search
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
    """Weighted pairs at one set of positions, valid until their list is weighed again.

    Attributes
    ----------
    start : ndarray, shape (n + 1,), int64
        First slot of each row.
    count : ndarray, shape (n,), int32
        Number of neighbours with a positive weight: the first of each row.
    index : ndarray, shape (slots,), int32
    weight : ndarray, shape (slots,), float32
        Pair weight omega_ij, 1/mm^5, in the kernel of the row's particle. Moments, gradients and forces that share
        their weights are exact for linear fields and adjoint whatever these are, so that single precision costs
        nothing but a change of the kernel in its seventh digit.
    blocks : Blocks
        Blocks of rows, as in the list.
    metric : ndarray, shape (n, 6) or (0, 6)
        Inverse kernel shapes that the weights were taken with; none for spheres.
    moments : tuple of ndarray, optional
        Volumes, then inverse, trace and first moments taken with them
        (:func:`ppmc.solver.sph.gradient.moment_inverses`), so that nothing takes the same sums again.
    """

    start: np.ndarray
    count: np.ndarray
    index: np.ndarray
    weight: np.ndarray
    blocks: Blocks
    metric: np.ndarray = field(default_factory=lambda: _NO_METRIC)
    moments: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None


@dataclass
class NeighbourList:
    """Candidate neighbours of every particle.

    Attributes
    ----------
    start : ndarray, shape (n + 1,), int64
        First slot of each row in `index`.
    index : ndarray, shape (slots,), int32
        Candidate particle numbers, those that had a weight when last weighed first.
    count : ndarray, shape (n,), int32
        How many these are; all candidates of a list that hasn't been weighed.
    weight : ndarray, shape (slots,), float32
        Their weights, then the places of the others in the row as it was listed.
    longest : int
        Most candidates in a row.
    positions : ndarray, shape (n, 3)
        Positions the list was made from, mm; the list is valid until a particle has moved by half the skin.
    slack : float
        Distance, mm, that a particle may move from `positions` before the list must be rebuilt.
    blocks : Blocks
    """

    start: np.ndarray
    index: np.ndarray
    count: np.ndarray
    weight: np.ndarray
    longest: int
    positions: np.ndarray
    slack: float
    blocks: Blocks


def build_list(
    positions: np.ndarray, cutoff: float, slack: float, inverse_shape: np.ndarray | None = None, reach: float = 1.0,
    last: NeighbourList | None = None, cells: Cells | None = None,
) -> NeighbourList:  # fmt: skip
    """List all particles within `cutoff` (mm) of each particle, itself left out.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        Particle centres, mm, best in the order of :func:`ppmc.solver.particles.cells.sort_into_cells`.
    cutoff : float
        Support of the kernel plus skin, mm.
    slack : float
        Movement the skin allows, mm.
    inverse_shape : ndarray, shape (n, 6), optional
        Metric of the distance, as in :func:`weigh_pairs`.
    reach : float
        Largest axis of the shapes.
    last : NeighbourList, optional
        A list that nobody needs any more; the new one takes its arrays if they are large enough.
    cells : Cells, optional
        The particles sorted into cells of the length that is searched, where that has been done already.

    Returns
    -------
    NeighbourList
    """
    metric = _NO_METRIC if inverse_shape is None else inverse_shape
    box = cutoff * (np.ones(3) if inverse_shape is None else extents(inverse_shape))
    cells = sort_into_cells(positions, box) if cells is None else cells
    likely, room = (0, None) if last is None else (last.longest + ROW_SPARE, last.index)
    start, index = find_neighbours(cells, cutoff * reach, box, cutoff, metric, likely, room)
    del cells
    weight = room_for(len(index), np.float32, None if last is None else last.weight)
    count = np.empty(len(positions), dtype=np.int32)
    np.subtract(start[1:], start[:-1], out=count, casting="unsafe")
    longest = int(count.max(initial=0))
    return NeighbourList(start, index, count, weight, longest, positions.copy(), slack, _blocks(start, index))


def extents(inverse_shape: np.ndarray) -> np.ndarray:
    """Largest half-widths along x, y and z of ellipsoids with inverse shape tensors (n, 6); shape (3,)."""
    out = np.zeros(3)
    _extents(inverse_shape, out)
    return np.sqrt(out)


def list_is_stale(neighbours: NeighbourList, positions: np.ndarray) -> bool:
    """Tell whether any particle has used up the skin of the list."""
    farthest = np.zeros((len(positions) + CHUNK - 1) // CHUNK)
    _farthest_moves(positions, neighbours.positions, farthest)
    return bool(farthest.max(initial=0.0) > neighbours.slack**2)


def weigh_pairs(
    neighbours: NeighbourList, positions: np.ndarray, smoothing_length: float, inverse_shape: np.ndarray | None = None
) -> Pairs:
    """Weights of all pairs at `positions`; they take the place of those that the list had before.

    Parameters
    ----------
    neighbours : NeighbourList
    positions : ndarray, shape (n, 3)
        Current centres, mm.
    smoothing_length : float
        h, mm.
    inverse_shape : ndarray, shape (n, 6), optional
        Inverse kernel shape tensors (XX, YY, ZZ, XY, YZ, XZ), dimensionless; spheres if left out. Each row is weighed
        in the metric of its own particle.

    Returns
    -------
    Pairs
    """
    metric = _NO_METRIC if inverse_shape is None else inverse_shape
    start, count, index, weight = neighbours.start, neighbours.count, neighbours.index, neighbours.weight
    _weigh(start, positions, metric, smoothing_length, neighbours.longest, count, index, weight)
    return Pairs(start, count, index, weight, neighbours.blocks, metric)


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
def _farthest_moves(x, before, squared):
    for chunk in prange(squared.shape[0]):
        for i in range(chunk * CHUNK, min(x.shape[0], (chunk + 1) * CHUNK)):
            d0, d1, d2 = x[i, 0] - before[i, 0], x[i, 1] - before[i, 1], x[i, 2] - before[i, 2]
            squared[chunk] = max(squared[chunk], d0 * d0 + d1 * d1 + d2 * d2)


@njit(cache=True)
def _extents(inverse, squared):
    for i in range(inverse.shape[0]):
        xx, yy, zz, xy, yz, xz = (
            inverse[i, 0], inverse[i, 1], inverse[i, 2], inverse[i, 3], inverse[i, 4], inverse[i, 5],
        )  # fmt: skip
        a, b, c = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
        per = 1.0 / (xx * a + xy * (xz * yz - xy * zz) + xz * (xy * yz - xz * yy))
        squared[0], squared[1], squared[2] = (
            max(squared[0], per * a),
            max(squared[1], per * b),
            max(squared[2], per * c),
        )


@njit(cache=True, parallel=True)
def _reach(start, index, rows, low, end):
    for block in prange(low.shape[0]):
        first, last = _least_and_most(index[start[rows[block]] : start[rows[block + 1]]])
        low[block], end[block] = min(rows[block], first), max(rows[block + 1] - 1, last) + 1


@njit(cache=True)
def _least_and_most(names):
    least, most = np.int32(2**31 - 1), np.int32(-1)
    for s in range(names.shape[0]):
        least = names[s] if names[s] < least else least
        most = names[s] if names[s] > most else most
    return np.int64(least), np.int64(most)


@njit(cache=True, parallel=True)
def _weigh(start, x, g, h, longest, count, index, weight):
    n, half2, spheres = x.shape[0], 0.5 * (SUPPORT * h) ** 2, g.shape[0] == 0
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        row, others, places = (
            np.empty(longest, dtype=np.int32), np.empty(longest, dtype=np.int32), np.empty(longest, dtype=np.int32),
        )  # fmt: skip
        distance2, listed2 = np.empty(longest), np.empty(longest)
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            names, weights, m = index[start[i] : start[i + 1]], weight[start[i] : start[i + 1]], count[i]
            if spheres:
                _distances(x, i, names, distance2)
            else:
                _metric_distances(x, g, i, names, distance2)
            if not _is_divided(distance2, half2, m, len(names)):
                _list_again(names, weights, distance2, m, row, listed2)
                m = _divide(row, listed2, half2, names, weights, distance2, others, places)
                count[i] = m
            for s in range(m):
                weights[s] = pair_weight(np.float32(distance2[s]), h)


@njit(cache=True)
def _distances(x, i, names, distance2):
    x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
    for s in range(names.shape[0]):
        j = np.uint32(names[s])
        d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
        distance2[s] = d0 * d0 + d1 * d1 + d2 * d2


@njit(cache=True)
def _metric_distances(x, g, i, names, distance2):
    x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
    g0, g1, g2, g3, g4, g5 = g[i, 0], g[i, 1], g[i, 2], g[i, 3], g[i, 4], g[i, 5]
    for s in range(names.shape[0]):
        j = np.uint32(names[s])
        d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
        distance2[s] = g0 * d0 * d0 + g1 * d1 * d1 + g2 * d2 * d2 + 2.0 * (g3 * d0 * d1 + g4 * d1 * d2 + g5 * d0 * d2)


# One comparison leaves out what lies at the edge or beyond and what lies at the same point, which has no direction.


@njit(cache=True)
def _is_divided(distance2, half2, m, length):
    """Whether the first `m` candidates of a row, and only they, are within reach."""
    wrong = 0
    for s in range(m):
        wrong += 0 if abs(distance2[s] - half2) < half2 else 1
    for s in range(m, length):
        wrong += 1 if abs(distance2[s] - half2) < half2 else 0
    return wrong == 0


@njit(cache=True)
def _list_again(names, weights, distance2, m, row, listed2):
    """Write a divided row as it was listed."""
    inner, other = 0, m
    for s in range(names.shape[0]):
        if other < names.shape[0] and weights[other] == s:
            row[s], listed2[s] = names[other], distance2[other]
            other += 1
        else:
            row[s], listed2[s] = names[inner], distance2[inner]
            inner += 1


@njit(cache=True)
def _divide(row, listed2, half2, names, weights, distance2, others, places):
    """Write those within reach first, the others and their places behind them; return how many are within reach."""
    # Every candidate is written to both, and overwritten where it did not belong: a loop without branches flows.
    inner, other = 0, 0
    for s in range(names.shape[0]):
        names[inner], distance2[inner] = row[s], listed2[s]
        others[other], places[other] = row[s], s
        within = 1 if abs(listed2[s] - half2) < half2 else 0
        inner += within
        other += 1 - within
    for s in range(other):
        names[inner + s], weights[inner + s] = others[s], places[s]
    return inner
