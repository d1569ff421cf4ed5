"""What a frame of the flow history holds: one snapshot of the particles, in the charge's order.

Measuring the packing may sort the particles anew. A snapshot is therefore taken after that, all arrays with one
permutation, and everything in a frame is computed from the snapshot alone: it knows no integrator that could sort.
"""

from dataclasses import dataclass

import numpy as np

from ppmc.orientation import orthonormal_frame, shear_angle
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.viscosity import viscous_stress
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.step.rheology import Rheology


@dataclass(frozen=True)
class Snapshot:
    """The particles at one instant.

    Attributes
    ----------
    state : ParticleState
        A copy in the charge's order that can neither be written to nor sorted.
    packing : ndarray, shape (n,)
        In the same order.
    time : float
        s.
    """

    state: ParticleState
    packing: np.ndarray
    time: float

    @classmethod
    def take(cls, integrator: ImplicitIntegrator, time: float) -> "Snapshot":
        """Take one of an integrator's state at `time`, s; the integrator may sort its particles for it."""
        packing = measure_packing(integrator, time)
        state = integrator.state
        return cls(state.in_charge_order(), state.in_original_order(packing), time)


def field_names(model: Model) -> tuple[str, ...]:
    """Names of the fields in every frame."""
    names: tuple[str, ...] = (
        "fibre_direction", "deformation_gradient", "volume_ratio", "packing", "velocity", "pressure", "fibre_stress",
        "strain_rate",
    )  # fmt: skip
    if model.settings.transport_normals:
        names += ("in_plane_direction", "platelet_normal", "shear_angle")
    return names


def frame(snapshot: Snapshot, model: Model) -> dict[str, np.ndarray]:
    """Fields of a snapshot, in the charge's order; those of :func:`field_names`."""
    state = snapshot.state
    gradient = state.velocity_gradient
    rate = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
    rheology = Rheology(model, state, snapshot.time)
    stress = viscous_stress(rate, *rheology.viscosities(gradient), rheology.directions)
    deviator = rate - np.einsum("nii->n", rate)[:, None, None] / 3.0 * np.eye(3)
    fields = {
        "fibre_direction": state.fibre_direction,
        "deformation_gradient": state.deformation_gradient.reshape(-1, 9),
        "volume_ratio": state.volume_ratio,
        "packing": snapshot.packing,
        "velocity": state.velocity,
        "pressure": -model.bulk_modulus * (state.volume_ratio - 1.0),
        "fibre_stress": np.einsum("na,nab,nb->n", state.fibre_direction, stress, state.fibre_direction),
        "strain_rate": np.sqrt(2.0 / 3.0 * np.einsum("nab,nab->n", deviator, deviator)),
    }
    if model.settings.transport_normals:
        fields |= _normal_fields(state)
    return fields


def measure_packing(integrator: ImplicitIntegrator, time: float) -> np.ndarray:
    """Packing of each particle, shape (n,), from positions, current volumes and walls."""
    integrator.refresh_neighbours()
    return integrator.packing(integrator.weigh(integrator.state.position), time).value


def _normal_fields(state: ParticleState) -> dict[str, np.ndarray]:
    _, _, normal = orthonormal_frame(state.fibre_direction, state.in_plane_direction)
    return {
        "in_plane_direction": state.in_plane_direction,
        "platelet_normal": normal,
        "shear_angle": shear_angle(state.fibre_direction, state.in_plane_direction),
    }
