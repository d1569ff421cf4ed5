"""Power that the charge takes up, and what it says about the forces of the tools."""

import numpy as np

from ppmc.solver.contact import Contacts
from ppmc.solver.operator import Operator
from ppmc.solver.viscosity import viscous_stress

SCALES = (0.5, 2.0)  # bounds of the correction of reactions by their power
LEAST_WORK = 0.1  # of the power that the charge takes up: below, reactions are left as they are


def power_scale(contacts: Contacts, reactions: np.ndarray, drag: np.ndarray, slide: np.ndarray, body: float) -> float:
    """Factor on reactions that makes the tools' power that of the charge and of sliding on it.

    An error e of the velocities falsifies reactions by A e, the power only by the square of e. With stiff fibres that
    matters: reactions on a jittered block at R = 61,215 scatter by a tenth, their power by a thousandth. And the
    reactions hold the centres of wall layers, while tools press on the faces of cells.

    Parameters
    ----------
    contacts : Contacts
    reactions, drag : ndarray, shape (m, 3, 3)
        Normal and tangential forces of the faces on the particles, Pa mm^2.
    slide : ndarray, shape (m, 3, 3)
        Velocities of the particles relative to the faces, mm/s.
    body : float
        Power that the charge takes up, Pa mm^3/s.

    Returns
    -------
    float
        One where the tools' reactions do next to no work.
    """
    whole = contacts.whole_cells()[:, None, None]
    pressing = float(np.sum(whole * reactions * contacts.wall_velocity))
    sliding = -float(np.sum(whole * drag * (slide + contacts.wall_velocity)))
    if pressing <= max(LEAST_WORK * body, 0.0):
        return 1.0
    return float(np.clip((body + sliding) / pressing, *SCALES))


def material_power(operator: Operator, rate: np.ndarray) -> np.ndarray:
    """Power per volume of the material and its bulk stiffness, without zero-energy control; shape (n,)."""
    stress = viscous_stress(rate, operator.shear, operator.fibre, operator.directions)
    return np.einsum("nij,nij->n", rate, stress) + operator.bulk * np.einsum("nii->n", rate) ** 2
