"""How far the reactions of a solve can be trusted: its residual in the free directions, around each touching particle.

A solve leaves an error e of the velocities; the forces in the free directions are off by A e there, which is the
residual, and so are the reactions in the constrained ones. Between particles the two are alike in size, whatever the
estimates of velocity and power say: with stiff fibres reactions may still be all noise where the velocities are right
to a thousandth.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.smoothing import pair_weight


def force_error(free_residual: np.ndarray, rows: np.ndarray, pairs: Pairs, smoothing_length: float) -> np.ndarray:
    """Root mean square of the unbalanced forces around particles, shape (m,), Pa mm^2.

    Parameters
    ----------
    free_residual : ndarray, shape (n, 3)
        Residual of the solve in the free directions, Pa mm^2.
    rows : ndarray, shape (m,), int64
        Particles of interest.
    pairs : Pairs
    smoothing_length : float
        mm.
    """
    out = np.empty(len(rows))
    own = pair_weight(0.0, smoothing_length)
    _root_mean_square(pairs.start, pairs.count, pairs.index, pairs.weight, own, rows, free_residual, out)
    return out


@njit(cache=True, parallel=True)
def _root_mean_square(start, count, index, weight, own, rows, force, out):
    for place in prange(rows.shape[0]):
        i = rows[place]
        total, mass = own * (force[i, 0] ** 2 + force[i, 1] ** 2 + force[i, 2] ** 2), own
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            total += weight[slot] * (force[j, 0] ** 2 + force[j, 1] ** 2 + force[j, 2] ** 2)
            mass += weight[slot]
        out[place] = np.sqrt(total / mass)
