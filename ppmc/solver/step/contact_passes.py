"""Velocities and touching faces of a step: solves with given contacts, until neither is to change.

Which faces are met shows long before the velocities are exact, so only the last pass is solved to the wanted tolerance.
Which faces are let go shows later: with stiff fibres reactions may be noise where the velocities are right to a
thousandth. A face that seems to pull is therefore looked at again by a solve that tells.
"""

import numpy as np

from ppmc.solver.linear.block_jacobi import restricted_inverse
from ppmc.solver.linear.coarse_grid import CELL, CoarseGrid, make_grid
from ppmc.solver.linear.conjugate_gradient import Solution, conjugate_gradient
from ppmc.solver.linear.force_error import force_error
from ppmc.solver.linear.rigid_modes import Pieces, free_rigid_modes
from ppmc.solver.linear.system import VelocitySystem
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.flow_laws import LARGE, LAST_CHANGE, MOST_LAW_PASSES, FlowLaws
from ppmc.solver.step.model import Model, StepReport
from ppmc.solver.step.tool_loads import held_by_air, held_pressure, wall_drag
from ppmc.solver.walls.contact import Contacts

RELEASE = 1e-3  # pull, in mean pressing reactions, that releases a contact
# Error of the mean reaction around a face, in parts of the residual around it, that a pull must exceed: the most seen
# among some hundred faces.
DOUBT = 2.0
NEGLIGIBLE, DEEPEST = 1e-3, 0.01  # penetration in spacings: not worth a pass; worth one beyond those allowed
SPARE_PASSES = 2  # of such passes
# Reactions that are round-off, in parts of stiffness times speed: all there is where tools only take a charge along.
ROUNDING = 1e-8
ROUGH = 10.0  # factor on the tolerances while it is open which faces touch
# Velocity tolerance with which faces let go. Of a collimated disc at R = 61,215, where none does, 12 % let go in four
# steps at 5e-4, 30 % at 2e-3, and half a per cent at 1e-4, those at its ragged rim.
SURE = 1e-4
ROUGH_WINDOW, WINDOW = 4, 8  # iterations between estimates of the error


def solve_with_contacts(
    model: Model, state: ParticleState, laws: FlowLaws, contacts: Contacts, time_step: float, report: StepReport,
    negligible: float, pieces: Pieces,
) -> Solution:  # fmt: skip
    """Find the velocities of a step and the faces that touch.

    Parameters
    ----------
    model : Model
    state : ParticleState
        At the beginning of the step.
    laws : FlowLaws
        With the operator; at the end its laws are those of the velocities found.
    contacts : Contacts
        Its `active` are where the search begins and, at the end, what touches.
    time_step : float
        s.
    report : StepReport
        Iterations, passes and errors are added.
    negligible : float
        Speed of the charge, mm/s, below which it is not worth resolving.
    pieces : Pieces
        Of the charge, at the operator's positions.

    Returns
    -------
    Solution
    """
    inertia, rows = (model.density / time_step) * state.volume, contacts.rows
    load = inertia[:, None] * state.velocity
    load -= laws.operator.pressure_force(held_pressure(model, state))
    velocities, wanted = state.velocity, model.settings.velocity_tolerance
    last = model.settings.contact_passes - 1
    blocks: np.ndarray | None = None
    sure = min(SURE / wanted, 1.0)
    attempt, rough = 0, 1.0 if last == 0 else ROUGH
    coarse: CoarseGrid | None = None
    while True:
        operator = laws.operator
        if blocks is None:
            blocks = operator.diagonal()
            blocks[:, :3] += inertia[:, None]
            stiffness = float(blocks[:, :3].mean())
        faces = wall_drag(model, state, contacts, operator)
        drag, right_side = np.zeros((len(rows), 3, 3)), load
        if len(faces):
            drag, right_side = faces.sum(axis=1), load.copy()
            right_side[rows] += np.einsum("nkab,nkb->na", faces, contacts.wall_velocity)
        free, held = contacts.constrain(time_step)
        inverse = restricted_inverse(blocks, rows, drag, free)
        system = VelocitySystem(operator, inertia, rows, drag, free, inverse)
        if coarse is None and model.settings.coarse_level:
            coarse = _coarse_grid(model, system, blocks)
        system.coarse = coarse
        system.rigid = free_rigid_modes(pieces, model.density / time_step, rows, free, drag, stiffness)
        # Without inertia what is free keeps no momentum. It can neither strain the charge nor meet a tool.
        settle = system.rigid.rest if model.density == 0.0 else np.asarray
        power_tolerance = max(rough, 1.0) * model.settings.power_tolerance
        solution = conjugate_gradient(
            system.apply, system.project, system.precondition, right_side,
            settle(system.feasible(velocities, held)), tolerance=rough * wanted,
            max_iterations=model.settings.max_iterations, power_tolerance=power_tolerance,
            window=WINDOW if rough <= 1.0 else ROUGH_WINDOW, negligible=negligible,
        )  # fmt: skip
        velocities = settle(solution.velocities)
        report.iterations += solution.iterations
        report.passes += 1
        report.estimated_error = solution.estimated_error
        # A solve that was only to tell which faces let go has been as exact as wanted before.
        report.unconverged += not solution.converged and rough >= 1.0
        error = laws.error(velocities, negligible)
        # What flows too slowly to be resolved does not tell what its faces bear.
        flows = float(np.sqrt(np.mean(velocities**2))) > negligible
        may_release = attempt < last and flows and rough <= 1.0 and solution.converged
        added, released, deepest = _changes(
            model, state, contacts, system, solution, time_step, may_release, ROUNDING * stiffness
        )
        if released.any() and rough > sure:
            contacts.active |= added
            rough = sure
            del system, solution, inverse
            continue
        settled = not (added.any() or released.any())
        enough = attempt >= last and (attempt >= last + SPARE_PASSES or deepest < DEEPEST * model.spacing)
        agreed = error <= LAST_CHANGE * wanted
        if (enough or (settled and rough <= 1.0)) and (agreed or report.passes >= MOST_LAW_PASSES):
            report.unconverged += not agreed
            return solution
        laws.follow(velocities, solution.residual, settled)
        contacts.active = (contacts.active & ~released) | added
        if laws.operator is not operator:
            blocks = None
        if error > LARGE:
            coarse = None
        # What the pass held makes room for the next.
        del system, solution, inverse
        attempt = attempt if settled else attempt + 1
        rough = ROUGH if (not settled and attempt < last) or error > ROUGH * wanted else 1.0


def _changes(
    model: Model, state: ParticleState, contacts: Contacts, system: VelocitySystem, solution: Solution,
    time_step: float, may_release: bool, rounding: float,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Faces to add and to release, both (m, 3), and the deepest penetration, mm.

    `rounding`, Pa s mm, is the force that round-off may make, for a speed.
    """
    pressing, _ = contacts.reactions(-solution.residual[contacts.rows])
    depth = contacts.violations(solution.velocities[contacts.rows], time_step)
    added, released = depth > NEGLIGIBLE * model.spacing, np.zeros_like(contacts.active)
    # In the last pass nothing is released: a small pull for one step does less harm than a penetration.
    if may_release:
        pairs, h = system.operator.pairs, model.smoothing_length
        doubt = DOUBT * force_error(system.project(solution.residual), contacts.rows, pairs, h)
        doubt = np.maximum(doubt, rounding * float(np.sqrt(np.mean(solution.velocities**2))))
        released = pulled_off(model, state, contacts, pairs, pressing, doubt[:, None])
    return added, released, float(depth.max(initial=0.0))


def pulled_off(
    model: Model, state: ParticleState, contacts: Contacts, pairs: Pairs, pressing: np.ndarray,
    doubt: np.ndarray | float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Touched faces (m, 3) that let go: the charge around them pulls by more than the air withstands.

    `pressing`, shape (m, 3), Pa mm^2, are the normal reactions; see :meth:`Contacts.reactions`. `doubt`, that of a
    particle or a face, Pa mm^2, is by how much their means may be wrong: a pull within it may be none.
    """
    positive = pressing[pressing > 0.0]
    limit = np.full(pressing.shape, RELEASE * float(positive.mean()) if len(positive) else 0.0) + doubt
    if model.settings.ambient_pressure > 0.0:
        limit += held_by_air(model, state, contacts)
    around = contacts.pressure_around(pressing, pairs, model.smoothing_length)
    return contacts.active & (around < -limit)


def _coarse_grid(model: Model, system: VelocitySystem, blocks: np.ndarray) -> CoarseGrid:
    """Coarse level of the preconditioner, for all passes of a step: it need not know the last faces that touch."""
    operator = system.operator
    grid = make_grid(operator.positions, CELL * model.spacing, len(operator.pairs.index))
    # What a tool holds is as stiff for the grid as the particle itself: the grid then leaves it alone.
    own = blocks[system.rows, :3].mean(axis=1)
    hold = own[:, None, None] * (np.eye(3) - system.free) + system.drag
    grid.stiffen(operator, system.inertia, system.rows, hold)
    return grid
