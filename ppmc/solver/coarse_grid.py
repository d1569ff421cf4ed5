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
from ppmc.solver.skyline import SkylineFactor, factorise

CELL = 3.0  # size of a grid cell in particle spacings
CELLS_AT_ONCE = 256  # whose matrices are held together
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
    factor : SkylineFactor or None
        Factor of the grid's stiffness.
    """

    order: np.ndarray
    start: np.ndarray
    local: np.ndarray
    size: np.ndarray
    nodes: np.ndarray
    corners: np.ndarray
    factor: SkylineFactor | None = None

    def stiffen(
        self, volumes: np.ndarray, shear: np.ndarray, bulk: np.ndarray, fibre: np.ndarray, directions: np.ndarray,
        inertia: np.ndarray, rows: np.ndarray, hold: np.ndarray,
    ) -> None:  # fmt: skip
        """Assemble and factorise the grid's stiffness.

        Parameters
        ----------
        volumes, shear, bulk, fibre, directions
            As in :class:`ppmc.solver.operator.Operator`.
        inertia : ndarray, shape (n,)
            Mass over the step, Pa s mm.
        rows : ndarray, shape (m,), int64
            Particles that a tool may hold or brake.
        hold : ndarray, shape (m, 3, 3)
            Wall drag and hold of the tools on them, Pa s mm.
        """
        place = places(rows, len(volumes))
        lowest = np.arange(len(self.corners))
        np.minimum.at(lowest, self.nodes.ravel(), np.repeat(self.nodes.min(axis=1), 8))
        first = np.repeat(3 * lowest, 3)
        offset = np.zeros(len(first) + 1, dtype=np.int64)
        np.cumsum(np.arange(len(first)) - first + 1, out=offset[1:])
        values, cells = np.zeros(offset[-1]), len(self.nodes)
        matrices = np.empty((min(CELLS_AT_ONCE, cells), 24, 24))
        for begin in range(0, cells, CELLS_AT_ONCE):
            end = min(begin + CELLS_AT_ONCE, cells)
            _cell_stiffness(
                self.order, self.start[begin : end + 1], self.local, self.size, volumes, shear, bulk, fibre,
                directions, inertia, place, hold, matrices,
            )  # fmt: skip
            _gather_stiffness(self.nodes[begin:end], matrices, first, offset, values)
        self.factor = factorise(first, offset, values, SHIFT)

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

    corners = np.full((len(used), 8), -1, dtype=np.int64)
    corners[nodes, np.arange(8)] = np.arange(nodes.size).reshape(-1, 8)
    return CoarseGrid(
        order, np.append(start, len(positions)), np.ascontiguousarray(place - ijk), size, nodes, corners
    )  # fmt: skip


@njit(cache=True, inline="always")
def _weights(local, phi):
    for a in range(8):
        wx = local[0] if a & 4 else 1.0 - local[0]
        wy = local[1] if a & 2 else 1.0 - local[1]
        wz = local[2] if a & 1 else 1.0 - local[2]
        phi[a] = wx * wy * wz


@njit(cache=True, inline="always")
def _gradients(local, size, grad):
    for a in range(8):
        wx = local[0] if a & 4 else 1.0 - local[0]
        wy = local[1] if a & 2 else 1.0 - local[1]
        wz = local[2] if a & 1 else 1.0 - local[2]
        grad[a, 0] = (1.0 if a & 4 else -1.0) * wy * wz / size[0]
        grad[a, 1] = (1.0 if a & 2 else -1.0) * wx * wz / size[1]
        grad[a, 2] = (1.0 if a & 1 else -1.0) * wx * wy / size[2]


@njit(cache=True, parallel=True)
def _cell_stiffness(order, start, local, size, volume, shear, bulk, fibre, p, inertia, place, hold, out):
    for cell in prange(start.shape[0] - 1):
        matrix = out[cell]
        matrix[:] = 0.0
        phi, g, flat, point = np.empty(8), np.empty((8, 3)), np.empty(24), np.empty((3, 3))
        for slot in range(start[cell], start[cell + 1]):
            i = order[slot]
            _weights(local[i], phi)
            _gradients(local[i], size, g)
            point[:] = 0.0
            if place[i] >= 0:
                point[:] = hold[place[i]]
            for c in range(3):
                point[c, c] += inertia[i]
            vol = volume[i]
            eta, lame = vol * shear[i], vol * (bulk[i] - 2.0 / 3.0 * shear[i])
            for a in range(8):
                for b in range(a + 1):
                    gg = eta * (g[a, 0] * g[b, 0] + g[a, 1] * g[b, 1] + g[a, 2] * g[b, 2])
                    pp = phi[a] * phi[b]
                    for c in range(3):
                        matrix[3 * a + c, 3 * b + c] += gg
                        for d in range(3):
                            matrix[3 * a + c, 3 * b + d] += (
                                eta * g[a, d] * g[b, c] + lame * g[a, c] * g[b, d] + pp * point[c, d]
                            )
            for k in range(p.shape[1]):
                scale = vol * fibre[i, k]
                for a in range(8):
                    pg = p[i, k, 0] * g[a, 0] + p[i, k, 1] * g[a, 1] + p[i, k, 2] * g[a, 2]
                    for c in range(3):
                        flat[3 * a + c] = p[i, k, c] * pg - g[a, c] / 3.0
                for r in range(24):
                    for c in range(r + 1):
                        matrix[r, c] += scale * flat[r] * flat[c]


@njit(cache=True)
def _gather_stiffness(nodes, matrices, first, offset, values):
    for cell in range(nodes.shape[0]):
        for a in range(8):
            for b in range(a + 1):
                for c in range(3):
                    for d in range(c + 1 if a == b else 3):
                        row, column = 3 * nodes[cell, a] + c, 3 * nodes[cell, b] + d
                        if row < column:
                            row, column = column, row
                        values[offset[row] + column - first[row]] += matrices[cell, 3 * a + c, 3 * b + d]


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
