r"""Coarse level of the preconditioner: trilinear velocities on a background grid some particle spacings wide.

Block-Jacobi removes what neighbours can settle among themselves; motions that extend over many particles it reaches
only by diffusion, and stiff fibres make those the slow ones. They are solved for on a grid whose stiffness is that of
the operator itself (:mod:`ppmc.solver.linear.coarse_stiffness`),

.. math:: E = \Phi^T A\,\Phi + \sum_i \phi_a(x_i)\phi_b(x_i)\,\big(m_i I + G_i + s_i(I - P_i)\big),

with inertia m, wall drag G, and a stiffness s (the particle's own) on the directions that tools hold. The material's
stiffness with each particle as one point of quadrature, which is cheaper, is no substitute: in a late fill, with layers
far thinner than a cell and unlike platelets tied within a kernel, it took eight times the iterations, and more with a
finer grid. The correction :math:`P\Phi E^{-1}\Phi^TP` is symmetric and positive semi-definite whatever E misses, so
conjugate gradients stay valid, and E is kept while contacts change. The projection P is left to the caller, who has
more to project.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass, field

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.errors import NumericalError
from ppmc.solver.linear.coarse_stiffness import SIDE, add_stiffness, trilinear
from ppmc.solver.linear.skyline import SkylineFactor, factorise
from ppmc.solver.particles.cells import MAX_CELLS
from ppmc.solver.sph.operator import Operator
from ppmc.solver.walls.contact import places

CELL = 4.0  # size of a grid cell in particle spacings
# Values of the factor, a particle and in all: more are not worth their memory, nor the time they take; cells are then
# made wider, first along the two longer extents only, for unlike plies on each other need theirs. Sheets of few layers,
# which want narrow cells most, may use the room that their lists leave: candidates a particle in the bulk, less theirs.
MOST_VALUES, FREE_VALUES = 48, 1_000_000
USUAL_CANDIDATES = 90
WIDENING, WIDEST = 1.02, 2.0  # at least, at a time; along the longer extents alone
FEWEST = 3  # cells across a thin charge, down to five eighths of the size: unlike plies on each other need them
SHIFT = 1e-9  # of the diagonal, for rigid motions


@dataclass
class CoarseGrid:
    """Grid over the cells that hold particles.

    Attributes
    ----------
    order : ndarray, shape (n,), int32
        Particles by cell.
    start : ndarray, shape (cells + 1,), int64
        First of each cell in `order`.
    local : ndarray, shape (n, 3)
        Place of each particle in its cell, 0 to 1.
    size : ndarray, shape (3,)
        Size of a cell, mm.
    nodes : ndarray, shape (cells, 8), int64
        Nodes of each cell.
    corners : ndarray, shape (nodes, 8), int64
        Cell corners, 8 cell + corner, that meet at a node; -1 for none.
    sites : ndarray, shape (nodes, 3), int64
        Number of each node along the axes.
    first, offset : ndarray
        Skyline of the grid's stiffness, see :class:`SkylineFactor`.
    factor : SkylineFactor or None
        Factor of the grid's stiffness.
    """

    order: np.ndarray
    start: np.ndarray
    local: np.ndarray
    size: np.ndarray
    nodes: np.ndarray
    corners: np.ndarray
    sites: np.ndarray
    first: np.ndarray = field(init=False)
    offset: np.ndarray = field(init=False)
    factor: SkylineFactor | None = None

    def __post_init__(self) -> None:
        self.first, self.offset = _profile(self._boxes(), len(self.sites))

    def stiffen(self, operator: Operator, inertia: np.ndarray, rows: np.ndarray, hold: np.ndarray) -> None:
        """Assemble and factorise the grid's stiffness.

        Parameters
        ----------
        operator : Operator
        inertia : ndarray, shape (n,)
            Mass over the step, Pa s mm.
        rows : ndarray, shape (m,), int64
            Particles that a tool may hold or brake.
        hold : ndarray, shape (m, 3, 3)
            Wall drag and hold of the tools on them, Pa s mm.
        """
        cell_of = np.empty(len(self.order), dtype=np.int32)
        cell_of[self.order] = np.repeat(np.arange(len(self.nodes)), np.diff(self.start))
        site = self.sites[self.nodes[:, 0]]
        boxes, first, offset = self._boxes(), self.first, self.offset
        values, pairs = np.zeros(offset[-1]), operator.pairs
        place, longest = places(rows, len(self.order)), max(1, int(pairs.count.max(initial=0)))
        # Cells whose boxes have no node in common, colour by colour: the sums have one order for any thread count.
        for colour in np.ndindex(SIDE, SIDE, SIDE):
            cells = np.flatnonzero(np.all(site % SIDE == colour, axis=1))
            if len(cells) > 0:
                add_stiffness(
                    cells, self.order, self.start, cell_of, site, self.local, boxes, pairs.start, pairs.count,
                    pairs.index, pairs.weight, operator.positions, operator.volumes, operator.inverse, operator.shear,
                    operator.bulk, operator.fibre, operator.directions, operator.control, inertia, place,
                    hold, longest, first, offset, values,
                )  # fmt: skip
        self.factor = factorise(first, offset, values, SHIFT)

    def _boxes(self) -> np.ndarray:
        """Nodes of each cell and of the cells next to it, shape (cells, 64), -1 for none."""
        table = np.full(tuple(self.sites.max(axis=0) + 3), -1)
        table[tuple((self.sites + 1).T)] = np.arange(len(self.sites))
        around = np.array(list(np.ndindex(SIDE, SIDE, SIDE)))
        return table[tuple((self.sites[self.nodes[:, 0]][:, None] + around).transpose(2, 0, 1))]

    def add_correction(self, residual: np.ndarray, out: np.ndarray) -> None:
        """Add the interpolated grid solution for a residual (n, 3) to `out` (n, 3)."""
        assert self.factor is not None
        shares = np.empty((len(self.nodes), 8, 3))
        _restrict(self.order, self.start, self.local, residual, shares)
        load = np.empty((len(self.corners), 3))
        _collect(self.corners, shares.reshape(-1, 3), load)
        solution = self.factor.solve(load.ravel()).reshape(-1, 3)
        _interpolate(self.order, self.start, self.local, self.nodes, solution, out)


def make_grid(positions: np.ndarray, cell: float, candidates: int | None = None) -> CoarseGrid:
    """Lay a grid over the particles.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    cell : float
        Wanted size of a cell, mm; the grid fits the extent of the particles with whole cells, narrower ones where a
        charge is thin, and wider ones where its factor would be large.
    candidates : int, optional
        Length of the neighbour list, each entry of which takes the memory of one value of the factor; as in the bulk
        if left out.

    Returns
    -------
    CoarseGrid

    Raises
    ------
    ppmc.errors.NumericalError
        If the particles are spread over an implausible number of cells.
    """
    low, span = positions.min(axis=0), np.ptp(positions, axis=0)
    if not np.prod(span / cell + 1.0) < MAX_CELLS:
        raise NumericalError(
            f"particles are spread over {low} to {low + span} mm: some have been lost; take smaller steps"
            " (solver.max_strain_increment) or look for gaps in the tooling"
        )
    n = len(positions)
    left = 0 if candidates is None else max(0, USUAL_CANDIDATES * n - candidates)
    wanted, most = np.full(3, cell), max(MOST_VALUES * n + left, FREE_VALUES)
    longer = np.argsort(span, kind="stable")[1:]
    while True:
        grid = _lay(positions, wanted)
        if grid.offset[-1] <= most:
            return grid
        # Values are as nodes times those of a cross-section; a little less than that asks for, so as not to pass by.
        factor = max(WIDENING, 0.95 * np.cbrt(grid.offset[-1] / most))
        if wanted[longer[0]] < WIDEST * wanted.min():
            wanted[longer] = np.minimum(factor * wanted[longer], WIDEST * wanted.min())
        else:
            wanted *= WIDENING


def _lay(positions: np.ndarray, cell: np.ndarray) -> CoarseGrid:
    """Lay a grid with cells of about the wanted size (3,), mm."""
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    low, span = positions.min(axis=0), np.ptp(positions, axis=0)
    few = np.minimum(FEWEST, np.floor(1.6 * span / cell))
    shape = np.maximum(np.maximum(np.round(span / cell), few), 1).astype(np.int64)
    size = np.where(span > 0.0, span / shape, cell)
    place = (positions - low) / size
    ijk = np.minimum(place.astype(np.int64), shape - 1)
    number = (ijk[:, 0] * shape[1] + ijk[:, 1]) * shape[2] + ijk[:, 2]
    order = np.argsort(number, kind="stable").astype(np.int32)
    occupied, start = np.unique(number[order], return_index=True)
    low_corner = np.stack(np.unravel_index(occupied, tuple(shape)), axis=1)
    step = np.stack(np.unravel_index(np.arange(8), (2, 2, 2)), axis=1)
    grid_nodes = np.ravel_multi_index(tuple((low_corner[:, None] + step).transpose(2, 0, 1)), tuple(shape + 1))
    used, nodes = np.unique(grid_nodes, return_inverse=True)
    nodes = nodes.reshape(-1, 8)

    # Numbers that keep the nodes of a cell close together make the factor small.
    rows, columns = np.repeat(nodes, 8, axis=1).ravel(), np.tile(nodes, (1, 8)).ravel()
    links = csr_array(coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(len(used), len(used))))
    rank = np.empty(len(used), dtype=np.int64)
    rank[reverse_cuthill_mckee(links, symmetric_mode=True)] = np.arange(len(used))
    nodes = rank[nodes]
    sites = np.empty((len(used), 3), dtype=np.int64)
    sites[rank] = np.stack(np.unravel_index(used, tuple(shape + 1)), axis=1)

    corners = np.full((len(used), 8), -1, dtype=np.int64)
    corners[nodes, np.arange(8)] = np.arange(nodes.size).reshape(-1, 8)
    return CoarseGrid(
        order, np.append(start, len(positions)), np.ascontiguousarray(place - ijk), size, nodes, corners, sites
    )  # fmt: skip


def _profile(boxes: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Skyline of a matrix in which the nodes of each box (boxes, 64) are coupled; see :class:`SkylineFactor`."""
    here = boxes >= 0
    lowest = np.where(here, boxes, count).min(axis=1)
    reach = np.arange(count)
    np.minimum.at(reach, boxes[here], np.repeat(lowest, here.sum(axis=1)))
    first = np.repeat(3 * reach, 3)
    return first, np.append(0, np.cumsum(np.arange(len(first)) - first + 1))


@njit(cache=True, parallel=True)
def _restrict(order, start, local, residual, shares):
    for cell in prange(start.shape[0] - 1):
        phi = np.empty(8)
        shares[cell] = 0.0
        for slot in range(start[cell], start[cell + 1]):
            i = order[slot]
            trilinear(local[i], phi)
            for a in range(8):
                for c in range(3):
                    shares[cell, a, c] += phi[a] * residual[i, c]


@njit(cache=True)
def _collect(corners, shares, load):
    for node in range(corners.shape[0]):
        for c in range(3):
            total = 0.0
            for k in range(8):
                if corners[node, k] >= 0:
                    total += shares[corners[node, k], c]
            load[node, c] = total


@njit(cache=True, parallel=True)
def _interpolate(order, start, local, nodes, solution, out):
    for cell in prange(start.shape[0] - 1):
        phi = np.empty(8)
        for slot in range(start[cell], start[cell + 1]):
            i = order[slot]
            trilinear(local[i], phi)
            for c in range(3):
                total = 0.0
                for a in range(8):
                    total += phi[a] * solution[nodes[cell, a], c]
                out[i, c] += total
