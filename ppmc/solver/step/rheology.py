"""The material where an operator stands: from rates to the viscosities that the operator is made with."""

from __future__ import annotations

import numpy as np

from ppmc.materials import LocalState
from ppmc.solver.particles.kernel_shape import smoothness
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.operator import Operator, assemble
from ppmc.solver.sph.transport import convect_directions
from ppmc.solver.step.model import Model
from ppmc.solver.walls.contact import between_wall_layers


class Rheology:
    """A run's material at one set of positions.

    Attributes
    ----------
    local : LocalState
        What the material may know of each particle.
    directions : ndarray, shape (n, k, 3)
        Unit fibre directions, turned ahead to where the operator stands.
    """

    def __init__(
        self, model: Model, state: ParticleState, time: float, positions: np.ndarray | None = None, ahead: float = 0.0
    ) -> None:
        """Look at the particles at `positions` (n, 3), mm, their own if not given, which they reach `ahead` s later."""
        self.model, self.state = model, state
        self.positions = state.position if positions is None else positions
        material = model.material
        normals = model.walls.nearest_normals(self.positions, time) if material.follows_walls else None
        self.local = LocalState(
            state.fibre_direction, state.in_plane_direction, state.deformation_gradient, state.reference_position,
            normals,
        )  # fmt: skip
        # A copy, for the step turns these directions ahead while the state keeps its own.
        self.directions = np.array(material.directions(self.local), order="C")
        if ahead > 0.0 and normals is None:
            for k in range(self.directions.shape[1]):
                turned = np.ascontiguousarray(self.directions[:, k])
                convect_directions(np.eye(3) + ahead * state.velocity_gradient, turned)
                self.directions[:, k] = turned

    def viscosities(self, gradient: np.ndarray, rows: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Shear viscosity (m,) and fibre stiffnesses (m, k), Pa s, of particles whose velocity gradients are given.

        Parameters
        ----------
        gradient : ndarray, shape (m, 3, 3)
            1/s.
        rows : ndarray, shape (m,), optional
            The particles; all if not given.
        """
        material = self.model.material
        rate = np.broadcast_to(np.zeros((3, 3)), gradient.shape)
        if material.rate_dependent:
            rate = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
        if rows is None:
            return material.viscosities(rate, self.directions, self.local)
        return material.viscosities(rate, self.directions[rows], self.local.rows(rows))

    def operator(self, pairs: Pairs, bulk: np.ndarray, gradient: np.ndarray) -> Operator:
        """Operator of the parts of particles that resist.

        Parameters
        ----------
        pairs : Pairs
            At the same positions.
        bulk : ndarray, shape (n,)
            Bulk viscosity of these parts, Pa s.
        gradient : ndarray, shape (n, 3, 3)
            Velocity gradients, 1/s, at which the material's viscosities are taken.
        """
        state, control = self.state, self.model.settings.zero_energy
        shear, fibre = self.viscosities(gradient)
        share = between_wall_layers(state.wall_layers)
        return assemble(
            pairs, self.positions, state.volume, shear * share, bulk, fibre * share[:, None], self.directions,
            control.isotropic, control.bond, control.fibre,
            control.smooth_flow * smoothness(state.flow_residual) * shear * share,
        )  # fmt: skip
