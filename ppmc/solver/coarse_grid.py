r"""Coarse level of the preconditioner: trilinear velocities on a background grid some particle spacings wide.

Block-Jacobi removes what neighbours can settle among themselves; motions that extend over many particles it reaches
only by diffusion, and stiff fibres make those the slow ones. They are solved for on a grid whose stiffness is that of
the material, taken with each particle as one point of quadrature:

.. math:: E_{ac,bd} = \sum_i V_i\,(e_c\otimes\nabla\phi_a) : \mathbb{C}_i : (e_d\otimes\nabla\phi_b)
   + \phi_a\phi_b\,\big(m_i\delta_{cd} + G_{i,cd} + s_i(\delta_{cd} - P_{i,cd})\big),

with inertia m, wall drag G, and a stiffness s (the particle's own) on the directions that tools hold. Compared with
the exact Galerkin product it costs a few iterations and saves hundreds of operator products. The correction
:math:`P\Phi E^{-1}\Phi^TP` is symmetric and positive semi-definite whatever E misses, so conjugate gradients stay
valid, and E may be kept while contacts change. The projection P is left to the caller, who has more to project.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.errors import NumericalError
from ppmc.solver.cells import MAX_CELLS
from ppmc.solver.contact import places
from ppmc.solver.gradient import FAST
from ppmc.solver.operator import Operator
from ppmc.solver.skyline import SkylineFactor, factorise

CELL = 5.0  # size of a grid cell in particle spacings
BOX = 64  # nodes of a cell and of those around it
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
    factor: SkylineFactor | None = None

    def stiffen(
        self, operator: Operator, inertia: np.ndarray, rows: np.ndarray, hold: np.ndarray
    ) -> None:  # fmt: skip
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
        n = len(self.order)
        pairs = operator.pairs
        cell_of = np.empty(n, dtype=np.int32)
        cell_of[self.order] = np.repeat(np.arange(len(self.nodes)), np.diff(self.start))
        boxes = self._boxes()
        lowest = np.where(boxes >= 0, boxes, len(self.sites)).min(axis=1)
        on = boxes >= 0
        reach = np.arange(len(self.sites))
        np.minimum.at(reach, boxes[on], np.repeat(lowest, on.sum(axis=1)))
        first = np.repeat(3 * reach, 3)
        offset = np.zeros(len(first) + 1, dtype=np.int64)
        np.cumsum(np.arange(len(first)) - first + 1, out=offset[1:])
        values = np.zeros(offset[-1])
        site = self.sites[self.nodes[:, 0]]
        place = places(rows, n)
        for colour in np.ndindex(4, 4, 4):
            cells = np.flatnonzero(np.all(site % 4 == colour, axis=1))
            if len(cells):
                _add_stiffness(
                    cells, self.order, cell_of, site, self.local, self.start, boxes, pairs.start, pairs.count,
                    pairs.index, pairs.weight, operator.positions, operator.volumes, operator.inverse, operator.shear,
                    operator.bulk, operator.fibre, operator.directions, operator.control, inertia, place, hold,
                    int(pairs.count.max(initial=0)), first, offset, values,
                )  # fmt: skip
        self.factor = factorise(first, offset, values, SHIFT)

    def _boxes(self) -> np.ndarray:
        """Nodes of each cell and those around it, shape (cells, 64), -1 for none."""
        table = np.full(tuple(self.sites.max(axis=0) + 3), -1)
        table[tuple((self.sites + 1).T)] = np.arange(len(self.sites))
        corner = self.sites[self.nodes[:, 0]]
        around = np.array(list(np.ndindex(4, 4, 4)))
        return table[tuple((corner[:, None] + around).transpose(2, 0, 1))]

    def add_correction(self, residual: np.ndarray, out: np.ndarray) -> None:
        """Add the interpolated grid solution for a residual (n, 3) to `out` (n, 3)."""
        assert self.factor is not None
        shares = np.empty((len(self.nodes), 8, 3))
        _restrict(self.order, self.start, self.local, residual, shares)
        load = np.empty((len(self.corners), 3))
        _collect(self.corners, shares.reshape(-1, 3), load)
        solution = self.factor.solve(load.ravel()).reshape(-1, 3)
        _interpolate(self.order, self.start, self.local, self.nodes, solution, out)


def make_grid(positions: np.ndarray, cell: float) -> CoarseGrid:
    """Lay a grid over the particles.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    cell : float
        Wanted size of a cell, mm; the grid fits the extent of the particles with whole cells.

    Returns
    -------
    CoarseGrid

    Raises
    ------
    ppmc.errors.NumericalError
        If the particles are spread over an implausible number of cells.
    """
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    low, span = positions.min(axis=0), np.ptp(positions, axis=0)
    if not np.prod(span / cell + 1.0) < MAX_CELLS:
        raise NumericalError(
            f"particles are spread over {low} to {low + span} mm: some have been lost; take smaller steps"
            " (solver.max_strain_increment) or look for gaps in the tooling"
        )
    shape = np.maximum(np.round(span / cell), 1).astype(np.int64)
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


@njit(cache=True, inline="always")
def _weights(local, phi):
    for a in range(8):
        wx = local[0] if a & 4 else 1.0 - local[0]
        wy = local[1] if a & 2 else 1.0 - local[1]
        wz = local[2] if a & 1 else 1.0 - local[2]
        phi[a] = wx * wy * wz


@njit(cache=True, fastmath=FAST)
def _weighted_product(a, b, weight, m):
    total = 0.0
    for s in range(m):
        total += weight[s] * a[s] * b[s]
    return total


@njit(cache=True, fastmath=FAST)
def _product(a, b, m):
    total = 0.0
    for s in range(m):
        total += a[s] * b[s]
    return total


@njit(cache=True, parallel=True)
def _add_stiffness(
    cells, order, cell_of, site, local, begin, boxes, start, count, index, weight, x, volume, inverse, shear, bulk,
    fibre, p, control, inertia, place, hold, longest, first, offset, values,
):  # fmt: skip
    """Add what the particles of some cells, whose boxes have no node in common, contribute to the stiffness."""
    directions = p.shape[1]
    for turn in prange(cells.shape[0]):
        cell = cells[turn]
        matrix = np.zeros((3 * BOX, 3 * BOX))
        delta = np.empty((BOX, longest))
        phi, a = np.empty(8), np.empty(longest)
        d, y = np.empty((3, longest)), np.empty((3, longest))
        g, f = np.empty((BOX, 3)), np.empty((BOX, 3, directions))
        number = np.empty(BOX, np.int64)
        mean = np.empty((3, 3))
        for at in range(begin[cell], begin[cell + 1]):
            i = np.int64(order[at])
            # Pairs within the cells next to this one, and the range of nodes that they see.
            low0, low1, low2, high0, high1, high2 = 1, 1, 1, 1, 1, 1
            m = 0
            total = 0.0
            mean[:] = 0.0
            near = np.empty(count[i], np.int64)
            for slot in range(start[i], start[i] + count[i]):
                j = np.int64(index[slot])
                other = cell_of[j]
                o0 = site[other, 0] - site[cell, 0] + 1
                o1 = site[other, 1] - site[cell, 1] + 1
                o2 = site[other, 2] - site[cell, 2] + 1
                if min(o0, min(o1, o2)) < 0 or max(o0, max(o1, o2)) > 2:
                    continue
                low0, low1, low2 = min(low0, o0), min(low1, o1), min(low2, o2)
                high0, high1, high2 = max(high0, o0), max(high1, o1), max(high2, o2)
                near[m] = j
                a[m] = volume[j] * weight[slot]
                r2 = 0.0
                for c in range(3):
                    d[c, m] = x[j, c] - x[i, c]
                    r2 += d[c, m] * d[c, m]
                for c in range(3):
                    y[c, m] = a[m] * (
                        inverse[i, c, 0] * d[0, m] + inverse[i, c, 1] * d[1, m] + inverse[i, c, 2] * d[2, m]
                    )
                    mean[c, c] += a[m] * control[i, 0]
                    for e in range(3):
                        mean[c, e] += a[m] / r2 * control[i, 1] * d[c, m] * d[e, m]
                for k in range(directions):
                    pd = p[i, k, 0] * d[0, m] + p[i, k, 1] * d[1, m] + p[i, k, 2] * d[2, m]
                    for c in range(3):
                        nc = p[i, k, c] * pd - d[c, m] / 3.0
                        for e in range(3):
                            mean[c, e] += a[m] / r2 * control[i, 2 + k] * nc * (p[i, k, e] * pd - d[e, m] / 3.0)
                total += a[m]
                m += 1
            wide1, wide2 = high1 - low1 + 2, high2 - low2 + 2
            nodes = (high0 - low0 + 2) * wide1 * wide2
            for node in range(nodes):
                number[node] = ((low0 + node // (wide1 * wide2)) * 4 + low1 + node // wide2 % wide1) * 4 + (
                    low2 + node % wide2
                )
                delta[node, :m] = 0.0
            _weights(local[i], phi)
            for corner in range(8):
                node = (
                    ((corner >> 2) + 1 - low0) * wide1 + ((corner >> 1) & 1) + 1 - low1
                ) * wide2 + (corner & 1) + 1 - low2
                for s in range(m):
                    delta[node, s] -= phi[corner]
            for s in range(m):
                j = near[s]
                other = cell_of[j]
                o0 = site[other, 0] - site[cell, 0] + 1 - low0
                o1 = site[other, 1] - site[cell, 1] + 1 - low1
                o2 = site[other, 2] - site[cell, 2] + 1 - low2
                _weights(local[j], phi)
                for corner in range(8):
                    node = ((o0 + (corner >> 2)) * wide1 + o1 + ((corner >> 1) & 1)) * wide2 + o2 + (corner & 1)
                    delta[node, s] += phi[corner]
            for c in range(3):
                for e in range(3):
                    mean[c, e] /= max(total, 1e-300)
            eta, lame = volume[i] * shear[i], volume[i] * (bulk[i] - 2.0 / 3.0 * shear[i])
            for node in range(nodes):
                for c in range(3):
                    g[node, c] = _product(delta[node], y[c], m)
                for s in range(m):
                    delta[node, s] -= g[node, 0] * d[0, s] + g[node, 1] * d[1, s] + g[node, 2] * d[2, s]
                for k in range(directions):
                    pg = p[i, k, 0] * g[node, 0] + p[i, k, 1] * g[node, 1] + p[i, k, 2] * g[node, 2]
                    for c in range(3):
                        f[node, c, k] = p[i, k, c] * pg - g[node, c] / 3.0
            for na in range(nodes):
                for nb in range(na + 1):
                    kept = _weighted_product(delta[na], delta[nb], a, m)
                    both = eta * (g[na, 0] * g[nb, 0] + g[na, 1] * g[nb, 1] + g[na, 2] * g[nb, 2])
                    for c in range(3):
                        row = 3 * number[na] + c
                        for e in range(3):
                            entry = kept * mean[c, e] + eta * g[na, e] * g[nb, c] + lame * g[na, c] * g[nb, e]
                            if c == e:
                                entry += both
                            for k in range(directions):
                                entry += volume[i] * fibre[i, k] * f[na, c, k] * f[nb, e, k]
                            matrix[row, 3 * number[nb] + e] += entry
            # Inertia, drag and hold act on the particle itself.
            held = place[i]
            if held >= 0 or inertia[i] > 0.0:
                _weights(local[i], phi)
                for ca in range(8):
                    na = (((ca >> 2) + 1) * 4 + ((ca >> 1) & 1) + 1) * 4 + (ca & 1) + 1
                    for cb in range(ca + 1):
                        nb = (((cb >> 2) + 1) * 4 + ((cb >> 1) & 1) + 1) * 4 + (cb & 1) + 1
                        share = phi[ca] * phi[cb]
                        for c in range(3):
                            matrix[3 * na + c, 3 * nb + c] += share * inertia[i]
                            if held >= 0:
                                for e in range(3):
                                    matrix[3 * na + c, 3 * nb + e] += share * hold[held, c, e]
        box = boxes[cell]
        for na in range(BOX):
            if box[na] < 0:
                continue
            for nb in range(na + 1):
                if box[nb] < 0:
                    continue
                for c in range(3):
                    for e in range(c + 1 if na == nb else 3):
                        row, column = 3 * box[na] + c, 3 * box[nb] + e
                        entry = matrix[3 * na + c, 3 * nb + e]
                        if row < column:
                            row, column = column, row
                        if entry != 0.0:
                            values[offset[row] + column - first[row]] += entry


@njit(cache=True, parallel=True)
def _restrict(order, start, local, residual, shares):
    for cell in prange(start.shape[0] - 1):
        phi = np.empty(8)
        shares[cell] = 0.0
        for slot in range(start[cell], start[cell + 1]):
            i = order[slot]
            _weights(local[i], phi)
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
            _weights(local[i], phi)
            for c in range(3):
                total = 0.0
                for a in range(8):
                    total += phi[a] * solution[nodes[cell, a], c]
                out[i, c] += total
