r"""Unilateral contact with rigid tools, without a penalty stiffness.

Each particle may touch up to three tool faces at once. The gap to a face is the signed distance less the particle's
own deformed half-width, :math:`g = \phi(x) - w\sqrt{n\cdot C n / n\cdot C_0 n}` with the shape C of the local
lattice, and the velocity must satisfy :math:`n\cdot(v - v_{tool}) \ge -g/\Delta t`. The directions of active
constraints are projected out of the velocity solve; the residual in them is the reaction. Reactions that pull (by more
than the air holds) release a constraint, violated ones are added.

The constraints hold the centres of the wall layer, so the discrete body ends there: what lies behind them does not
resist (`between_wall_layers`), and the reactions are then the tools' forces.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass, field

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.kernel_shape import full
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.smoothing import pair_weight

FACES = 3  # faces a particle can touch at once
HALF_WIDTH_BOUNDS = (0.05, 1.5)  # of the reference half-width
LEAST_KEPT = 0.1  # of the ideal half-width: where penetration is put right at once
RETURN = 1.0  # share of the way back to the ideal half-width in a unit of strain
# Part of a cell in a wall layer that resists. In a lattice with h = 1.3 the layers see the first gap with weights
# 0.945, 0.471 and 0.028; with this share they add up to one, as they do for a gap in the interior.
WALL_SHARE = 0.53
LAYER = 0.3  # gap, in half-widths, up to which a particle belongs to the wall layer
SAME_FACE = 0.94  # cosine above which two normals of a tool are one face
PARALLEL = 0.05  # sine below which two faces are taken for one


@dataclass
class Contacts:
    """Faces near particles in one step, and which of them are active; only of the m particles that have one near.

    Attributes
    ----------
    rows : ndarray, shape (m,), int64
        Their numbers, ascending.
    tool : ndarray, shape (m, 3), int32
        Tool of each face, -1 for none.
    normal : ndarray, shape (m, 3, 3)
        Unit normals out of the tool, normal[i, k] belongs to tool[i, k].
    half_width : ndarray, shape (m, 3)
        Deformed half-width of the particle along the normal, mm.
    gap : ndarray, shape (m, 3)
        Distance that the particle may approach, mm.
    wall_velocity : ndarray, shape (m, 3, 3)
        Mean velocity of the tool's face over the step, mm/s.
    active : ndarray, shape (m, 3), bool
    slip_length : ndarray, shape (m, 3)
        Speed over traction of each wall, mm/(Pa s): zero without slip, infinite where nothing rubs.
    half_cells : two of ndarray, shapes (m,) and (m, k), or None
        Shear viscosity and fibre stiffnesses, Pa s, between centre and walls, where the rate there makes them others
        than the particle's own.
    """

    rows: np.ndarray
    tool: np.ndarray
    normal: np.ndarray
    half_width: np.ndarray
    gap: np.ndarray
    wall_velocity: np.ndarray
    active: np.ndarray
    slip_length: np.ndarray = field(default_factory=lambda: np.empty((0, FACES)))
    half_cells: tuple[np.ndarray, np.ndarray] | None = None

    def constrain(self, time_step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the projections onto free directions (m, 3, 3) and the held velocities (m, 3)."""
        m = len(self.rows)
        free, held = np.empty((m, 3, 3)), np.empty((m, 3))
        _constrain(self.active, self.normal, self.gap, self.wall_velocity, time_step, free, held)
        return free, held

    def areas(self, volumes: np.ndarray) -> np.ndarray:
        """Area, mm^2, with which particles of present `volumes` (m,), mm^3, lie at each face; shape (m, 3)."""
        return volumes[:, None] / np.maximum(2.0 * self.half_width, 1e-12)

    def layers(self) -> np.ndarray:
        """Return the number of faces in whose wall layer each particle is, shape (m,): those touched or nearly so."""
        near = (self.tool >= 0) & (self.gap < LAYER * self.half_width)
        return np.count_nonzero(near | self.active, axis=1)

    def wall_layers(self, n: int) -> np.ndarray:
        """Return the same for each of `n` particles, those far from all faces included, shape (n,)."""
        out = np.zeros(n, dtype=np.int64)
        out[self.rows] = self.layers()
        return out

    def whole_cells(self) -> np.ndarray:
        """Factor from a face's force on a particle to that on its whole cell, shape (m,).

        A particle in several wall layers resists with a part of its cell only; each tool bears the whole.
        """
        return 1.0 / between_wall_layers(np.maximum(self.layers() - 1, 0))

    def reactions(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split the tools' forces on the particles (m, 3), Pa mm^2, by face.

        Returns
        -------
        pressing : ndarray, shape (m, 3)
            Normal part at each face, positive when it presses.
        forces : ndarray, shape (m, 3, 3)
            Force vector from each face on the particle.
        """
        pressing, forces = np.zeros((len(force), FACES)), np.zeros((len(force), FACES, 3))
        _split_reactions(self.active, self.normal, force, pressing, forces)
        return pressing, forces

    def pressure_around(self, pressing: np.ndarray, pairs: Pairs, smoothing_length: float) -> np.ndarray:
        """Weighted mean of what presses at each touched face and at those of its neighbours that touch the same one.

        Parameters
        ----------
        pressing : ndarray, shape (m, 3)
            Normal reactions, see :meth:`reactions`.
        pairs : Pairs
        smoothing_length : float
            mm.

        Returns
        -------
        ndarray, shape (m, 3); zero where nothing touches.
        """
        out = np.zeros_like(pressing)
        _pressure_around(
            pairs.start, pairs.count, pairs.index, pairs.weight, pair_weight(0.0, smoothing_length), self.rows,
            places(self.rows, len(pairs.count)), self.tool, self.normal, self.active, pressing, out,
        )  # fmt: skip
        return out

    def departures(self, velocities: np.ndarray, time_step: float) -> np.ndarray:
        """Gap of each face at the end of a step, shape (m, 3), mm: negative where the particle would penetrate.

        `velocities`, shape (m, 3), are those of the particles in the step. Infinite where there is no face.
        """
        relative = velocities[:, None, :] - self.wall_velocity
        return self.gap + time_step * np.einsum("nkc,nkc->nk", self.normal, relative)

    def violations(self, velocities: np.ndarray, time_step: float) -> np.ndarray:
        """Penetration of inactive faces at the end of a step, shape (m, 3), mm; zero where there is none.

        `velocities`, shape (m, 3), are those of the particles in the step.
        """
        depth = -self.departures(velocities, time_step)
        return np.where((self.tool >= 0) & ~self.active & (depth > 0.0), depth, 0.0)


def half_widths(
    reference: np.ndarray, lattice_shape: np.ndarray, start_shape: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    r"""Half-width of particles along wall normals, :math:`w\sqrt{n\cdot C n / n\cdot C_0 n}` within bounds.

    Parameters
    ----------
    reference : ndarray, shape (n,)
        Half-width w at the start, mm.
    lattice_shape : ndarray, shape (n, 6)
        C.
    start_shape : ndarray, shape (6,)
        C_0, that of the start.
    normals : ndarray, shape (n, 3)

    Returns
    -------
    ndarray, shape (n,), mm
    """
    now = np.einsum("na,nab,nb->n", normals, full(lattice_shape), normals)
    start = np.einsum("na,ab,nb->n", normals, full(start_shape[None])[0], normals)
    return reference * np.clip(np.sqrt(now / start), *HALF_WIDTH_BOUNDS)


def kept_half_widths(ideal: np.ndarray, distance: np.ndarray, growth: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Half-widths of particles that touch: the distance they have now, carried on by the flow.

    Pushing them to their ideal width at once would crush the layers behind; they return to it as the charge flows.

    Parameters
    ----------
    ideal : ndarray, shape (n, 3)
        Half-width that the lattice gives, mm.
    distance : ndarray, shape (n, 3)
        Present distance to each face, mm, infinite for none.
    growth : ndarray, shape (n, 3)
        Stretch along the normal in the step.
    strain : ndarray, shape (n,)
        Strain of the step.
    """
    own = np.maximum(np.where(np.isfinite(distance), distance, 0.0), LEAST_KEPT * ideal) * growth
    return own + np.minimum(RETURN * strain, 1.0)[:, None] * (ideal - own)


def starting_half_widths(distance: np.ndarray, spacing: float) -> np.ndarray:
    """Reference half-widths for one tool from the distances at the start.

    A layer of particles that lies on the tool keeps its own distances, particle by particle: a scattered layer would
    otherwise be pushed off the tool, or sink towards it, at the first step. All others have half a spacing.

    Parameters
    ----------
    distance : ndarray, shape (n,)
        Signed distances at the start, mm.
    spacing : float
        Particle spacing, mm.

    Returns
    -------
    ndarray, shape (n,), mm
    """
    half = 0.5 * spacing
    own = np.full(len(distance), half)
    near = distance < 1.6 * half
    if np.any(near) and abs(np.median(distance[near]) - half) < 0.1 * spacing:
        own[near] = distance[near]
    else:
        own = np.minimum(own, distance)
    return np.maximum(own, 0.1 * half)


def between_wall_layers(wall_layers: np.ndarray) -> np.ndarray:
    """Share of each particle that lies between the centres of wall layers, shape (n,).

    The constraints hold the centres of the wall layers, so the discrete body ends there, and the half of a cell that
    lies behind them must not resist. With whole cells N layers would share N - 1 gaps, the outer ones counted too
    often: a homogeneous squeeze would come out with a profile of 20 % over eight layers.

    Parameters
    ----------
    wall_layers : ndarray, shape (n,)
        Number of faces in whose wall layer the particle is.
    """
    shares: np.ndarray = WALL_SHARE ** np.arange(FACES + 1.0)
    return shares[wall_layers]


def places(rows: np.ndarray, n: int) -> np.ndarray:
    """Place of each of n particles in `rows` (m,), -1 for those that are not in it; shape (n,), int32."""
    out = np.full(n, -1, dtype=np.int32)
    out[rows] = np.arange(len(rows), dtype=np.int32)
    return out


@njit(cache=True, parallel=True)
def _constrain(active, normal, gap, wall_velocity, dt, free, held):
    for i in prange(active.shape[0]):
        basis, level = np.zeros((3, 3)), np.zeros(3)
        rank = 0
        for k in range(active.shape[1]):
            if not active[i, k]:
                continue
            target = -gap[i, k] / dt
            for c in range(3):
                target += normal[i, k, c] * wall_velocity[i, k, c]
            rest = normal[i, k].copy()
            for b in range(rank):
                part = rest[0] * basis[b, 0] + rest[1] * basis[b, 1] + rest[2] * basis[b, 2]
                for c in range(3):
                    rest[c] -= part * basis[b, c]
                target -= part * level[b]
            size = np.sqrt(rest[0] ** 2 + rest[1] ** 2 + rest[2] ** 2)
            if size > PARALLEL and rank < 3:
                for c in range(3):
                    basis[rank, c] = rest[c] / size
                level[rank] = target / size
                rank += 1
        for r in range(3):
            held[i, r] = 0.0
            for c in range(3):
                free[i, r, c] = 1.0 if r == c else 0.0
            for b in range(rank):
                held[i, r] += level[b] * basis[b, r]
                for c in range(3):
                    free[i, r, c] -= basis[b, r] * basis[b, c]


@njit(cache=True, parallel=True)
def _pressure_around(start, count, index, weight, own, rows, place, tool, normal, active, pressing, out):
    for i in prange(active.shape[0]):
        begin, neighbours = start[rows[i]], count[rows[i]]
        for k in range(active.shape[1]):
            if not active[i, k]:
                continue
            total, mass = own * pressing[i, k], own
            for slot in range(begin, begin + neighbours):
                j = place[index[slot]]
                if j < 0:
                    continue
                for m in range(active.shape[1]):
                    if active[j, m] and tool[j, m] == tool[i, k]:
                        a, b = normal[i, k], normal[j, m]
                        if a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > SAME_FACE:
                            total += weight[slot] * pressing[j, m]
                            mass += weight[slot]
            out[i, k] = total / mass


@njit(cache=True, parallel=True)
def _split_reactions(active, normal, force, pressing, forces):
    for i in prange(active.shape[0]):
        faces = np.zeros(3, np.int64)
        m = 0
        for k in range(active.shape[1]):
            if active[i, k]:
                faces[m] = k
                m += 1
        if m == 0:
            continue
        # Least squares of the force on the active normals, with a touch of damping for nearly parallel faces.
        gram, load = np.zeros((3, 3)), np.zeros(3)
        for a in range(3):
            gram[a, a] = 1.0
        for a in range(m):
            na = normal[i, faces[a]]
            load[a] = na[0] * force[i, 0] + na[1] * force[i, 1] + na[2] * force[i, 2]
            for b in range(m):
                nb = normal[i, faces[b]]
                gram[a, b] = na[0] * nb[0] + na[1] * nb[1] + na[2] * nb[2]
            gram[a, a] += 1e-6
        parts = np.linalg.solve(gram, load)
        for a in range(m):
            k = faces[a]
            pressing[i, k] = parts[a]
            for c in range(3):
                forces[i, k, c] = parts[a] * normal[i, k, c]
