"""Power that the charge takes up, and what it says about the forces of the tools."""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.sph.operator import Operator
from ppmc.solver.walls.contact import Contacts

SCALES = (0.5, 2.0)  # bounds of the correction of reactions by their power
LEAST_WORK = 0.1  # of the power that the charge takes up: below, reactions are left as they are


def tool_powers(
    contacts: Contacts, reactions: np.ndarray, drag: np.ndarray, velocities: np.ndarray
) -> tuple[float, float]:
    """Power, Pa mm^3/s, of reactions as they are, and that lost in sliding on the faces.

    Parameters
    ----------
    contacts : Contacts
    reactions, drag : ndarray, shape (m, 3, 3)
        Normal and tangential forces of the faces on the particles, Pa mm^2.
    velocities : ndarray, shape (m, 3)
        Of the particles, mm/s.
    """
    whole = contacts.whole_cells()[:, None, None]
    pressing = float(np.sum(whole * reactions * contacts.wall_velocity))
    return pressing, -float(np.sum(whole * drag * velocities[:, None, :]))


def power_scale(body: float, pressing: float, sliding: float) -> float:
    """Factor on reactions that makes the tools' power that of the charge and of sliding on it.

    An error e of the velocities falsifies reactions by A e, the power only by the square of e. With stiff fibres that
    matters: reactions on a jittered block at R = 61,215 scatter by a tenth, their power by a thousandth. And the
    reactions hold the centres of wall layers, while tools press on the faces of cells.

    Parameters
    ----------
    body : float
        Power that the charge takes up, Pa mm^3/s.
    pressing, sliding : float
        See :func:`tool_powers`.

    Returns
    -------
    float
        One where the tools' reactions do next to no work.
    """
    if pressing <= max(LEAST_WORK * body, 0.0):
        return 1.0
    return float(np.clip((body + sliding) / pressing, *SCALES))


def material_power(
    operator: Operator, gradient: np.ndarray, rows: np.ndarray | slice = slice(None),
    viscosities: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:  # fmt: skip
    """Power per volume of the material and its bulk stiffness, without zero-energy control; shape (m,), Pa/s.

    `gradient`, shape (m, 3, 3), are velocity gradients, 1/s, of the particles in `rows` (m,), all if not given;
    `viscosities`, shapes (m,) and (m, k), Pa s, those in shear and of the fibres, the operator's if not given. It is
    what :func:`ppmc.solver.sph.viscosity.viscous_stress` gives, without arrays in between.
    """
    out = np.empty(len(gradient))
    shear, fibre = (operator.shear[rows], operator.fibre[rows]) if viscosities is None else viscosities
    _power(gradient, shear, operator.bulk[rows], fibre, operator.directions[rows], out)
    return out


@njit(cache=True, parallel=True)
def _power(gradient, shear, bulk, fibre, p, out):
    for i in prange(gradient.shape[0]):
        g = gradient[i]
        trace = g[0, 0] + g[1, 1] + g[2, 2]
        squares = 0.0
        for a in range(3):
            for b in range(3):
                d = 0.5 * (g[a, b] + g[b, a]) - (trace / 3.0 if a == b else 0.0)
                squares += d * d
        total = 2.0 * shear[i] * squares + bulk[i] * trace * trace
        for k in range(p.shape[1]):
            along = -trace / 3.0
            for a in range(3):
                along += p[i, k, a] * (g[a, 0] * p[i, k, 0] + g[a, 1] * p[i, k, 1] + g[a, 2] * p[i, k, 2])
            total += fibre[i, k] * along * along
        out[i] = total
