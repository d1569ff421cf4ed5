r"""Rigid turns in a step of finite length, without the strain that a step along the tangent would make.

A turn moves particles along chords, which are rigid velocities about where the particles are in the *middle* of the
step. Velocities are solved for at places predicted for it; where the spin changes from step to step, and at the first
one above all, these are not the middle. Each piece's rigid part is therefore laid about the true one. With the velocity
V of the piece's centre c, its spin :math:`\Omega`, and what is left of its velocities, v', displacement over time is

.. math:: u = V + (I - \tfrac12\Delta t\,\Omega)^{-1} [\Omega (x - c) + v'] ,

the solution of :math:`u = V + \Omega(x + \tfrac12\Delta t\,u - c_{1/2}) + v'` with x where the step begins. Alone,
:math:`\Omega` gives Cayley's rotation: distances and J are kept to round-off at any step. Where the prediction was
right, u is the velocity itself.
"""

import numpy as np

from ppmc.solver.linear.rigid_modes import Pieces


def chords(pieces: Pieces, velocities: np.ndarray, positions: np.ndarray, time_step: float) -> np.ndarray:
    """Displacements over the time step, shape (n, 3), mm/s.

    Parameters
    ----------
    pieces : Pieces
        At the places that the velocities belong to.
    velocities : ndarray, shape (n, 3)
        mm/s.
    positions : ndarray, shape (n, 3)
        Where the step begins, mm.
    time_step : float
        s.
    """
    motion, at = pieces.motion(velocities), pieces.piece
    total = np.bincount(at, pieces.mass)
    centre = np.stack([np.bincount(at, pieces.mass * x) / total for x in positions.T], axis=1)
    spin = np.zeros((len(motion), 3, 3))
    w0, w1, w2 = pieces.per_length * motion[:, 3:].T
    spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0] = w0, w1, w2
    spin -= np.swapaxes(spin, 1, 2)
    left = pieces.add(-motion, velocities.copy())
    left += np.einsum("nab,nb->na", spin[at], positions - centre[at])
    turned = np.linalg.inv(np.eye(3) - 0.5 * time_step * spin)
    return np.asarray(motion[at, :3] + np.einsum("nab,nb->na", turned[at], left))
