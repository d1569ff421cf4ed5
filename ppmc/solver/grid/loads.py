"""What a solve on the grid says about the tools: forces and moments on them, and the power that they give."""

import numpy as np

from ppmc.errors import NumericalError
from ppmc.solver.grid.passes import GridSolution
from ppmc.solver.grid.recover import Recovered
from ppmc.solver.grid.wall_points import WallPoints
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.model import Model, Place, StepReport
from ppmc.solver.step.tool_loads import driven_share, face_areas, touched_faces
from ppmc.solver.walls.contact import Contacts


def account(
    model: Model, state: ParticleState, contacts: Contacts, points: WallPoints, solution: GridSolution,
    found: Recovered, excess: np.ndarray, time_step: float, report: StepReport,
) -> None:  # fmt: skip
    """Put dissipation, forces, moments and contacts of a solve into its report.

    Parameters
    ----------
    model : Model
    state : ParticleState
        At the beginning of the step.
    contacts, points, solution, found
        Of the solve.
    excess : ndarray, shape (n,)
        K (J - 1) at the beginning of the step, Pa.
    time_step : float
        s.
    report : StepReport

    Raises
    ------
    NumericalError
        If velocities are not finite.
    """
    if not np.all(np.isfinite(found.velocity)):
        wrong = int(np.sum(~np.isfinite(found.velocity).all(axis=1)))
        raise NumericalError(f"{wrong} particles have velocities that are not finite")
    here = points.velocities(solution.nodal)
    rubbed = -float(np.sum(solution.drag * (here - points.wall)))
    report.dissipation = found.viscous + found.air + rubbed
    swelling = np.einsum("naa->n", found.gradient)
    released = -float(np.sum(state.volume * state.volume_ratio * excess * swelling)) - found.bulk
    moving = bool(contacts.wall_velocity[contacts.active].any())
    report.driven_share = driven_share(report.dissipation, released) if moving else 0.0
    report.zero_energy_share = found.air / report.dissipation if report.dissipation > 0.0 else 0.0
    tools = len(model.walls.tools)
    report.tool_force, report.tool_moment = np.zeros((tools, 3)), np.zeros((tools, 3))
    tool, force = contacts.tool[points.row, points.face], -(solution.force + solution.drag)
    np.add.at(report.tool_force, tool, force)
    np.add.at(report.tool_moment, tool, np.cross(points.position, force))
    report.contacts = int(contacts.active.any(axis=1).sum())
    report.touched = touched_faces(contacts, face_areas(state, contacts))
    depth = -points.departures(here, time_step)
    report.penetration = float(depth.max(initial=0.0))
    if report.penetration > 0.0:
        row = int(contacts.rows[points.row[np.argmax(depth)]])
        x1, x2, x3 = (state.position[row] + time_step * found.velocity[row]).tolist()
        report.deepest = Place(int(state.original[row]), (x1, x2, x3))
