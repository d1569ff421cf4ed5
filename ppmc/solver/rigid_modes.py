"""Rigid motions that no tool holds: they cost no power, so a solve must leave them as they are.

Between slip plates a charge can glide and turn freely. The operator does not see it, and a coarse level amplifies the
round-off of such a motion by the inverse of nothing, until the charge spins. They are projected out of the
preconditioner.
"""

import numpy as np

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
    n = len(positions)
    arm = positions - positions.mean(axis=0)
    arm = arm / max(float(np.sqrt(np.mean(arm * arm))), 1e-300)
    modes = np.zeros((n, 3, 6))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        modes[:, a, a] = 1.0
        modes[:, b, 3 + a], modes[:, c, 3 + a] = -arm[:, c], arm[:, b]
    basis = np.linalg.qr(modes.reshape(-1, 6))[0].reshape(n, 3, 6)
    held = (np.eye(3) - free) @ basis
    power = np.einsum("nak,nam->km", held, held)
    if hold.any():
        power += np.einsum("nak,nam->km", basis, hold @ basis) / max(float(np.mean(scale)), 1e-300)
    values, vectors = np.linalg.eigh(power)
    return np.ascontiguousarray(basis @ vectors[:, values < LOOSE])


def without(modes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) less their part in `modes` (n, 3, k); einsum, so that no thread count changes a bit."""
    if modes.shape[2] == 0:
        return vectors
    amount = np.einsum("nak,na->k", modes, vectors)
    return vectors - np.einsum("nak,k->na", modes, amount)
