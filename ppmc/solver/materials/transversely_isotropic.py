"""One fibre direction a particle (J5)."""

from typing import Any

import numpy as np

from ppmc.solver.particles.state import ParticleState


def fibres(section: Any, state: ParticleState, normals: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the stiffness 4 eta23 (R - 1), shape (n, 1), and p, shape (n, 1, 3)."""
    stiffness = 4.0 * section.shear * (section.ratio - 1.0)
    return np.full((len(state), 1), stiffness), state.fibre_direction[:, None, :]
