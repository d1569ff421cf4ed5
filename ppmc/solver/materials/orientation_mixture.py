"""Several directions with volume fractions in one particle (A3)."""

from typing import Any

import numpy as np

from ppmc.solver.particles.state import ParticleState


def fibres(section: Any, state: ParticleState, normals: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffnesses (n, k) and directions (n, k, 3), all convected with F from their angles at the start.

    A direction at angle a is a material line, cos(a) p + sin(a) q at the start. Convected lines keep their components
    on the convected (unnormalised) p and q-hat, whose lengths follow from F.
    """
    angles = np.radians(np.array(section.angles))
    inverse = np.linalg.inv(state.deformation_gradient)
    p0 = _unit(np.einsum("nab,nb->na", inverse, state.fibre_direction))
    q0 = np.einsum("nab,nb->na", inverse, state.in_plane_direction)
    q0 = _unit(q0 - np.einsum("na,na->n", q0, p0)[:, None] * p0)
    lines = np.cos(angles)[None, :, None] * p0[:, None, :] + np.sin(angles)[None, :, None] * q0[:, None, :]
    directions = _unit(np.einsum("nab,nkb->nka", state.deformation_gradient, lines))
    stiffness = 4.0 * section.shear * (section.ratio - 1.0) * np.array(section.fractions)
    return np.broadcast_to(stiffness, (len(state), len(angles))).copy(), directions


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
