"""The operator's two sweeps for at most one fibre direction a particle, written so that they vectorise.

The same sums as in :mod:`ppmc.solver.operator`, row by row: a row's neighbours are first copied into short buffers,
one a component, and all arithmetic then runs over these. The order of the sums depends on the neighbour list alone.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange

FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}  # never nnan or ninf
CHUNK = 64  # rows that share their buffers
PACKED = 30  # numbers of a neighbour that the second sweep needs


@njit(cache=True, parallel=True, fastmath=FAST)
def stress_sweep(
    start, count, index, weight, x, volume, inverse, first, shear, bulk, fibre, p, control, v, longest, packed, out
):
    """Velocity gradients and tractions into `packed`, the force of each row's own energy into `out`."""
    n = x.shape[0]
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        da, db, dc, wa, wb, wc, aa = (
            np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest),
            np.empty(longest), np.empty(longest),
        )  # fmt: skip
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
            v0, v1, v2 = v[i, 0], v[i, 1], v[i, 2]
            begin, m = start[i], count[i]
            for s in range(m):
                j = index[begin + s]
                aa[s] = volume[j] * weight[begin + s]
                da[s] = x[j, 0] - x0
                db[s] = x[j, 1] - x1
                dc[s] = x[j, 2] - x2
                wa[s] = v[j, 0] - v0
                wb[s] = v[j, 1] - v1
                wc[s] = v[j, 2] - v2
            g00, g01, g02, g10, g11, g12, g20, g21, g22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for s in range(m):
                d0, d1, d2 = aa[s] * da[s], aa[s] * db[s], aa[s] * dc[s]
                g00 += wa[s] * d0
                g01 += wa[s] * d1
                g02 += wa[s] * d2
                g10 += wb[s] * d0
                g11 += wb[s] * d1
                g12 += wb[s] * d2
                g20 += wc[s] * d0
                g21 += wc[s] * d1
                g22 += wc[s] * d2
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
            s00 = eta2 * l00 + hydro + along * p0 * p0
            s11 = eta2 * l11 + hydro + along * p1 * p1
            s22 = eta2 * l22 + hydro + along * p2 * p2
            s01, s12, s02 = eta2 * xy + along * p0 * p1, eta2 * yz + along * p1 * p2, eta2 * xz + along * p0 * p2

            # Zero-energy force of the row's own energy: h = a (c_iso e + u d + t p).
            q00, q01, q02, q10, q11, q12, q20, q21, q22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            f0, f1, f2 = 0.0, 0.0, 0.0
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
                f0 -= h0
                f1 -= h1
                f2 -= h2
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
            t00 = q00 * i00 + q01 * i01 + q02 * i02
            t01 = q00 * i01 + q01 * i11 + q02 * i12
            t02 = q00 * i02 + q01 * i12 + q02 * i22
            t10 = q10 * i00 + q11 * i01 + q12 * i02
            t11 = q10 * i01 + q11 * i11 + q12 * i12
            t12 = q10 * i02 + q11 * i12 + q12 * i22
            t20 = q20 * i00 + q21 * i01 + q22 * i02
            t21 = q20 * i01 + q21 * i11 + q22 * i12
            t22 = q20 * i02 + q21 * i12 + q22 * i22
            b0, b1, b2 = first[i, 0], first[i, 1], first[i, 2]
            out[i, 0] = f0 - (t00 * b0 + t01 * b1 + t02 * b2)
            out[i, 1] = f1 - (t10 * b0 + t11 * b1 + t12 * b2)
            out[i, 2] = f2 - (t20 * b0 + t21 * b1 + t22 * b2)
            k = packed[i]
            k[0], k[1], k[2] = x0, x1, x2
            k[3], k[4], k[5] = v0, v1, v2
            k[6], k[7], k[8] = t00 - c_iso * l00, t01 - c_iso * l01, t02 - c_iso * l02
            k[9], k[10], k[11] = t10 - c_iso * l10, t11 - c_iso * l11, t12 - c_iso * l12
            k[12], k[13], k[14] = t20 - c_iso * l20, t21 - c_iso * l21, t22 - c_iso * l22
            k[15], k[16], k[17] = l00, l11, l22
            k[18], k[19], k[20] = 2.0 * xy, 2.0 * yz, 2.0 * xz
            k[21], k[22], k[23] = p0, p1, p2
            k[24] = p0 * l00 + p1 * l10 + p2 * l20
            k[25] = p0 * l01 + p1 * l11 + p2 * l21
            k[26] = p0 * l02 + p1 * l12 + p2 * l22
            k[27], k[28], k[29] = c_iso, c_bond, c_fibre


@njit(cache=True, parallel=True, fastmath=FAST)
def force_sweep(start, count, index, weight, volume, packed, out):
    """Add the forces of the neighbours' energies to `out`."""
    n = out.shape[0]
    for i in prange(n):
        own = packed[i]
        x0, x1, x2, v0, v1, v2 = own[0], own[1], own[2], own[3], own[4], own[5]
        f0, f1, f2 = 0.0, 0.0, 0.0
        begin = start[i]
        for s in range(count[i]):
            j = index[begin + s]
            w = weight[begin + s]
            d0, d1, d2 = x0 - packed[j, 0], x1 - packed[j, 1], x2 - packed[j, 2]
            w0, w1, w2 = v0 - packed[j, 3], v1 - packed[j, 4], v2 - packed[j, 5]
            per_r2 = 1.0 / (d0 * d0 + d1 * d1 + d2 * d2)
            p0, p1, p2 = packed[j, 21], packed[j, 22], packed[j, 23]
            de = d0 * w0 + d1 * w1 + d2 * w2 - (
                d0 * (packed[j, 15] * d0 + packed[j, 18] * d1 + packed[j, 20] * d2)
                + d1 * (packed[j, 16] * d1 + packed[j, 19] * d2) + packed[j, 17] * d2 * d2
            )  # fmt: skip
            pd = p0 * d0 + p1 * d1 + p2 * d2
            pe = p0 * w0 + p1 * w1 + p2 * w2 - (packed[j, 24] * d0 + packed[j, 25] * d1 + packed[j, 26] * d2)
            ne = per_r2 * packed[j, 29] * (pd * pe - de / 3.0)
            u = per_r2 * packed[j, 28] * de - ne / 3.0
            t = ne * pd
            c = packed[j, 27]
            f0 += w * (packed[j, 6] * d0 + packed[j, 7] * d1 + packed[j, 8] * d2 + c * w0 + u * d0 + t * p0)
            f1 += w * (packed[j, 9] * d0 + packed[j, 10] * d1 + packed[j, 11] * d2 + c * w1 + u * d1 + t * p1)
            f2 += w * (packed[j, 12] * d0 + packed[j, 13] * d1 + packed[j, 14] * d2 + c * w2 + u * d2 + t * p2)
        vol = volume[i]
        out[i, 0] += vol * f0
        out[i, 1] += vol * f1
        out[i, 2] += vol * f2
