"""What a frame of the flow history holds, computed from the state."""

import numpy as np

from ppmc.orientation import orthonormal_frame, shear_angle
from ppmc.solver import materials
from ppmc.solver.implicit import ImplicitIntegrator
from ppmc.solver.model import Model
from ppmc.solver.state import ParticleState
from ppmc.solver.viscosity import viscous_stress


def field_names(model: Model) -> tuple[str, ...]:
    """Names of the fields in every frame."""
    names: tuple[str, ...] = (
        "fibre_direction", "deformation_gradient", "volume_ratio", "packing", "velocity", "pressure", "fibre_stress",
        "strain_rate",
    )  # fmt: skip
    if model.settings.transport_normals:
        names += ("in_plane_direction", "platelet_normal", "shear_angle")
    return names


def frame(integrator: ImplicitIntegrator, time: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Positions (n, 3), mm, and fields of the present state, in the charge's order."""
    packing = measure_packing(integrator, time)  # before all else: it may sort the state
    state, model = integrator.state, integrator.model
    normals = None
    if model.material.model in materials.NEEDS_NORMALS:
        normals = model.walls.nearest_normals(state.position, time)
    viscosity = materials.evaluate(model.material, state, normals)
    gradient = state.velocity_gradient
    rate = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
    stress = viscous_stress(rate, viscosity.shear, viscosity.fibre, viscosity.directions)
    deviator = rate - np.einsum("nii->n", rate)[:, None, None] / 3.0 * np.eye(3)
    fields = {
        "fibre_direction": state.fibre_direction,
        "deformation_gradient": state.deformation_gradient.reshape(-1, 9),
        "volume_ratio": state.volume_ratio,
        "packing": packing,
        "velocity": state.velocity,
        "pressure": -model.bulk_modulus * (state.volume_ratio - 1.0),
        "fibre_stress": np.einsum("na,nab,nb->n", state.fibre_direction, stress, state.fibre_direction),
        "strain_rate": np.sqrt(2.0 / 3.0 * np.einsum("nab,nab->n", deviator, deviator)),
    }
    if model.settings.transport_normals:
        fields |= _normal_fields(state)
    return state.in_original_order(state.position), {k: state.in_original_order(v) for k, v in fields.items()}


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
