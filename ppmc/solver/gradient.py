r"""Velocity gradient of scattered particles, exact for linear fields.

With :math:`a_{ij} = V_j\omega_{ij}` and :math:`x_{ij} = x_j - x_i`, the moment matrix
:math:`M_i = \sum_j a_{ij}\,x_{ij}\otimes x_{ij}` gives

.. math:: L_i = \Big[\sum_j a_{ij}\,(v_j - v_i)\otimes x_{ij}\Big]\,M_i^{-1},

at once the corrected particle gradient and the weighted least-squares gradient.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.neighbours import Pairs
from ppmc.solver.small_tensors import invert_symmetric

MOMENT_FLOOR = 0.01  # smallest eigenvalue of M, in parts of its largest, that is taken at its word


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
    n = len(positions)
    inverse, trace, first = np.empty((n, 3, 3)), np.empty(n), np.empty((n, 3))
    _moments(
        pairs.start, pairs.count, pairs.index, pairs.weight, positions, volumes, MOMENT_FLOOR, inverse, trace, first
    )
    return inverse, trace, first


def velocity_gradient(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, inverse: np.ndarray, velocities: np.ndarray
) -> np.ndarray:
    """Velocity gradients L_i (L_ab = dv_a/dx_b), shape (n, 3, 3), 1/s; arguments as in :func:`moment_inverses`."""
    out = np.empty((len(positions), 3, 3))
    _gradient(pairs.start, pairs.count, pairs.index, pairs.weight, positions, volumes, inverse, velocities, out)
    return out


@njit(cache=True, parallel=True)
def _moments(start, count, index, weight, x, volume, floor, inverse, trace, first):
    for i in prange(x.shape[0]):
        m = np.zeros((3, 3))
        s0, s1, s2 = 0.0, 0.0, 0.0
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            a = volume[j] * weight[slot]
            d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            s0 += a * d0
            s1 += a * d1
            s2 += a * d2
            m[0, 0] += a * d0 * d0
            m[1, 1] += a * d1 * d1
            m[2, 2] += a * d2 * d2
            m[0, 1] += a * d0 * d1
            m[1, 2] += a * d1 * d2
            m[0, 2] += a * d0 * d2
        m[1, 0], m[2, 1], m[2, 0] = m[0, 1], m[1, 2], m[0, 2]
        first[i, 0], first[i, 1], first[i, 2] = s0, s1, s2
        trace[i] = m[0, 0] + m[1, 1] + m[2, 2]
        invert_symmetric(m, floor, inverse[i])


@njit(cache=True, parallel=True)
def _gradient(start, count, index, weight, x, volume, inverse, v, out):
    for i in prange(x.shape[0]):
        g = np.zeros((3, 3))
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            a = volume[j] * weight[slot]
            for r in range(3):
                dv = a * (v[j, r] - v[i, r])
                for c in range(3):
                    g[r, c] += dv * (x[j, c] - x[i, c])
        for r in range(3):
            for c in range(3):
                out[i, r, c] = g[r, 0] * inverse[i, 0, c] + g[r, 1] * inverse[i, 1, c] + g[r, 2] * inverse[i, 2, c]
