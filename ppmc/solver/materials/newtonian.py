"""Newtonian fluid: no fibres."""

from typing import Any

import numpy as np

from ppmc.solver.particles.state import ParticleState


def fibres(section: Any, state: ParticleState, normals: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return empty stiffnesses (n, 0) and directions (n, 0, 3)."""
    return np.zeros((len(state), 0)), np.zeros((len(state), 0, 3))
