r"""The discrete operator: viscous, volumetric and zero-energy forces as the exact adjoint of the velocity gradient.

The power is :math:`E = \tfrac12\sum_i V_i D_i:\sigma_i + E_0` with the zero-energy part

.. math:: E_0 = \tfrac12\sum_i\sum_j a_{ij}\, e_{ij}\cdot H_{ij}\,e_{ij}, \quad e_{ij} = v_j - v_i - L_i x_{ij}, \quad
   H_{ij} = \chi\eta_{23}V_i I + \frac{V_i}{\mathrm{tr}\,M_i}\Big[c_b (R + 2)^{5/6}\eta_{23}\,n n
   + c_f\sum_k s_k\,(m_k n)(m_k n)\Big],

so that each bond is held with the physical stiffness of the direction it violates (:math:`s_k = 4\eta_{23}(R-1)v_k`,
:math:`n = x_{ij}/|x_{ij}|`). With :math:`Q_i = \sum_j a_{ij}H_{ij}e_{ij}\otimes x_{ij}` and :math:`T_i = (V_i\sigma_i
- Q_i)M_i^{-1}`

.. math:: (A v)_i = \sum_j\big[-a_{ij}T_i x_{ij} - a_{ij}H_{ij}e_{ij} + a_{ji}T_j x_{ji} + a_{ji}H_{ji}e_{ji}\big].

The operator is symmetric and positive semi-definite by construction; free surfaces and slip walls are its natural
boundary condition; it conserves linear and angular momentum to round-off. Weights need not be symmetric: a row's forces
on its neighbours are scattered where they are worked out.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass, field

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.sph import single_direction
from ppmc.solver.sph.gradient import moment_inverses
from ppmc.solver.sph.reactions import add_reactions


@dataclass
class Operator:
    """The operator at one set of positions.

    Attributes
    ----------
    pairs : Pairs
    positions : ndarray, shape (n, 3)
        mm.
    volumes : ndarray, shape (n,)
        mm^3.
    inverse, trace, first
        Moments, see :func:`ppmc.solver.sph.gradient.moment_inverses`.
    shear : ndarray, shape (n,)
        eta23, Pa s.
    bulk : ndarray, shape (n,)
        Implicit bulk viscosity K J dt, Pa s; zero in the explicit integrator, where pressure is a given stress.
    fibre : ndarray, shape (n, k)
        4 eta23 (R - 1) v_k, Pa s.
    directions : ndarray, shape (n, k, 3)
        Unit fibre directions.
    control : ndarray, shape (n, 2 + k)
        Zero-energy stiffness: isotropic part, bond part, then one for each direction.
    """

    pairs: Pairs
    positions: np.ndarray
    volumes: np.ndarray
    inverse: np.ndarray
    trace: np.ndarray
    first: np.ndarray
    shear: np.ndarray
    bulk: np.ndarray
    fibre: np.ndarray
    directions: np.ndarray
    control: np.ndarray
    _work: list[np.ndarray] = field(default_factory=list, repr=False)

    def apply(self, velocities: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return A v, shape (n, 3), Pa mm^2: the force that the material opposes to the motion."""
        out = np.empty_like(velocities) if out is None else out
        p, blocks, window = self.pairs, self.pairs.blocks, self._windows()
        if self.directions.shape[1] <= 1:
            single_direction.stress_sweep(
                p.start, p.count, p.index, p.weight, self.positions, self.volumes, self.inverse, self.shear, self.bulk,
                self.fibre, self.directions, self.control, velocities, int(p.count.max(initial=0)),
                blocks.rows, blocks.low, blocks.offset, window, out,
            )  # fmt: skip
        else:
            _stress_sweep(
                p.start, p.count, p.index, p.weight, self.positions, self.volumes, self.inverse, self.shear, self.bulk,
                self.fibre, self.directions, self.control, velocities, int(p.count.max(initial=0)),
                blocks.rows, blocks.low, blocks.offset, window, out,
            )  # fmt: skip
        add_reactions(blocks.rows, blocks.low, blocks.offset, window, out)
        return out

    def stress_force(self, stress: np.ndarray) -> np.ndarray:
        """Return B^T S, shape (n, 3), Pa mm^2: the force opposed by given particle stresses.

        Parameters
        ----------
        stress : ndarray, shape (n, 3, 3)
            S_i = V_i sigma_i, symmetric, Pa mm^3.
        """
        return self._traction_force(stress @ self.inverse)

    def pressure_force(self, stress: np.ndarray) -> np.ndarray:
        """Return the same for isotropic stresses, shape (n,), Pa mm^3."""
        return self._traction_force(stress[:, None, None] * self.inverse)

    def _traction_force(self, traction: np.ndarray) -> np.ndarray:
        out, p, blocks, window = np.empty_like(self.positions), self.pairs, self.pairs.blocks, self._windows()
        _traction_sweep(
            p.start, p.count, p.index, p.weight, self.positions, self.volumes, traction, int(p.count.max(initial=0)),
            blocks.rows, blocks.low, blocks.offset, window, out,
        )  # fmt: skip
        add_reactions(blocks.rows, blocks.low, blocks.offset, window, out)
        return out

    def _windows(self) -> np.ndarray:
        # Made with the first product, and kept for the others.
        if not self._work:
            self._work = [np.empty((int(self.pairs.blocks.offset[-1]), 3))]
        return self._work[0]

    def diagonal(self) -> np.ndarray:
        """Return the 3x3 diagonal blocks as XX, YY, ZZ, XY, YZ, XZ, shape (n, 6), Pa s mm.

        Exact but for two parts that come from the neighbours' energies: the direction-weighted zero-energy control is
        taken bond by bond, and a neighbour is taken to see the particle with the weight with which it is seen, as it
        does where kernels are alike.
        """
        out = np.empty((len(self.positions), 6))
        p = self.pairs
        _diagonal_sweep(
            p.start, p.count, p.index, p.weight, self.positions, self.volumes, self.inverse, self.first, self.shear,
            self.bulk, self.fibre, self.directions, self.control, out,
        )  # fmt: skip
        return out


def assemble(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, shear: np.ndarray, bulk: np.ndarray, fibre: np.ndarray,
    directions: np.ndarray, isotropic: float = 1.0, bond: float = 2.0, along_fibre: float = 0.1,
    along_bond: np.ndarray | float = 0.0,
) -> Operator:  # fmt: skip
    r"""Make the operator at `positions`; the arguments are the attributes of :class:`Operator`.

    Parameters
    ----------
    isotropic, bond, along_fibre : float
        Zero-energy control: chi in units of the shear viscosity, c_b of :math:`(R + 2)^{5/6}\eta_{23}`, c_f of the
        fibre stiffness.
    along_bond : ndarray, shape (n,), or float
        Further stiffness along bonds, Pa s.
    """
    inverse, trace, first = moment_inverses(pairs, positions, volumes)
    control = np.empty((len(positions), 2 + fibre.shape[1]))
    along_bond = np.array(np.broadcast_to(along_bond, len(positions)))
    _control(volumes, trace, shear, fibre, isotropic, bond, along_fibre, along_bond, control)
    return Operator(pairs, positions, volumes, inverse, trace, first, shear, bulk, fibre, directions, control)


@njit(cache=True, parallel=True)
def _control(volume, trace, shear, fibre, isotropic, bond, along_fibre, along_bond, control):
    for i in prange(volume.shape[0]):
        per_trace = volume[i] / trace[i] if trace[i] > 0.0 else 0.0
        planar = 3.0 * shear[i]  # with the fibres (R + 2) eta23: what a planar random squeeze meets
        for k in range(fibre.shape[1]):
            planar += fibre[i, k] / 4.0
            control[i, 2 + k] = along_fibre * fibre[i, k] * per_trace
        control[i, 0] = isotropic * shear[i] * volume[i]
        control[i, 1] = (bond * (planar**5 * shear[i]) ** (1.0 / 6.0) + along_bond[i]) * per_trace


@njit(cache=True, parallel=True)
def _stress_sweep(
    start, count, index, weight, x, volume, inverse, shear, bulk, fibre, p, control, v, longest,
    rows, low, offset, window, out,
):  # fmt: skip
    # As ppmc.solver.sph.single_direction.stress_sweep, for any number of directions.
    n_directions = p.shape[1]
    for block in prange(rows.shape[0] - 1):
        window[offset[block] : offset[block + 1]] = 0.0
        shift = offset[block] - low[block]
        held, t = np.empty((longest, 3)), np.empty((3, 3))
        for i in range(rows[block], rows[block + 1]):
            x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
            v0, v1, v2 = v[i, 0], v[i, 1], v[i, 2]
            g00, g01, g02, g10, g11, g12, g20, g21, g22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for slot in range(start[i], start[i] + count[i]):
                j = index[slot]
                a = volume[j] * weight[slot]
                d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
                w0, w1, w2 = a * (v[j, 0] - v0), a * (v[j, 1] - v1), a * (v[j, 2] - v2)
                g00 += w0 * d0
                g01 += w0 * d1
                g02 += w0 * d2
                g10 += w1 * d0
                g11 += w1 * d1
                g12 += w1 * d2
                g20 += w2 * d0
                g21 += w2 * d1
                g22 += w2 * d2
            m = inverse[i]
            l00 = g00 * m[0, 0] + g01 * m[1, 0] + g02 * m[2, 0]
            l01 = g00 * m[0, 1] + g01 * m[1, 1] + g02 * m[2, 1]
            l02 = g00 * m[0, 2] + g01 * m[1, 2] + g02 * m[2, 2]
            l10 = g10 * m[0, 0] + g11 * m[1, 0] + g12 * m[2, 0]
            l11 = g10 * m[0, 1] + g11 * m[1, 1] + g12 * m[2, 1]
            l12 = g10 * m[0, 2] + g11 * m[1, 2] + g12 * m[2, 2]
            l20 = g20 * m[0, 0] + g21 * m[1, 0] + g22 * m[2, 0]
            l21 = g20 * m[0, 1] + g21 * m[1, 1] + g22 * m[2, 1]
            l22 = g20 * m[0, 2] + g21 * m[1, 2] + g22 * m[2, 2]
            third = (l00 + l11 + l22) / 3.0
            xy, yz, xz = 0.5 * (l01 + l10), 0.5 * (l12 + l21), 0.5 * (l02 + l20)
            eta2 = 2.0 * shear[i]
            hydro = 3.0 * bulk[i] * third
            s00, s11, s22 = eta2 * (l00 - third) + hydro, eta2 * (l11 - third) + hydro, eta2 * (l22 - third) + hydro
            s01, s12, s02 = eta2 * xy, eta2 * yz, eta2 * xz
            for k in range(n_directions):
                p0, p1, p2 = p[i, k, 0], p[i, k, 1], p[i, k, 2]
                along = (
                    l00 * p0 * p0 + l11 * p1 * p1 + l22 * p2 * p2
                    + 2.0 * (xy * p0 * p1 + yz * p1 * p2 + xz * p0 * p2) - third
                )  # fmt: skip
                along *= fibre[i, k]
                s00 += along * (p0 * p0 - 1.0 / 3.0)
                s11 += along * (p1 * p1 - 1.0 / 3.0)
                s22 += along * (p2 * p2 - 1.0 / 3.0)
                s01 += along * p0 * p1
                s12 += along * p1 * p2
                s02 += along * p0 * p2

            # Second pass over the same row: zero-energy force of i's own energy.
            c_iso, c_bond = control[i, 0], control[i, 1]
            q00, q01, q02, q10, q11, q12, q20, q21, q22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for slot in range(start[i], start[i] + count[i]):
                j = index[slot]
                a = volume[j] * weight[slot]
                d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
                e0 = v[j, 0] - v0 - (l00 * d0 + l01 * d1 + l02 * d2)
                e1 = v[j, 1] - v1 - (l10 * d0 + l11 * d1 + l12 * d2)
                e2 = v[j, 2] - v2 - (l20 * d0 + l21 * d1 + l22 * d2)
                per_r2 = 1.0 / (d0 * d0 + d1 * d1 + d2 * d2)
                bond = c_bond * (d0 * e0 + d1 * e1 + d2 * e2)
                h0, h1, h2 = bond * d0, bond * d1, bond * d2
                for k in range(n_directions):
                    p0, p1, p2 = p[i, k, 0], p[i, k, 1], p[i, k, 2]
                    pd = p0 * d0 + p1 * d1 + p2 * d2
                    n0, n1, n2 = p0 * pd - d0 / 3.0, p1 * pd - d1 / 3.0, p2 * pd - d2 / 3.0
                    along = control[i, 2 + k] * (n0 * e0 + n1 * e1 + n2 * e2)
                    h0 += along * n0
                    h1 += along * n1
                    h2 += along * n2
                h0, h1, h2 = (
                    a * (c_iso * e0 + per_r2 * h0),
                    a * (c_iso * e1 + per_r2 * h1),
                    a * (c_iso * e2 + per_r2 * h2),
                )
                held[slot - start[i], 0], held[slot - start[i], 1], held[slot - start[i], 2] = h0, h1, h2
                q00 += h0 * d0
                q01 += h0 * d1
                q02 += h0 * d2
                q10 += h1 * d0
                q11 += h1 * d1
                q12 += h1 * d2
                q20 += h2 * d0
                q21 += h2 * d1
                q22 += h2 * d2
            vol = volume[i]
            q00, q01, q02 = vol * s00 - q00, vol * s01 - q01, vol * s02 - q02
            q10, q11, q12 = vol * s01 - q10, vol * s11 - q11, vol * s12 - q12
            q20, q21, q22 = vol * s02 - q20, vol * s12 - q21, vol * s22 - q22
            for c in range(3):
                t[0, c] = q00 * m[0, c] + q01 * m[1, c] + q02 * m[2, c]
                t[1, c] = q10 * m[0, c] + q11 * m[1, c] + q12 * m[2, c]
                t[2, c] = q20 * m[0, c] + q21 * m[1, c] + q22 * m[2, c]
            _scatter(i, start[i], count[i], index, weight, x, volume, t, held, shift, window, out)


@njit(cache=True, parallel=True)
def _traction_sweep(start, count, index, weight, x, volume, traction, longest, rows, low, offset, window, out):
    for block in prange(rows.shape[0] - 1):
        window[offset[block] : offset[block + 1]] = 0.0
        held = np.zeros((longest, 3))
        for i in range(rows[block], rows[block + 1]):
            _scatter(
                i, start[i], count[i], index, weight, x, volume, traction[i], held, offset[block] - low[block],
                window, out,
            )  # fmt: skip


@njit(cache=True)
def _scatter(i, begin, neighbours, index, weight, x, volume, t, held, shift, window, out):
    # Forces on the bonds of row i, those of its traction and others that are held: out of the row, into the window.
    f0, f1, f2 = 0.0, 0.0, 0.0
    for s in range(neighbours):
        j = index[begin + s]
        a = volume[j] * weight[begin + s]
        d0, d1, d2 = a * (x[j, 0] - x[i, 0]), a * (x[j, 1] - x[i, 1]), a * (x[j, 2] - x[i, 2])
        h0 = held[s, 0] + t[0, 0] * d0 + t[0, 1] * d1 + t[0, 2] * d2
        h1 = held[s, 1] + t[1, 0] * d0 + t[1, 1] * d1 + t[1, 2] * d2
        h2 = held[s, 2] + t[2, 0] * d0 + t[2, 1] * d1 + t[2, 2] * d2
        f0 += h0
        f1 += h1
        f2 += h2
        window[j + shift, 0] += h0
        window[j + shift, 1] += h1
        window[j + shift, 2] += h2
    out[i, 0], out[i, 1], out[i, 2] = -f0, -f1, -f2


@njit(cache=True)
def _add_gradient_block(block, scale, g, shear, bulk, fibre, p):
    # Power of the velocity gradient c (x) g, as a quadratic form in c.
    g2 = g[0] * g[0] + g[1] * g[1] + g[2] * g[2]
    for r in range(3):
        block[r, r] += scale * shear * g2
        for c in range(3):
            block[r, c] += scale * (shear / 3.0 + bulk) * g[r] * g[c]
    for k in range(p.shape[0]):
        pg = p[k, 0] * g[0] + p[k, 1] * g[1] + p[k, 2] * g[2]
        for r in range(3):
            mr = p[k, r] * pg - g[r] / 3.0
            for c in range(3):
                block[r, c] += scale * fibre[k] * mr * (p[k, c] * pg - g[c] / 3.0)


@njit(cache=True)
def add_bond_block(block, scale, d, control, p):
    """Add to a block (3, 3) the stiffness with which the control (2 + k,) of a particle holds the bond d (3,)."""
    per_r2 = 1.0 / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    for r in range(3):
        block[r, r] += scale * control[0]
        for c in range(3):
            block[r, c] += scale * control[1] * per_r2 * d[r] * d[c]
    for k in range(p.shape[0]):
        pd = p[k, 0] * d[0] + p[k, 1] * d[1] + p[k, 2] * d[2]
        for r in range(3):
            nr = p[k, r] * pd - d[r] / 3.0
            for c in range(3):
                block[r, c] += scale * control[2 + k] * per_r2 * nr * (p[k, c] * pd - d[c] / 3.0)


@njit(cache=True, parallel=True)
def _diagonal_sweep(start, count, index, weight, x, volume, inverse, first, shear, bulk, fibre, p, control, out):
    for i in prange(x.shape[0]):
        block = np.zeros((3, 3))
        d, y, g = np.empty(3), np.empty(3), np.empty(3)
        for c in range(3):
            g[c] = inverse[i, c, 0] * first[i, 0] + inverse[i, c, 1] * first[i, 1] + inverse[i, c, 2] * first[i, 2]
        _add_gradient_block(block, volume[i], g, shear[i], bulk[i], fibre[i], p[i])
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            for c in range(3):
                d[c] = x[i, c] - x[j, c]
            a_own = volume[j] * weight[slot]
            a_other = volume[i] * weight[slot]
            own = 1.0 + g[0] * d[0] + g[1] * d[1] + g[2] * d[2]
            add_bond_block(block, a_own * own * own, d, control[i], p[i])
            along = 0.0
            for c in range(3):
                y[c] = a_other * (inverse[j, c, 0] * d[0] + inverse[j, c, 1] * d[1] + inverse[j, c, 2] * d[2])
                along += y[c] * d[c]
            _add_gradient_block(block, volume[j], y, shear[j], bulk[j], fibre[j], p[j])
            add_bond_block(block, a_other * max(0.0, 1.0 - along), d, control[j], p[j])
        out[i, 0], out[i, 1], out[i, 2] = block[0, 0], block[1, 1], block[2, 2]
        out[i, 3], out[i, 4], out[i, 5] = block[0, 1], block[1, 2], block[0, 2]
