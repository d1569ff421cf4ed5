"""The material where an operator stands: from rates to the viscosities that the operator is made with."""

from __future__ import annotations

import numpy as np

from ppmc.errors import SceneError
from ppmc.materials import LocalState, Material
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
        if self.directions.ndim != 3 or self.directions.shape[::2] != (len(state), 3):
            raise SceneError(
                f"material {type(material).__name__}: directions() gave an array of shape {self.directions.shape}; "
                f"({len(state)}, k, 3) is wanted, a unit vector for each of k directions of every particle"
            )
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
        directions, local = self.directions, self.local
        if rows is not None:
            directions, local = directions[rows], local.rows(rows)
        shear, stiffness = material.viscosities(rate, directions, local)
        # Where rates are not finite the flow is to blame, and said to be.
        if np.isfinite(rate).all():
            _check(material, shear, stiffness, directions)
        return shear, stiffness

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


def _check(material: Material, shear: np.ndarray, stiffness: np.ndarray, directions: np.ndarray) -> None:
    """Refuse viscosities that a material cannot have.

    Raises
    ------
    SceneError
        If they have another shape than wanted, or are not finite and positive.
    """
    told = f"material {type(material).__name__}: viscosities() gave"
    wanted = directions.shape[:1], directions.shape[:2]
    if (shear.shape, stiffness.shape) != wanted:
        raise SceneError(
            f"{told} arrays of shapes {shear.shape} and {stiffness.shape}, not {wanted[0]} and {wanted[1]}"
        )
    for name, values, good in (
        ("shear viscosity", shear, (shear > 0.0) & np.isfinite(shear)),
        ("fibre stiffness", stiffness, (stiffness >= 0.0) & np.isfinite(stiffness)),
    ):
        if not good.all():
            raise SceneError(f"{told} a {name} of {values[~good][0]:g} Pa s; all must be finite and positive")
