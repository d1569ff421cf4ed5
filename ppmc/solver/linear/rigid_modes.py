r"""Rigid motions that no tool, inertia or drag holds.

Between slip plates a charge can glide and turn freely, in a round cavity it can spin, and each piece of a charge that
has come apart can do so for itself. Such motions N cost no power, so that the velocity solve is singular: any of them
may be added to a solution. What is wanted is the limit of vanishing inertia, of a charge that starts each step at rest:
with masses M, :math:`(\epsilon M + A) v = b` gives :math:`n \cdot M v = 0` for every n in N. That is the solution of
least kinetic energy. What a tool imposes it keeps: a charge that is pushed moves with the tool, for a motion against
which the tool stands is not in N.

In the solve itself they are projected out of the preconditioner: a coarse level would amplify their round-off by the
inverse of nothing.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.neighbours import Pairs

SIZELESS = 1e-9  # of the largest: size of a rigid motion that a piece does not show, as a line turning about itself
LOOSE = 1e-9  # of the typical hold: below it, a rigid motion counts as free
CHUNK = 1024  # particles summed one after the other; the sums are then added in one order, whatever the threads


@dataclass
class Pieces:
    """The connected pieces of a charge, and their six rigid motions each: three velocities, three rotations.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    piece : ndarray, shape (n,), int32
        Number of each particle's piece.
    mass : ndarray, shape (n,)
        What momenta are weighted with: the volumes at the start, for the density is everywhere the same; mm^3.
    members : ndarray, shape (n,), int32
        Particles piece by piece, ascending in each.
    chunks : ndarray, shape (chunks, 2), int64
        Beginning and end of runs of `members`, none of which goes beyond a piece.
    owner : ndarray, shape (chunks,), int64
        The piece of each.
    centre : ndarray, shape (pieces, 3)
        Centres of mass, mm.
    per_length : float
        Inverse of the length that arms are measured in, 1/mm.
    size, inertia : ndarray, shape (pieces, 6, 6)
        Inner products of the motions, each particle counted once, and weighted with its mass.
    """

    positions: np.ndarray
    piece: np.ndarray
    mass: np.ndarray
    members: np.ndarray
    chunks: np.ndarray
    owner: np.ndarray
    centre: np.ndarray
    per_length: float
    size: np.ndarray
    inertia: np.ndarray

    @classmethod
    def of(cls, pairs: Pairs, positions: np.ndarray, mass: np.ndarray) -> Pieces:
        """Find what hangs together by pairs with a weight, at positions (n, 3), mm, with masses (n,)."""
        n = len(positions)
        root = np.arange(n, dtype=np.int32)
        _join(pairs.start, pairs.count, pairs.index, root)
        _, piece = np.unique(root, return_inverse=True)
        piece = piece.astype(np.int32)
        count = int(piece.max(initial=-1)) + 1
        members = np.argsort(piece, kind="stable").astype(np.int32)
        begin = np.append(0, np.cumsum(np.bincount(piece, minlength=count)))
        starts = [np.arange(begin[k], begin[k + 1], CHUNK) for k in range(count)]
        owner = np.repeat(np.arange(count), [len(s) for s in starts])
        first = np.concatenate(starts) if starts else np.empty(0, dtype=np.int64)
        chunks = np.stack([first, np.minimum(first + CHUNK, begin[owner + 1])], axis=1)
        total = np.bincount(piece, mass, count)
        centre = np.stack([np.bincount(piece, mass * x, count) / total for x in positions.T], axis=1)
        arms = float(np.sqrt(np.mean((positions - centre[piece]) ** 2))) if n else 0.0
        partial = np.empty((len(chunks), 2, 6, 6))
        per_length = 1.0 / arms if arms > 0.0 else 1.0
        _sum_products(positions, members, chunks, owner, centre, per_length, mass, partial)
        products = np.zeros((count, 2, 6, 6))
        np.add.at(products, owner, partial)
        return cls(
            positions, piece, mass, members, chunks, owner, centre, per_length, products[:, 0], products[:, 1]
        )  # fmt: skip

    def loads(self, vectors: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """Sums of vectors (n, 3) and of their moments, shape (pieces, 6), particles weighted with `weights` (n,)."""
        partial, out = np.empty((len(self.chunks), 6)), np.zeros((len(self.centre), 6))
        none = np.empty(0) if weights is None else weights
        _sum_loads(self.positions, self.members, self.chunks, self.owner, self.centre, self.per_length, none, vectors,
                   partial)  # fmt: skip
        np.add.at(out, self.owner, partial)
        return out

    def add(self, amounts: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        """Add rigid motions of given `amounts` (pieces, 6) to vectors (n, 3) in place; return the vectors."""
        _add(self.positions, self.piece, self.centre, self.per_length, amounts, vectors)
        return vectors

    def motion(self, velocities: np.ndarray) -> np.ndarray:
        """Rigid motion with the momenta of velocities (n, 3), as amounts (pieces, 6).

        A piece without a moment of inertia about some axis does not turn about it.
        """
        inverse = np.linalg.pinv(self.inertia, rcond=SIZELESS, hermitian=True)
        return np.einsum("kab,kb->ka", inverse, self.loads(velocities, self.mass))


@dataclass
class RigidModes:
    """Free rigid motions of all pieces.

    Attributes
    ----------
    pieces : Pieces
    motions : list of ndarray, shape (6, k) each
        Orthonormal; k is 0 to 6, and 3 between two slip plates.
    """

    pieces: Pieces
    motions: list[np.ndarray]

    @property
    def count(self) -> int:
        """Number of them."""
        return sum(motions.shape[1] for motions in self.motions)

    def remove(self, vectors: np.ndarray) -> np.ndarray:
        """Take these motions out of vectors (n, 3) in place; return the vectors."""
        if self.count > 0:
            loads = self.pieces.loads(vectors)
            # einsum, so that no thread count changes a bit.
            amounts = [-np.einsum("am,bm,b->a", m, m, load) for m, load in zip(self.motions, loads, strict=True)]
            self.pieces.add(np.array(amounts), vectors)
        return vectors

    def rest(self, velocities: np.ndarray) -> np.ndarray:
        """Add what leaves velocities (n, 3) no momentum along these motions, in place; return the velocities."""
        if self.count > 0:
            pieces, amounts = self.pieces, np.zeros((len(self.motions), 6))
            momenta = pieces.loads(velocities, pieces.mass)
            for k, motions in enumerate(self.motions):
                if motions.shape[1] > 0:
                    inertia = motions.T @ pieces.inertia[k] @ motions
                    amounts[k] = -motions @ np.linalg.solve(inertia, motions.T @ momenta[k])
            pieces.add(amounts, velocities)
        return velocities


def free_rigid_modes(
    pieces: Pieces, inertia: float, rows: np.ndarray, free: np.ndarray, drag: np.ndarray, scale: float
) -> RigidModes:
    """Rigid motions without power.

    Parameters
    ----------
    pieces : Pieces
    inertia : float
        Density over the step, Pa s/mm^2.
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
    per_scale = 1.0 / max(scale, 1e-300)
    power = (per_scale * inertia) * pieces.inertia
    _add_powers(
        pieces.positions, pieces.piece, pieces.centre, pieces.per_length, rows, free, drag, per_scale, power
    )  # fmt: skip
    return RigidModes(pieces, [_without_power(*both) for both in zip(pieces.size, power, strict=True)])


def _without_power(size: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Motions (6, k), orthonormal in their `size` (6, 6), that have one and take no `power` (6, 6)."""
    extent, axes = eigh(size)
    shown = extent > SIZELESS * extent[-1]
    basis = axes[:, shown] / np.sqrt(extent[shown])
    values, vectors = eigh(basis.T @ power @ basis)
    found: np.ndarray = basis @ vectors[:, values < LOOSE]
    return found


@njit(cache=True)
def _join(start, count, index, root):
    """Give every particle the least number among those that it hangs together with."""
    for i in range(root.shape[0]):
        for slot in range(start[i], start[i] + count[i]):
            a, b = np.int32(i), index[slot]
            while root[a] != a:
                root[a] = root[root[a]]
                a = root[a]
            while root[b] != b:
                root[b] = root[root[b]]
                b = root[b]
            if a < b:
                root[b] = a
            else:
                root[a] = b
    for i in range(root.shape[0]):
        root[i] = root[root[i]]


@njit(cache=True)
def _motions_of(x, centre, per_length, motion):
    """Velocities (3, 6) that the six rigid motions give a particle."""
    motion[:] = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        motion[a, a] = 1.0
        motion[b, 3 + a], motion[c, 3 + a] = -per_length * (x[c] - centre[c]), per_length * (x[b] - centre[b])


@njit(cache=True, parallel=True)
def _sum_products(x, members, chunks, owner, centre, per_length, mass, partial):
    for chunk in prange(chunks.shape[0]):
        motion = np.zeros((3, 6))
        partial[chunk] = 0.0
        for slot in range(chunks[chunk, 0], chunks[chunk, 1]):
            i = members[slot]
            _motions_of(x[i], centre[owner[chunk]], per_length, motion)
            for k in range(6):
                for m in range(6):
                    product = motion[0, k] * motion[0, m] + motion[1, k] * motion[1, m] + motion[2, k] * motion[2, m]
                    partial[chunk, 0, k, m] += product
                    partial[chunk, 1, k, m] += mass[i] * product


@njit(cache=True)
def _add_powers(x, piece, centre, per_length, rows, free, drag, per_scale, power):
    motion, held = np.zeros((3, 6)), np.zeros((3, 6))
    for place in range(rows.shape[0]):
        at = piece[rows[place]]
        _motions_of(x[rows[place]], centre[at], per_length, motion)
        for k in range(6):
            for a in range(3):
                held[a, k] = motion[a, k]
                for b in range(3):
                    held[a, k] -= free[place, a, b] * motion[b, k]
        for k in range(6):
            for m in range(6):
                for a in range(3):
                    power[at, k, m] += held[a, k] * held[a, m]
                    for b in range(3):
                        power[at, k, m] += per_scale * motion[a, k] * drag[place, a, b] * motion[b, m]


@njit(cache=True, parallel=True)
def _sum_loads(x, members, chunks, owner, centre, per_length, weights, v, partial):
    for chunk in prange(chunks.shape[0]):
        c = centre[owner[chunk]]
        f0, f1, f2, t0, t1, t2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for slot in range(chunks[chunk, 0], chunks[chunk, 1]):
            i = members[slot]
            weight = weights[i] if weights.shape[0] > 0 else 1.0
            d0, d1, d2 = x[i, 0] - c[0], x[i, 1] - c[1], x[i, 2] - c[2]
            v0, v1, v2 = weight * v[i, 0], weight * v[i, 1], weight * v[i, 2]
            f0 += v0
            f1 += v1
            f2 += v2
            t0 += d1 * v2 - d2 * v1
            t1 += d2 * v0 - d0 * v2
            t2 += d0 * v1 - d1 * v0
        partial[chunk, 0], partial[chunk, 1], partial[chunk, 2] = f0, f1, f2
        partial[chunk, 3], partial[chunk, 4], partial[chunk, 5] = per_length * t0, per_length * t1, per_length * t2


@njit(cache=True, parallel=True)
def _add(x, piece, centre, per_length, amounts, v):
    for i in prange(x.shape[0]):
        c, amount = centre[piece[i]], amounts[piece[i]]
        d0, d1, d2 = x[i, 0] - c[0], x[i, 1] - c[1], x[i, 2] - c[2]
        w0, w1, w2 = per_length * amount[3], per_length * amount[4], per_length * amount[5]
        v[i, 0] += amount[0] + w1 * d2 - w2 * d1
        v[i, 1] += amount[1] + w2 * d0 - w0 * d2
        v[i, 2] += amount[2] + w0 * d1 - w1 * d0
