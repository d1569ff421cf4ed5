r"""Unilateral contact with rigid tools, without a penalty stiffness.

Each particle may touch up to three tool faces at once. The gap to a face is the signed distance less the particle's
own deformed half-width, :math:`g = \phi(x) - w\sqrt{n\cdot F F^T n}`, and the velocity must satisfy :math:`n\cdot(v -
v_{tool}) \ge -g/\Delta t`. The directions of active constraints are projected out of the velocity solve; the residual
in them is the reaction. Reactions that pull release a constraint, violated ones are added.

The centres of the wall layer lie half a layer inside the charge and approach the tool as they flatten, so the
reactions do their work on less than the tool's motion, and their sum is too high by h/(h - 2w) in a gap h.
`power_factor` brings the sums back to the forces that are conjugate to the tools' motion.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange

FACES = 3  # faces a particle can touch at once
HALF_WIDTH_BOUNDS = (0.2, 1.3)  # of the reference half-width
PARALLEL = 0.05  # sine below which two faces are taken for one


@dataclass
class Contacts:
    """Faces near each particle in one step, and which of them are active.

    Attributes
    ----------
    tool : ndarray, shape (n, 3), int32
        Tool of each face, -1 for none.
    normal : ndarray, shape (n, 3, 3)
        Unit normals out of the tool, normal[i, k] belongs to tool[i, k].
    half_width : ndarray, shape (n, 3)
        Deformed half-width of the particle along the normal, mm.
    gap : ndarray, shape (n, 3)
        Distance that the particle may approach, mm.
    wall_velocity : ndarray, shape (n, 3, 3)
        Mean velocity of the tool's face over the step, mm/s.
    sticks : ndarray, shape (n, 3), bool
        No-slip faces: all three components are held while the face is touched.
    active : ndarray, shape (n, 3), bool
    """

    tool: np.ndarray
    normal: np.ndarray
    half_width: np.ndarray
    gap: np.ndarray
    wall_velocity: np.ndarray
    sticks: np.ndarray
    active: np.ndarray

    def constrain(self, time_step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the projections onto free directions (n, 3, 3) and the held velocities (n, 3)."""
        n = len(self.tool)
        free, held = np.empty((n, 3, 3)), np.empty((n, 3))
        _constrain(self.active, self.normal, self.gap, self.wall_velocity, self.sticks, time_step, free, held)
        return free, held

    def reactions(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split the tools' forces on the particles (n, 3), Pa mm^2, by face.

        Returns
        -------
        pressing : ndarray, shape (n, 3)
            Normal part at each face, positive when it presses.
        forces : ndarray, shape (n, 3, 3)
            Force vector from each face on the particle.
        """
        pressing, forces = np.zeros((len(force), FACES)), np.zeros((len(force), FACES, 3))
        _split_reactions(self.active, self.normal, self.sticks, force, pressing, forces)
        return pressing, forces

    def power_factor(self, forces: np.ndarray, velocities: np.ndarray) -> float:
        """Work of the reactions on the particles over their work on the tools' motion; 1 if no tool moves.

        Parameters
        ----------
        forces : ndarray, shape (n, 3, 3)
            Force of each face on the particle, Pa mm^2.
        velocities : ndarray, shape (n, 3) or (n, 3, 3)
            Velocities of the particles, mm/s, or one for each face.
        """
        moving = velocities[:, None, :] if velocities.ndim == 2 else velocities
        forces = np.where(self.active[..., None], forces, 0.0)
        on_tools = float(np.sum(forces * self.wall_velocity))
        on_particles = float(np.sum(forces * moving))
        scale = float(np.sum(np.abs(forces * self.wall_velocity)))
        return on_particles / on_tools if on_tools > 1e-6 * scale else 1.0

    def violations(self, velocities: np.ndarray, time_step: float) -> np.ndarray:
        """Penetration of inactive faces at the end of the step, shape (n, 3), mm; zero where there is none."""
        approach = np.einsum("nkc,nkc->nk", self.normal, velocities[:, None, :] - self.wall_velocity) * time_step
        depth = -(approach + self.gap)
        return np.where((self.tool >= 0) & ~self.active & (depth > 0.0), depth, 0.0)


def half_widths(reference: np.ndarray, deformation_gradient: np.ndarray, normals: np.ndarray) -> np.ndarray:
    r"""Half-width of particles along wall normals, :math:`w\sqrt{n\cdot F F^T n}` within bounds.

    Parameters
    ----------
    reference : ndarray, shape (n,)
        Half-width w at the start, mm.
    deformation_gradient : ndarray, shape (n, 3, 3)
    normals : ndarray, shape (n, 3)

    Returns
    -------
    ndarray, shape (n,), mm
    """
    stretch = np.linalg.norm(np.einsum("nab,na->nb", deformation_gradient, normals), axis=1)
    return reference * np.clip(stretch, *HALF_WIDTH_BOUNDS)


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


@njit(cache=True, parallel=True)
def _constrain(active, normal, gap, wall_velocity, sticks, dt, free, held):
    for i in prange(active.shape[0]):
        basis, level = np.zeros((3, 3)), np.zeros(3)
        rank = 0
        stuck = -1
        for k in range(active.shape[1]):
            if not active[i, k]:
                continue
            target = -gap[i, k] / dt
            for c in range(3):
                target += normal[i, k, c] * wall_velocity[i, k, c]
            if sticks[i, k]:
                stuck = k
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
        if stuck >= 0:
            # Tangential motion follows the sticking wall, normal motion the constraints above.
            for r in range(3):
                for c in range(3):
                    held[i, r] += free[i, r, c] * wall_velocity[i, stuck, c]
            free[i, :, :] = 0.0


@njit(cache=True, parallel=True)
def _split_reactions(active, normal, sticks, force, pressing, forces):
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
        rest = force[i].copy()
        for a in range(m):
            k = faces[a]
            pressing[i, k] = parts[a]
            for c in range(3):
                forces[i, k, c] = parts[a] * normal[i, k, c]
                rest[c] -= forces[i, k, c]
        for a in range(m):
            if sticks[i, faces[a]]:
                for c in range(3):
                    forces[i, faces[a], c] += rest[c]
                break
