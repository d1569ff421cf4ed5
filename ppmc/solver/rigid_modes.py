"""Rigid motions that no tool holds: they cost no power, so a solve must leave them as they are.

Between slip plates a charge can glide and turn freely. The operator does not see it, and a coarse level amplifies the
round-off of such a motion by the inverse of nothing, until the charge spins. They are projected out of the
preconditioner.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np
from scipy.linalg import eigh

from ppmc.compile_cache import njit

LEAST = 1e-12  # of all motions' size, added to each
LOOSE = 1e-9  # of the typical hold: below it, a rigid motion counts as free


def free_rigid_modes(positions: np.ndarray, free: np.ndarray, hold: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the rigid motions without power.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    free : ndarray, shape (n, 3, 3)
        Projections onto the directions that the tools leave free.
    hold : ndarray, shape (n, 3, 3)
        Inertia and wall drag, Pa s mm.
    scale : ndarray, shape (n,)
        Stiffness of each particle by which `hold` is judged, Pa s mm.

    Returns
    -------
    ndarray, shape (n, 3, k)
        k is 0 to 6; 3 between two slip plates.
    """
    arm = positions - positions.mean(axis=0)
    arm = arm / max(float(np.sqrt(np.mean(arm * arm))), 1e-300)
    size, power = np.zeros((6, 6)), np.zeros((6, 6))
    _sum_powers(arm, free, hold, 1.0 / max(float(np.mean(scale)), 1e-300), size, power)
    # Orthonormal with respect to the motions' own size; rotations about a line of particles have none.
    values, vectors = eigh(power, size + LEAST * np.trace(size) * np.eye(6))
    loose = vectors[:, values < LOOSE]
    modes = np.zeros((len(positions), 3, loose.shape[1]))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        modes[:, a] += loose[a]
        modes[:, b] -= arm[:, c, None] * loose[3 + a]
        modes[:, c] += arm[:, b, None] * loose[3 + a]
    return modes


@njit(cache=True)
def _sum_powers(arm, free, hold, per_scale, size, power):
    for i in range(arm.shape[0]):
        motion, held = np.zeros((3, 6)), np.zeros((3, 6))
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            motion[a, a] = 1.0
            motion[b, 3 + a], motion[c, 3 + a] = -arm[i, c], arm[i, b]
        for k in range(6):
            for a in range(3):
                held[a, k] = motion[a, k]
                for b in range(3):
                    held[a, k] -= free[i, a, b] * motion[b, k]
        for k in range(6):
            for m in range(6):
                for a in range(3):
                    size[k, m] += motion[a, k] * motion[a, m]
                    power[k, m] += held[a, k] * held[a, m]
                    for b in range(3):
                        power[k, m] += per_scale * motion[a, k] * hold[i, a, b] * motion[b, m]


def without(modes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) less their part in `modes` (n, 3, k); einsum, so that no thread count changes a bit."""
    if modes.shape[2] == 0:
        return vectors
    amount = np.einsum("nak,na->k", modes, vectors)
    return vectors - np.einsum("nak,k->na", modes, amount)
