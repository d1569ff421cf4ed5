r"""Stiffness of the grid's velocities: matrix, fibres and volume, cell by cell.

With gradients :math:`g_a` of a cell's functions and weights w of its sub-points the matrix (J5's isotropic part) is
summed over sub-points. A fibre resists the *mean* strain of its share of a cell,

.. math:: \sum_s W_s\,4\eta_{23}(R - 1)v_k\,(\bar D_s : m_k)^2, \qquad \bar D_s = \frac1{W_s}\sum_{q \in s} w_q D_q .

In cells of one direction there is nothing to slide over, and every sub-point resists by itself: means alone would leave
strains free that turn within a share. Volume is kept in the mean and the first moments of a cell: :math:`p = K(J - 1) +
\kappa\,\operatorname{div} v`, both projected onto linear functions of the cell's material (the mean alone where a cell
holds little). Discontinuous linear pressures and triquadratic velocities are a stable pair. What is not body inside the
cells has a share `AIR` of the viscosity and no volume to keep, so that nodes at the rim have a velocity.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.grid.body import Body
from ppmc.solver.grid.shapes import NODES, POINTS, sub_points

AIR = 1e-3  # viscosity of what is not body, in parts of eta23
LINEAR_FROM = 0.5  # filling of a cell from which on volume is kept in its first moments as well
LIKE = 0.94  # squared cosine from which on directions are alike: 14 degrees
MOMENTS = 4
CHUNK = 128  # cells whose matrices are held at a time
BLOCKS = NODES * (NODES + 1) // 2


@dataclass(frozen=True)
class Material:
    """What the particles are made of.

    Attributes
    ----------
    shear : ndarray, shape (n,)
        eta23, Pa s.
    fibre : ndarray, shape (n, k)
        4 eta23 (R - 1) v_k, Pa s.
    directions : ndarray, shape (n, k, 3)
    bulk : ndarray, shape (n,)
        Stiffness against changes of volume, Pa s.
    """

    shear: np.ndarray
    fibre: np.ndarray
    directions: np.ndarray
    bulk: np.ndarray


@dataclass(frozen=True)
class Stiffness:
    """The stiffness, as the upper blocks of a block-sparse symmetric matrix, and what it was made of.

    Attributes
    ----------
    body : Body
    material : Material
    gradient : ndarray, shape (shares, 27, 3)
        Mean gradients of the cell's functions over each share, 1/mm.
    volume : ndarray, shape (shares,)
        mm^3.
    moments : ndarray, shape (cells, 4, 81)
        Divergence of each function times one and the local coordinates, summed over the body, mm^2.
    inverse : ndarray, shape (cells, 4, 4)
        Inverse of the inner products of these, 1/mm^3; zero where only the mean counts.
    bulk : ndarray, shape (cells,)
        Pa s.
    pure : ndarray, shape (cells,), bool
        Cells of one direction.
    indices, pointers : ndarray
        Columns of the blocks, and where each row of blocks begins.
    slots : ndarray, shape (cells, 378)
        Where the upper blocks of a cell's matrix are added.
    data : ndarray, shape (blocks, 3, 3)
        Pa s mm.
    """

    body: Body
    material: Material
    gradient: np.ndarray
    volume: np.ndarray
    moments: np.ndarray
    inverse: np.ndarray
    bulk: np.ndarray
    pure: np.ndarray
    indices: np.ndarray
    pointers: np.ndarray
    slots: np.ndarray
    data: np.ndarray

    def pressure_load(self, excess: np.ndarray) -> np.ndarray:
        """Load, shape (nodes, 3), Pa mm^2, of stresses `excess` (n,), Pa: K (J - 1), positive where swollen."""
        body, out = self.body, np.zeros((self.body.grid.node_count, 3))
        local, _ = sub_points()
        phi = np.concatenate([np.ones((POINTS, 1)), local], axis=1)
        values = np.where(body.share >= 0, excess[body.particle][np.maximum(body.share, 0)], 0.0)
        held = np.einsum("cq,cq,qm->cm", body.weight, values, phi)
        nodal = -np.einsum("cm,cmk,cka->ca", held, self.inverse, self.moments)
        np.add.at(out, body.grid.nodes.ravel(), nodal.reshape(-1, 3))
        return out


def make_stiffness(body: Body, material: Material) -> Stiffness:
    """Sum the stiffness of a body."""
    grid = body.grid
    upper = np.array([(a, b) for a in range(NODES) for b in range(a + 1)])
    one, other = grid.nodes[:, upper[:, 0]], grid.nodes[:, upper[:, 1]]
    keys = np.minimum(one, other) * grid.node_count + np.maximum(one, other)
    found, slots = np.unique(keys, return_inverse=True)
    slots = slots.reshape(keys.shape)
    rows = found // grid.node_count
    pointers = np.searchsorted(rows, np.arange(grid.node_count + 1))
    cells, shares = len(grid.site), len(body.particle)
    gradient, volume = np.zeros((shares, NODES, 3)), np.zeros(shares)
    moments, inverse = np.zeros((cells, MOMENTS, 3 * NODES)), np.zeros((cells, MOMENTS, MOMENTS))
    bulk, pure, data = np.zeros(cells), np.zeros(cells, dtype=bool), np.zeros((len(found), 3, 3))
    local, reference = sub_points()
    size = grid.size
    for begin in range(0, cells, CHUNK):
        chunk = np.arange(begin, min(begin + CHUNK, cells))
        matrices = np.zeros((len(chunk), 3 * NODES, 3 * NODES))
        _cells(
            chunk, size, local, reference, body.share, body.weight, body.start, body.particle, material.shear,
            material.fibre, material.directions, material.bulk, gradient, volume, moments, inverse, bulk, pure,
            matrices,
        )  # fmt: skip
        _add_matrices(matrices, grid.nodes[chunk], upper, slots[chunk], data)
    return Stiffness(
        body, material, gradient, volume, moments, inverse, bulk, pure, found % grid.node_count, pointers, slots, data
    )  # fmt: skip


@njit(cache=True, parallel=True)
def _cells(
    chunk, size, local, reference, share, weight, start, particle, shear, fibre, p, stiff, gradient, volume, moments,
    inverse, bulk, pure, matrices,
):  # fmt: skip
    for turn in prange(chunk.shape[0]):
        cell = chunk[turn]
        g, t, k = np.empty((POINTS, 3 * NODES)), np.zeros((3 * NODES, 3 * NODES)), matrices[turn]
        whole = size[cell, 0] * size[cell, 1] * size[cell, 2]
        mean, filled, lead = 0.0, 0.0, 0.0
        for s in range(start[cell], start[cell + 1]):
            mean += shear[particle[s]]
        mean /= max(start[cell + 1] - start[cell], 1)
        m = np.zeros((MOMENTS, MOMENTS))
        phi = np.ones(MOMENTS)
        for q in range(POINTS):
            for a in range(NODES):
                for c in range(3):
                    g[q, 3 * a + c] = 2.0 / size[cell, c] * reference[q, a, c]
            s, w = share[cell, q], weight[cell, q]
            eta = AIR * mean * whole / POINTS
            if s >= 0:
                i = particle[s]
                eta = w * shear[i]
                filled += w
                lead += w * stiff[i]
                volume[s] += w
                for c in range(3):
                    phi[1 + c] = local[q, c]
                for r in range(MOMENTS):
                    for c in range(MOMENTS):
                        m[r, c] += w * phi[r] * phi[c]
                    for a in range(3 * NODES):
                        moments[cell, r, a] += w * phi[r] * g[q, a]
                for a in range(NODES):
                    for c in range(3):
                        gradient[s, a, c] += w * g[q, 3 * a + c]
            for a in range(3 * NODES):
                ya = eta * g[q, a]
                for b in range(a + 1):
                    t[a, b] += ya * g[q, b]
        for a in range(3 * NODES):
            for b in range(a):
                t[b, a] = t[a, b]
        for a in range(NODES):
            for b in range(NODES):
                both = t[3 * a, 3 * b] + t[3 * a + 1, 3 * b + 1] + t[3 * a + 2, 3 * b + 2]
                for c in range(3):
                    for d in range(3):
                        k[3 * a + c, 3 * b + d] = t[3 * a + d, 3 * b + c] - 2.0 / 3.0 * t[3 * a + c, 3 * b + d]
                    k[3 * a + c, 3 * b + c] += both
        f = np.empty(3 * NODES)
        pure[cell] = _is_pure(start[cell], start[cell + 1], particle, p)
        if pure[cell]:
            for q in range(POINTS):
                if share[cell, q] >= 0:
                    i = particle[share[cell, q]]
                    for n in range(p.shape[1]):
                        _along(g[q], p[i, n], f)
                        _add_square(k, weight[cell, q] * fibre[i, n], f)
        for s in range(start[cell], start[cell + 1]):
            i = particle[s]
            per = 1.0 / max(volume[s], 1e-300)
            for a in range(NODES):
                for c in range(3):
                    gradient[s, a, c] *= per
            if not pure[cell]:
                for n in range(p.shape[1]):
                    _along(gradient[s].copy().reshape(3 * NODES), p[i, n], f)
                    _add_square(k, volume[s] * fibre[i, n], f)
        if filled <= 0.0:
            continue
        bulk[cell] = lead / filled
        if filled < LINEAR_FROM * whole:
            inverse[cell, 0, 0] = 1.0 / filled
        else:
            inverse[cell] = np.linalg.inv(m)
        for r in range(MOMENTS):
            for c in range(MOMENTS):
                part = bulk[cell] * inverse[cell, r, c]
                if part != 0.0:
                    for a in range(3 * NODES):
                        ya = part * moments[cell, r, a]
                        for b in range(3 * NODES):
                            k[a, b] += ya * moments[cell, c, b]


@njit(cache=True)
def _is_pure(begin, end, particle, p):
    """Whether all shares of a cell have the directions of its first."""
    for s in range(begin + 1, end):
        for n in range(p.shape[1]):
            one, other = p[particle[begin], n], p[particle[s], n]
            cosine = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
            if cosine * cosine < LIKE:
                return False
    return True


@njit(cache=True)
def _along(g, p, f):
    """Strain along p, the mean of three directions taken off, for a unit of each of a cell's unknowns."""
    for a in range(NODES):
        along = p[0] * g[3 * a] + p[1] * g[3 * a + 1] + p[2] * g[3 * a + 2]
        for c in range(3):
            f[3 * a + c] = p[c] * along - g[3 * a + c] / 3.0


@njit(cache=True)
def _add_square(k, factor, f):
    for a in range(f.shape[0]):
        fa = factor * f[a]
        for b in range(f.shape[0]):
            k[a, b] += fa * f[b]


@njit(cache=True)
def _add_matrices(matrices, nodes, upper, slots, data):
    for cell in range(matrices.shape[0]):
        for pair in range(upper.shape[0]):
            a, b = upper[pair, 0], upper[pair, 1]
            if nodes[cell, a] > nodes[cell, b]:
                a, b = b, a
            for c in range(3):
                for d in range(3):
                    data[slots[cell, pair], c, d] += matrices[cell, 3 * a + c, 3 * b + d]
