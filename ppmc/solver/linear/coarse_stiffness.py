r"""Stiffness of the coarse grid: the Galerkin product of the operator, particle by particle.

For a particle i and a function :math:`\phi_a` of the grid let :math:`\delta_{j,a} = \phi_a(x_j) - \phi_a(x_i)`. The
particle's own gradient and what its zero-energy control sees of that function are

.. math:: g_a = \sum_j a_{ij}\,\delta_{j,a}\,M_i^{-1}x_{ij}, \qquad \psi_{j,a} = \delta_{j,a} - g_a\cdot x_{ij},

and with the tensor of its material and the mean control :math:`\bar H_i` of its pairs it adds

.. math:: V_i\,(e_c\otimes g_a) : \mathbb{C}_i : (e_d\otimes g_b)
   + \bar H_{i,cd}\sum_j a_{ij}\,\psi_{j,a}\psi_{j,b}.

The mean in place of each pair's own control saves a factor of six in the work. Pairs that reach beyond the cells next
to the particle's are left out; every term is a square, so that the sum stays positive.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.sph.gradient import FAST
from ppmc.solver.sph.operator import add_bond_block

SIDE = 4  # nodes of a box along an axis: those of a cell and of the cells next to it
BOX = SIDE**3


@njit(cache=True, inline="always")
def trilinear(local, phi):
    """Values of a cell's eight functions at a place in it."""
    for corner in range(8):
        wx = local[0] if corner & 4 else 1.0 - local[0]
        wy = local[1] if corner & 2 else 1.0 - local[1]
        wz = local[2] if corner & 1 else 1.0 - local[2]
        phi[corner] = wx * wy * wz


@njit(cache=True, parallel=True)
def add_stiffness(
    cells, order, begin, cell_of, site, local, boxes, start, count, index, weight, x, volume, inverse, shear, bulk,
    fibre, p, control, inertia, place, hold, longest, first, offset, values,
):  # fmt: skip
    """Add to the skyline what the particles of `cells` contribute; the boxes of these have no node in common."""
    for turn in prange(cells.shape[0]):
        cell = cells[turn]
        matrix = np.zeros((3 * BOX, 3 * BOX))
        near, a = np.empty(longest, np.int64), np.empty(longest)
        d, y = np.empty((3, longest)), np.empty((3, longest))
        low, wide, mean = np.empty(3, np.int64), np.empty(3, np.int64), np.empty((3, 3))
        delta, g, number = np.empty((BOX, longest)), np.empty((BOX, 3)), np.empty(BOX, np.int64)
        f, phi = np.empty((BOX, 3, p.shape[1])), np.empty(8)
        for at in range(begin[cell], begin[cell + 1]):
            i = np.int64(order[at])
            row = slice(start[i], start[i] + count[i])
            m = _pairs_within(
                i, index[row], weight[row], x, volume, cell_of, site, site[cell], near, a, d, low, wide
            )  # fmt: skip
            _mean_control(a, d, m, control[i], p[i], mean)
            for c in range(3):
                for s in range(m):
                    y[c, s] = a[s] * (
                        inverse[i, c, 0] * d[0, s] + inverse[i, c, 1] * d[1, s] + inverse[i, c, 2] * d[2, s]
                    )
            nodes = _differences(i, near, m, cell_of, site, site[cell], local, low, wide, phi, delta, number)
            for node in range(nodes):
                for c in range(3):
                    g[node, c] = _product(delta[node], y[c], m)
                for s in range(m):
                    delta[node, s] -= g[node, 0] * d[0, s] + g[node, 1] * d[1, s] + g[node, 2] * d[2, s]
            eta, lame = volume[i] * shear[i], volume[i] * (bulk[i] - 2.0 / 3.0 * shear[i])
            _add_particle(nodes, number, delta, a, m, g, f, mean, eta, lame, volume[i], fibre[i], p[i], matrix)
            if place[i] >= 0 or inertia[i] > 0.0:
                trilinear(local[i], phi)
                _add_point(phi, inertia[i], hold, place[i], matrix)
        _add_box(boxes[cell], matrix, first, offset, values)


@njit(cache=True)
def _pairs_within(i, index, weight, x, volume, cell_of, site, here, near, a, d, low, wide):
    # Pairs within the cells next to this one, and the range of nodes that these see.
    high = np.array([1, 1, 1])
    low[:] = 1
    m = 0
    for slot in range(index.shape[0]):
        j = np.int64(index[slot])
        there = site[cell_of[j]]
        o0, o1, o2 = there[0] - here[0] + 1, there[1] - here[1] + 1, there[2] - here[2] + 1
        if min(o0, o1, o2) < 0 or max(o0, o1, o2) > 2:
            continue
        low[0], low[1], low[2] = min(low[0], o0), min(low[1], o1), min(low[2], o2)
        high[0], high[1], high[2] = max(high[0], o0), max(high[1], o1), max(high[2], o2)
        near[m], a[m] = j, volume[j] * weight[slot]
        d[0, m], d[1, m], d[2, m] = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        m += 1
    for c in range(3):
        wide[c] = high[c] - low[c] + 2
    return m


@njit(cache=True)
def _mean_control(a, d, m, control, p, mean):
    total = 0.0
    mean[:] = 0.0
    for s in range(m):
        total += a[s]
        add_bond_block(mean, a[s], d[:, s], control, p)
    mean /= max(total, 1e-300)


@njit(cache=True)
def _differences(i, near, m, cell_of, site, here, local, low, wide, phi, delta, number):
    # Rows of delta are the nodes seen, number[row] their places in the box of the cell.
    nodes = wide[0] * wide[1] * wide[2]
    for node in range(nodes):
        k0, k1, k2 = node // (wide[1] * wide[2]), node // wide[2] % wide[1], node % wide[2]
        number[node] = ((low[0] + k0) * SIDE + low[1] + k1) * SIDE + low[2] + k2
        delta[node, :m] = 0.0
    trilinear(local[i], phi)
    for corner in range(8):
        node = _node(1 - low[0], 1 - low[1], 1 - low[2], corner, wide)
        for s in range(m):
            delta[node, s] -= phi[corner]
    for s in range(m):
        there = site[cell_of[near[s]]]
        o0, o1, o2 = there[0] - here[0] + 1 - low[0], there[1] - here[1] + 1 - low[1], there[2] - here[2] + 1 - low[2]
        trilinear(local[near[s]], phi)
        for corner in range(8):
            delta[_node(o0, o1, o2, corner, wide), s] += phi[corner]
    return nodes


@njit(cache=True, inline="always")
def _node(o0, o1, o2, corner, wide):
    return ((o0 + (corner >> 2)) * wide[1] + o1 + ((corner >> 1) & 1)) * wide[2] + o2 + (corner & 1)


@njit(cache=True)
def _add_particle(nodes, number, psi, a, m, g, f, mean, eta, lame, volume, fibre, p, matrix):
    for node in range(nodes):
        for k in range(p.shape[0]):
            pg = p[k, 0] * g[node, 0] + p[k, 1] * g[node, 1] + p[k, 2] * g[node, 2]
            for c in range(3):
                f[node, c, k] = p[k, c] * pg - g[node, c] / 3.0
    for na in range(nodes):
        for nb in range(na + 1):
            left = _weighted_product(psi[na], psi[nb], a, m)
            both = eta * (g[na, 0] * g[nb, 0] + g[na, 1] * g[nb, 1] + g[na, 2] * g[nb, 2])
            for c in range(3):
                for e in range(3):
                    entry = left * mean[c, e] + eta * g[na, e] * g[nb, c] + lame * g[na, c] * g[nb, e]
                    if c == e:
                        entry += both
                    for k in range(p.shape[0]):
                        entry += volume * fibre[k] * f[na, c, k] * f[nb, e, k]
                    matrix[3 * number[na] + c, 3 * number[nb] + e] += entry


@njit(cache=True)
def _add_point(phi, inertia, hold, held, matrix):
    # Inertia, drag and hold act on the particle itself, which sees the nodes of its own cell.
    for ca in range(8):
        na = (((ca >> 2) + 1) * SIDE + ((ca >> 1) & 1) + 1) * SIDE + (ca & 1) + 1
        for cb in range(ca + 1):
            nb = (((cb >> 2) + 1) * SIDE + ((cb >> 1) & 1) + 1) * SIDE + (cb & 1) + 1
            share = phi[ca] * phi[cb]
            for c in range(3):
                matrix[3 * na + c, 3 * nb + c] += share * inertia
                if held >= 0:
                    for e in range(3):
                        matrix[3 * na + c, 3 * nb + e] += share * hold[held, c, e]


@njit(cache=True)
def _add_box(box, matrix, first, offset, values):
    for na in range(BOX):
        for nb in range(na + 1):
            if box[na] < 0 or box[nb] < 0:
                continue
            for c in range(3):
                for e in range(c + 1 if na == nb else 3):
                    row, column = 3 * box[na] + c, 3 * box[nb] + e
                    if row < column:
                        row, column = column, row
                    values[offset[row] + column - first[row]] += matrix[3 * na + c, 3 * nb + e]


@njit(cache=True, fastmath=FAST)
def _product(a, b, m):
    total = 0.0
    for s in range(m):
        total += a[s] * b[s]
    return total


@njit(cache=True, fastmath=FAST)
def _weighted_product(a, b, weight, m):
    total = 0.0
    for s in range(m):
        total += weight[s] * a[s] * b[s]
    return total
