"""Rigid motions that no tool holds: they cost no power, so a solve must leave them as they are.

Between slip plates a charge can glide and turn freely. The operator does not see it, and a coarse level amplifies the
round-off of such a motion by the inverse of nothing, until the charge spins. They are projected out of the
preconditioner.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from ppmc.compile_cache import njit, prange

LEAST = 1e-12  # of all motions' size, added to each
LOOSE = 1e-9  # of the typical hold: below it, a rigid motion counts as free
CHUNK = 1024  # particles summed one after the other; the sums are then added in one order, whatever the threads


@dataclass
class RigidModes:
    """Orthonormal rigid motions, each three velocities and three rotations about a centre.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    centre : ndarray, shape (3,)
        mm.
    per_length : float
        Inverse of the length that arms are measured in, 1/mm.
    motions : ndarray, shape (6, k)
        k is 0 to 6; 3 between two slip plates.
    """

    positions: np.ndarray
    centre: np.ndarray
    per_length: float
    motions: np.ndarray

    def remove(self, vectors: np.ndarray) -> np.ndarray:
        """Take these motions out of vectors (n, 3) in place; return the vectors."""
        if self.motions.shape[1] > 0:
            partial = np.empty(((len(vectors) + CHUNK - 1) // CHUNK, 6))
            _sum_loads(self.positions, self.centre, self.per_length, vectors, partial)
            load = np.array([sum(column) for column in partial.T.tolist()])
            # einsum, so that no thread count changes a bit.
            amount = np.einsum("am,bm,b->a", self.motions, self.motions, load)
            _subtract(self.positions, self.centre, self.per_length, amount, vectors)
        return vectors


def free_rigid_modes(
    positions: np.ndarray, inertia: np.ndarray, rows: np.ndarray, free: np.ndarray, drag: np.ndarray, scale: float
) -> RigidModes:
    """Rigid motions without power.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    inertia : ndarray, shape (n,)
        Mass over the step, Pa s mm.
    rows : ndarray, shape (m,), int64
        Particles that a tool may hold or brake.
    free : ndarray, shape (m, 3, 3)
        Projections onto the directions that the tools leave them.
    drag : ndarray, shape (m, 3, 3)
        Wall drag on them, Pa s mm.
    scale : float
        Mean stiffness of the particles, by which inertia and drag are judged, Pa s mm.

    Returns
    -------
    RigidModes
    """
    centre = positions.mean(axis=0)
    per_length = 1.0 / max(float(np.sqrt(np.mean((positions - centre) ** 2))), 1e-300)
    size, power = np.zeros((6, 6)), np.zeros((6, 6))
    per_scale = 1.0 / max(scale, 1e-300)
    _sum_powers(positions, centre, per_length, inertia, rows, free, drag, per_scale, size, power)
    # Orthonormal with respect to the motions' own size; rotations about a line of particles have none.
    values, vectors = eigh(power, size + LEAST * np.trace(size) * np.eye(6))
    return RigidModes(positions, centre, per_length, vectors[:, values < LOOSE])


@njit(cache=True)
def _motions_of(x, centre, per_length, motion):
    """Velocities (3, 6) that the six rigid motions give a particle."""
    motion[:] = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        motion[a, a] = 1.0
        motion[b, 3 + a], motion[c, 3 + a] = -per_length * (x[c] - centre[c]), per_length * (x[b] - centre[b])


@njit(cache=True)
def _sum_powers(x, centre, per_length, inertia, rows, free, drag, per_scale, size, power):
    motion, held = np.zeros((3, 6)), np.zeros((3, 6))
    for i in range(x.shape[0]):
        _motions_of(x[i], centre, per_length, motion)
        for k in range(6):
            for m in range(6):
                for a in range(3):
                    size[k, m] += motion[a, k] * motion[a, m]
                    power[k, m] += per_scale * inertia[i] * motion[a, k] * motion[a, m]
    for place in range(rows.shape[0]):
        _motions_of(x[rows[place]], centre, per_length, motion)
        for k in range(6):
            for a in range(3):
                held[a, k] = motion[a, k]
                for b in range(3):
                    held[a, k] -= free[place, a, b] * motion[b, k]
        for k in range(6):
            for m in range(6):
                for a in range(3):
                    power[k, m] += held[a, k] * held[a, m]
                    for b in range(3):
                        power[k, m] += per_scale * motion[a, k] * drag[place, a, b] * motion[b, m]


@njit(cache=True, parallel=True)
def _sum_loads(x, centre, per_length, v, partial):
    n = x.shape[0]
    for chunk in prange(partial.shape[0]):
        f0, f1, f2, t0, t1, t2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            d0, d1, d2 = x[i, 0] - centre[0], x[i, 1] - centre[1], x[i, 2] - centre[2]
            v0, v1, v2 = v[i, 0], v[i, 1], v[i, 2]
            f0 += v0
            f1 += v1
            f2 += v2
            t0 += d1 * v2 - d2 * v1
            t1 += d2 * v0 - d0 * v2
            t2 += d0 * v1 - d1 * v0
        partial[chunk, 0], partial[chunk, 1], partial[chunk, 2] = f0, f1, f2
        partial[chunk, 3], partial[chunk, 4], partial[chunk, 5] = per_length * t0, per_length * t1, per_length * t2


@njit(cache=True, parallel=True)
def _subtract(x, centre, per_length, amount, v):
    for i in prange(x.shape[0]):
        d0, d1, d2 = x[i, 0] - centre[0], x[i, 1] - centre[1], x[i, 2] - centre[2]
        w0, w1, w2 = per_length * amount[3], per_length * amount[4], per_length * amount[5]
        v[i, 0] -= amount[0] + w1 * d2 - w2 * d1
        v[i, 1] -= amount[1] + w2 * d0 - w0 * d2
        v[i, 2] -= amount[2] + w0 * d1 - w1 * d0
