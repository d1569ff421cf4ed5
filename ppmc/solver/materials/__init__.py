"""What each viscosity model of the scene means to the operator: a shear viscosity, fibre stiffnesses and directions.

A model is one file with a function ``fibres(section, state, normals) -> (stiffness, directions)`` and one line in
`MODELS`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppmc.solver.materials import newtonian, orientation_mixture, planar_uniform, transversely_isotropic
from ppmc.solver.particles.state import ParticleState

Fibres = Callable[[Any, ParticleState, np.ndarray | None], tuple[np.ndarray, np.ndarray]]

MODELS: dict[str, Fibres] = {
    "newtonian": newtonian.fibres,
    "transversely_isotropic": transversely_isotropic.fibres,
    "orientation_mixture": orientation_mixture.fibres,
    "planar_uniform": planar_uniform.fibres,
}

NEEDS_NORMALS = {"planar_uniform"}


@dataclass
class Viscosity:
    """Viscosity of all particles at one instant.

    Attributes
    ----------
    shear : ndarray, shape (n,)
        eta23, Pa s.
    fibre : ndarray, shape (n, k)
        4 eta23 (R - 1) v_k of each direction, Pa s.
    directions : ndarray, shape (n, k, 3)
        Unit directions p_k.
    """

    shear: np.ndarray
    fibre: np.ndarray
    directions: np.ndarray


def evaluate(section: Any, state: ParticleState, normals: np.ndarray | None = None) -> Viscosity:
    """Return the viscosity of every particle.

    Parameters
    ----------
    section : a section of :mod:`ppmc.scene.sections.material`
    state : ParticleState
    normals : ndarray, shape (n, 3), optional
        Normals of the nearest tool, for models in `NEEDS_NORMALS`.
    """
    fibre, directions = MODELS[section.model](section, state, normals)
    # A copy, for the step turns these directions ahead while the state keeps its own.
    return Viscosity(np.full(len(state), section.shear), fibre, np.array(directions, order="C"))
