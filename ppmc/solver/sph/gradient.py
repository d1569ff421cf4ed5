r"""Velocity gradient of scattered particles, exact for linear fields.

With :math:`a_{ij} = V_j\omega_{ij}` and :math:`x_{ij} = x_j - x_i`, the moment matrix
:math:`M_i = \sum_j a_{ij}\,x_{ij}\otimes x_{ij}` gives

.. math:: L_i = \Big[\sum_j a_{ij}\,(v_j - v_i)\otimes x_{ij}\Big]\,M_i^{-1},

at once the corrected particle gradient and the weighted least-squares gradient.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.small_tensors import invert_in_metric, invert_symmetric

CHUNK = 64  # rows that share their buffers
FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}  # never nnan or ninf
MOMENT_FLOOR = 0.01  # smallest eigenvalue of M in the kernel's metric, in parts of its largest, taken at its word
_NO_VELOCITIES = np.empty((0, 3))


def moment_inverses(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverse moment matrices and the sums that go with them.

    Parameters
    ----------
    pairs : Pairs
    positions : ndarray, shape (n, 3)
        mm.
    volumes : ndarray, shape (n,)
        mm^3.

    Returns
    -------
    inverse : ndarray, shape (n, 3, 3)
        M_i^-1.
    trace : ndarray, shape (n,)
        tr M_i (zero for a particle without neighbours).
    first : ndarray, shape (n, 3)
        First moments, sum_j a_ij x_ij.
    """
    if pairs.moments is None or pairs.moments[0] is not volumes:
        moments_and_gradient(pairs, positions, volumes, _NO_VELOCITIES)
    assert pairs.moments is not None
    return pairs.moments[1:]


def moments_and_gradient(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, velocities: np.ndarray
) -> np.ndarray:
    """Velocity gradients L_i, shape (n, 3, 3), 1/s; the moments, taken in the same sweep, are kept with the pairs."""
    n, gradient = len(positions), np.empty((len(velocities), 3, 3))
    inverse, trace, first = np.empty((n, 3, 3)), np.empty(n), np.empty((n, 3))
    _moments(
        pairs.start, pairs.count, pairs.index, pairs.weight, positions, volumes, velocities,
        pairs.metric, int(pairs.count.max(initial=0)), MOMENT_FLOOR, inverse, trace, first, gradient,
    )  # fmt: skip
    pairs.moments = volumes, inverse, trace, first
    return gradient


def velocity_gradient(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, inverse: np.ndarray, velocities: np.ndarray
) -> np.ndarray:
    """Velocity gradients L_i (L_ab = dv_a/dx_b), shape (n, 3, 3), 1/s; arguments as in :func:`moment_inverses`."""
    out = np.empty((len(positions), 3, 3))
    _gradient(
        pairs.start, pairs.count, pairs.index, pairs.weight, positions, volumes, velocities,
        int(pairs.count.max(initial=0)), inverse, out,
    )  # fmt: skip
    return out


def mean_around(pairs: Pairs, values: np.ndarray, where: np.ndarray, own_weight: float) -> np.ndarray:
    """Weighted means of tensors over each particle and its neighbours.

    Parameters
    ----------
    pairs : Pairs
    values : ndarray, shape (n, 3, 3)
    where : ndarray, shape (n,), bool
        Particles of interest; the others keep their values.
    own_weight : float
        Weight of the particle itself.

    Returns
    -------
    ndarray, shape (n, 3, 3)
    """
    out = np.empty_like(values)
    _mean_around(pairs.start, pairs.count, pairs.index, pairs.weight, values, where, own_weight, out)
    return out


# Rows are first copied into short buffers, one a component, so that the sums over them vectorise. For that the sums
# must be allowed another order than the one written; nothing else may be. A kernel is optimised once when it is
# compiled and once more for the cache, and a formula that may be rearranged comes out of the two with other last bits.


@njit(cache=True, inline="always")
def _copy_row(index, weight, volume, x, i, begin, m, a, da, db, dc):
    x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
    for s in range(m):
        j = np.uint32(index[begin + s])
        a[s] = volume[j] * weight[begin + s]
        da[s] = x[j, 0] - x0
        db[s] = x[j, 1] - x1
        dc[s] = x[j, 2] - x2


@njit(cache=True, inline="always")
def _copy_differences(index, values, i, begin, m, da, db, dc):
    v0, v1, v2 = values[i, 0], values[i, 1], values[i, 2]
    for s in range(m):
        j = np.uint32(index[begin + s])
        da[s] = values[j, 0] - v0
        db[s] = values[j, 1] - v1
        dc[s] = values[j, 2] - v2


@njit(cache=True, fastmath=FAST)
def sum_products(wa, wb, wc, a, da, db, dc, m):
    """Nine sums of w (x) a d over the `m` entries of a row's buffers."""
    g00, g01, g02, g10, g11, g12, g20, g21, g22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for s in range(m):
        d0, d1, d2 = a[s] * da[s], a[s] * db[s], a[s] * dc[s]
        g00 += wa[s] * d0
        g01 += wa[s] * d1
        g02 += wa[s] * d2
        g10 += wb[s] * d0
        g11 += wb[s] * d1
        g12 += wb[s] * d2
        g20 += wc[s] * d0
        g21 += wc[s] * d1
        g22 += wc[s] * d2
    return g00, g01, g02, g10, g11, g12, g20, g21, g22


@njit(cache=True, fastmath=FAST)
def _sum_moments(a, da, db, dc, m):
    xx, yy, zz, xy, yz, xz, s0, s1, s2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for s in range(m):
        d0, d1, d2 = a[s] * da[s], a[s] * db[s], a[s] * dc[s]
        s0 += d0
        s1 += d1
        s2 += d2
        xx += d0 * da[s]
        yy += d1 * db[s]
        zz += d2 * dc[s]
        xy += d0 * db[s]
        yz += d1 * dc[s]
        xz += d0 * dc[s]
    return xx, yy, zz, xy, yz, xz, s0, s1, s2


@njit(cache=True, inline="always")
def _write_gradient(sums, inverse, i, out):
    g00, g01, g02, g10, g11, g12, g20, g21, g22 = sums
    for c in range(3):
        i0, i1, i2 = inverse[i, 0, c], inverse[i, 1, c], inverse[i, 2, c]
        out[i, 0, c] = g00 * i0 + g01 * i1 + g02 * i2
        out[i, 1, c] = g10 * i0 + g11 * i1 + g12 * i2
        out[i, 2, c] = g20 * i0 + g21 * i1 + g22 * i2


@njit(cache=True, parallel=True)
def _moments(start, count, index, weight, x, volume, v, metric, longest, floor, inverse, trace, first, gradient):
    n = x.shape[0]
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        a, da, db, dc = np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest)
        wa, wb, wc, moment = np.empty(longest), np.empty(longest), np.empty(longest), np.empty((3, 3))
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            begin, m = start[i], count[i]
            _copy_row(index, weight, volume, x, i, begin, m, a, da, db, dc)
            xx, yy, zz, xy, yz, xz, s0, s1, s2 = _sum_moments(a, da, db, dc, m)
            moment[0, 0], moment[1, 1], moment[2, 2] = xx, yy, zz
            moment[0, 1], moment[1, 2], moment[0, 2] = xy, yz, xz
            moment[1, 0], moment[2, 1], moment[2, 0] = xy, yz, xz
            first[i, 0], first[i, 1], first[i, 2] = s0, s1, s2
            trace[i] = xx + yy + zz
            if metric.shape[0] > 0:
                invert_in_metric(moment, metric[i], floor, inverse[i])
            else:
                invert_symmetric(moment, floor, inverse[i])
            if v.shape[0] > 0:
                _copy_differences(index, v, i, begin, m, wa, wb, wc)
                _write_gradient(sum_products(wa, wb, wc, a, da, db, dc, m), inverse, i, gradient)


@njit(cache=True, parallel=True)
def _mean_around(start, count, index, weight, values, where, own, out):
    for i in prange(values.shape[0]):
        out[i] = values[i]
        if where[i]:
            mass = own
            out[i] *= own
            for slot in range(start[i], start[i] + count[i]):
                for a in range(3):
                    for b in range(3):
                        out[i, a, b] += weight[slot] * values[index[slot], a, b]
                mass += weight[slot]
            out[i] /= mass


@njit(cache=True, parallel=True)
def _gradient(start, count, index, weight, x, volume, v, longest, inverse, out):
    n = x.shape[0]
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        a, da, db, dc = np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest)
        wa, wb, wc = np.empty(longest), np.empty(longest), np.empty(longest)
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            begin, m = start[i], count[i]
            _copy_row(index, weight, volume, x, i, begin, m, a, da, db, dc)
            _copy_differences(index, v, i, begin, m, wa, wb, wc)
            _write_gradient(sum_products(wa, wb, wc, a, da, db, dc, m), inverse, i, out)
