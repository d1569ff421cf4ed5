r"""The operator's product for at most one fibre direction a particle, written so that it vectorises.

The same sums as in :mod:`ppmc.solver.sph.operator`, row by row: a row's neighbours are first copied into short buffers,
one a component, and all arithmetic then runs over these. The energy of row i opposes the motion of i by the sum of

.. math:: -\phi_{ij} = -a_{ij}\,(T_i x_{ij} + H_{ij} e_{ij})

and that of its neighbour j by :math:`+\phi_{ij}`: the force on a bond is worked out once, where all that it needs is
at hand, and added to the neighbour there and then.

To keep that free of races and of any dependence on the number of threads, rows are taken in blocks that follow from
the neighbour list alone (:class:`ppmc.solver.particles.neighbours.Blocks`). Each block sums its reactions in a window
of its own, and the windows are added in the order of the blocks.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.sph.gradient import FAST, sum_products

# As in ppmc.solver.sph.gradient, only plain sums may be taken in another order than the one written.


@njit(cache=True, fastmath=FAST)
def _sum_plain_products(ha, hb, hc, da, db, dc, m):
    """Sums over the row of h (x) d."""
    q00, q01, q02, q10, q11, q12, q20, q21, q22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for s in range(m):
        q00 += ha[s] * da[s]
        q01 += ha[s] * db[s]
        q02 += ha[s] * dc[s]
        q10 += hb[s] * da[s]
        q11 += hb[s] * db[s]
        q12 += hb[s] * dc[s]
        q20 += hc[s] * da[s]
        q21 += hc[s] * db[s]
        q22 += hc[s] * dc[s]
    return q00, q01, q02, q10, q11, q12, q20, q21, q22


@njit(cache=True, fastmath=FAST)
def _sum_components(ha, hb, hc, m):
    f0, f1, f2 = 0.0, 0.0, 0.0
    for s in range(m):
        f0 += ha[s]
        f1 += hb[s]
        f2 += hc[s]
    return f0, f1, f2


@njit(cache=True, parallel=True)
def stress_sweep(
    start, count, index, weight, x, volume, inverse, shear, bulk, fibre, p, control, v, longest,
    rows, low, offset, window, out, given=None,
):  # fmt: skip
    """Force of each row's energy: on the row itself into `out`, on its neighbours into the windows of the blocks.

    `given`, shape (n,), is an isotropic stress that acts beside the viscous one.
    """
    for block in prange(rows.shape[0] - 1):
        window[offset[block] : offset[block + 1]] = 0.0
        shift = offset[block] - low[block]
        da, db, dc, wa, wb, wc, aa, ha, hb, hc = (
            np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest),
            np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest),
        )  # fmt: skip
        for i in range(rows[block], rows[block + 1]):
            x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
            v0, v1, v2 = v[i, 0], v[i, 1], v[i, 2]
            begin, m = start[i], count[i]
            for s in range(m):
                j = np.uint32(index[begin + s])
                aa[s] = volume[j] * weight[begin + s]
                da[s] = x[j, 0] - x0
                db[s] = x[j, 1] - x1
                dc[s] = x[j, 2] - x2
                wa[s] = v[j, 0] - v0
                wb[s] = v[j, 1] - v1
                wc[s] = v[j, 2] - v2
            g00, g01, g02, g10, g11, g12, g20, g21, g22 = sum_products(wa, wb, wc, aa, da, db, dc, m)
            i00, i01, i02 = inverse[i, 0, 0], inverse[i, 0, 1], inverse[i, 0, 2]
            i11, i12, i22 = inverse[i, 1, 1], inverse[i, 1, 2], inverse[i, 2, 2]
            l00 = g00 * i00 + g01 * i01 + g02 * i02
            l01 = g00 * i01 + g01 * i11 + g02 * i12
            l02 = g00 * i02 + g01 * i12 + g02 * i22
            l10 = g10 * i00 + g11 * i01 + g12 * i02
            l11 = g10 * i01 + g11 * i11 + g12 * i12
            l12 = g10 * i02 + g11 * i12 + g12 * i22
            l20 = g20 * i00 + g21 * i01 + g22 * i02
            l21 = g20 * i01 + g21 * i11 + g22 * i12
            l22 = g20 * i02 + g21 * i12 + g22 * i22
            p0, p1, p2, stiff, c_fibre = 0.0, 0.0, 0.0, 0.0, 0.0
            if p.shape[1] == 1:
                p0, p1, p2 = p[i, 0, 0], p[i, 0, 1], p[i, 0, 2]
                stiff, c_fibre = fibre[i, 0], control[i, 2]
            c_iso, c_bond = control[i, 0], control[i, 1]
            third = (l00 + l11 + l22) / 3.0
            xy, yz, xz = 0.5 * (l01 + l10), 0.5 * (l12 + l21), 0.5 * (l02 + l20)
            along = (
                l00 * p0 * p0 + l11 * p1 * p1 + l22 * p2 * p2
                + 2.0 * (xy * p0 * p1 + yz * p1 * p2 + xz * p0 * p2) - third
            ) * stiff  # fmt: skip
            eta2 = 2.0 * shear[i]
            hydro = 3.0 * bulk[i] * third - along / 3.0 - eta2 * third
            if given is not None:
                hydro += given[i]
            s00 = eta2 * l00 + hydro + along * p0 * p0
            s11 = eta2 * l11 + hydro + along * p1 * p1
            s22 = eta2 * l22 + hydro + along * p2 * p2
            s01, s12, s02 = eta2 * xy + along * p0 * p1, eta2 * yz + along * p1 * p2, eta2 * xz + along * p0 * p2

            # Zero-energy force of the row's own energy: h = a (c_iso e + u d + t p).
            for s in range(m):
                d0, d1, d2, a = da[s], db[s], dc[s], aa[s]
                e0 = wa[s] - (l00 * d0 + l01 * d1 + l02 * d2)
                e1 = wb[s] - (l10 * d0 + l11 * d1 + l12 * d2)
                e2 = wc[s] - (l20 * d0 + l21 * d1 + l22 * d2)
                per_r2 = a / (d0 * d0 + d1 * d1 + d2 * d2)
                de = d0 * e0 + d1 * e1 + d2 * e2
                pd = p0 * d0 + p1 * d1 + p2 * d2
                pe = p0 * e0 + p1 * e1 + p2 * e2
                ne = per_r2 * c_fibre * (pd * pe - de / 3.0)
                u = per_r2 * c_bond * de - ne / 3.0
                t = ne * pd
                c = a * c_iso
                h0, h1, h2 = c * e0 + u * d0 + t * p0, c * e1 + u * d1 + t * p1, c * e2 + u * d2 + t * p2
                ha[s], hb[s], hc[s] = h0, h1, h2
            q00, q01, q02, q10, q11, q12, q20, q21, q22 = _sum_plain_products(ha, hb, hc, da, db, dc, m)
            vol = volume[i]
            q00, q01, q02 = vol * s00 - q00, vol * s01 - q01, vol * s02 - q02
            q10, q11, q12 = vol * s01 - q10, vol * s11 - q11, vol * s12 - q12
            q20, q21, q22 = vol * s02 - q20, vol * s12 - q21, vol * s22 - q22
            t00 = q00 * i00 + q01 * i01 + q02 * i02
            t01 = q00 * i01 + q01 * i11 + q02 * i12
            t02 = q00 * i02 + q01 * i12 + q02 * i22
            t10 = q10 * i00 + q11 * i01 + q12 * i02
            t11 = q10 * i01 + q11 * i11 + q12 * i12
            t12 = q10 * i02 + q11 * i12 + q12 * i22
            t20 = q20 * i00 + q21 * i01 + q22 * i02
            t21 = q20 * i01 + q21 * i11 + q22 * i12
            t22 = q20 * i02 + q21 * i12 + q22 * i22
            # Forces on the bonds: out of the row, into the window.
            for s in range(m):
                d0, d1, d2 = aa[s] * da[s], aa[s] * db[s], aa[s] * dc[s]
                ha[s] += t00 * d0 + t01 * d1 + t02 * d2
                hb[s] += t10 * d0 + t11 * d1 + t12 * d2
                hc[s] += t20 * d0 + t21 * d1 + t22 * d2
            f0, f1, f2 = _sum_components(ha, hb, hc, m)
            out[i, 0], out[i, 1], out[i, 2] = -f0, -f1, -f2
            for s in range(m):
                j = np.uint32(index[begin + s] + shift)
                window[j, 0] += ha[s]
                window[j, 1] += hb[s]
                window[j, 2] += hc[s]
