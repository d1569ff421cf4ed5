"""What a solve says about the tools: drag of their faces, forces and moments on them, and the power they give."""

import numpy as np

from ppmc.errors import NumericalError
from ppmc.solver.linear.conjugate_gradient import Solution
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.gradient import velocity_gradient
from ppmc.solver.sph.operator import Operator
from ppmc.solver.sph.power import material_power, power_scale, tool_powers
from ppmc.solver.step.model import Model, Place, StepReport, Touched
from ppmc.solver.walls.contact import FACES, Contacts, between_wall_layers
from ppmc.solver.walls.wall_layer import layer_drag, sheared


def wall_drag(
    model: Model, state: ParticleState, contacts: Contacts, operator: Operator, on: np.ndarray | None = None
) -> np.ndarray:
    """Drag of Navier and no-slip walls at each face, shape (m, 3, 3, 3), Pa s mm; (0, 3, 3, 3) if all slip.

    The particle's part at a face resists, as in its contact forces. `on`, shape (m, 3), are the faces that count:
    those that touch if not given. Wall layers in `state` must be those that the operator was made with.
    """
    rows = contacts.rows
    if not model.walls.rub:
        return np.zeros((0, FACES, 3, 3))
    share = between_wall_layers(state.wall_layers[rows])
    return layer_drag(
        contacts, _slip_lengths(model, contacts, contacts.active if on is None else on),
        _resisting_areas(state, contacts), operator.shear[rows] / share, operator.fibre[rows] / share[:, None],
        operator.directions[rows],
    )  # fmt: skip


def face_areas(state: ParticleState, contacts: Contacts) -> np.ndarray:
    """Area, mm^2, with which each particle near a tool lies at each face, shape (m, 3)."""
    return contacts.areas(state.volume[contacts.rows] * state.volume_ratio[contacts.rows])


def touched_faces(contacts: Contacts, areas: np.ndarray) -> Touched:
    """Return the faces that touch; `areas`, shape (m, 3), mm^2, are those of all faces near."""
    on = contacts.active
    return Touched(contacts.tool[on], contacts.normal[on], areas[on])


def held_by_air(model: Model, state: ParticleState, contacts: Contacts) -> np.ndarray:
    """Pull that the ambient pressure withstands at each face, shape (m, 3), Pa mm^2, for the part that resists."""
    return model.settings.ambient_pressure * _resisting_areas(state, contacts)


def _resisting_areas(state: ParticleState, contacts: Contacts) -> np.ndarray:
    """The part of each face's area, shape (m, 3), mm^2, with which a particle in several wall layers resists."""
    return face_areas(state, contacts) / contacts.whole_cells()[:, None]


def _slip_lengths(model: Model, contacts: Contacts, on: np.ndarray) -> np.ndarray:
    """Inverse friction, mm/(Pa s), of the faces `on`, shape (m, 3); infinite at all others."""
    return np.where(on, model.walls.slip_lengths(contacts), np.inf)


def in_half_cells(
    model: Model, state: ParticleState, contacts: Contacts, drag: np.ndarray, slide: np.ndarray, gradient: np.ndarray
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Velocity gradients (m, 3, 3), 1/s, behind wall layers, and the power, uN mm/s, of shear over walls that rub.

    Parameters
    ----------
    drag : ndarray, shape (m, 3, 3, 3)
        See :func:`wall_drag`.
    slide : ndarray, shape (m, 3, 3)
        Velocities of the particles against each face, mm/s.
    gradient : ndarray, shape (m, 3, 3)
        Of the particles, 1/s.
    """
    slip = _slip_lengths(model, contacts, contacts.active)
    behind, power = sheared(contacts, slip, _resisting_areas(state, contacts), drag, slide, gradient)
    return behind, float(np.sum(contacts.whole_cells() * power))


def held_pressure(model: Model, state: ParticleState) -> np.ndarray:
    """Pressure times volume, Pa mm^3, of the part of each particle that resists, shape (n,); positive where swollen."""
    pressure = model.bulk_modulus * state.volume * (state.volume_ratio - 1.0)
    pressure *= between_wall_layers(state.wall_layers)
    return pressure


def account(
    model: Model, state: ParticleState, operator: Operator, contacts: Contacts, solution: Solution, time_step: float,
    report: StepReport,
) -> None:  # fmt: skip
    """Put dissipation, forces, moments and contacts of a solve into its report.

    Parameters
    ----------
    model : Model
    state : ParticleState
        At the beginning of the step.
    operator : Operator
    contacts : Contacts
    solution : Solution
    time_step : float
        s.
    report : StepReport

    Raises
    ------
    ppmc.errors.NumericalError
        If velocities are not finite.
    """
    v = solution.velocities
    if not np.all(np.isfinite(v)):
        raise NumericalError(
            f"{int(np.sum(~np.isfinite(v).all(axis=1)))} particles have velocities that are not finite"
        )
    resisted = operator.apply(v)
    total = float(np.sum(v * resisted))
    gradient = velocity_gradient(operator.pairs, operator.positions, operator.volumes, operator.inverse, v)
    power, swelling = material_power(operator, gradient), np.einsum("nii->n", gradient)
    del resisted
    physical = float(np.sum(operator.volumes * power))
    # Pressure that builds up or dies down in the step is no dissipation.
    stored = float(np.sum(operator.volumes * operator.bulk * swelling**2))
    report.dissipation = total - stored
    released = -float(np.sum(held_pressure(model, state) * swelling)) - stored
    moving = model.density > 0.0 or bool(contacts.wall_velocity[contacts.active].any())
    report.driven_share = driven_share(report.dissipation, released) if moving else 0.0
    report.zero_energy_share = max(0.0, (total - physical) / report.dissipation) if report.dissipation > 0.0 else 0.0
    _, forces = contacts.reactions(-solution.residual[contacts.rows])
    slide = v[contacts.rows, None, :] - contacts.wall_velocity
    faces = wall_drag(model, state, contacts, operator)
    drag = -np.einsum("nkab,nkb->nka", faces, slide) if len(faces) else np.zeros_like(slide)
    rubbed = -float(np.sum(contacts.whole_cells()[:, None, None] * drag * slide))
    shares = between_wall_layers(state.wall_layers)
    power /= shares
    lost = 0.0
    if len(faces):
        share = shares[contacts.rows]
        behind, lost = in_half_cells(model, state, contacts, faces, slide, gradient[contacts.rows])
        power[contacts.rows] *= share
        power[contacts.rows] += (1.0 / share - 1.0) * material_power(operator, behind, contacts.rows)
    del gradient
    body = _body_power(model, state, power, swelling, v, time_step) + total - physical - lost
    # Heat of whole cells and at walls; so far it was that of the parts that resist.
    kept = operator.bulk / shares * swelling**2
    report.dissipation = float(np.sum(operator.volumes * (power - kept))) + total - physical + rubbed - lost
    forces *= power_scale(body, *tool_powers(contacts, forces, drag, v[contacts.rows]))
    add_tool_loads(model, contacts, forces + drag, operator.positions[contacts.rows], report)
    report.contacts = int(contacts.active.any(axis=1).sum())
    report.touched = touched_faces(contacts, face_areas(state, contacts))
    # Of touched faces, too: between two that close on it a particle can obey one only.
    depth = -contacts.departures(v[contacts.rows], time_step).min(axis=1, initial=0.0)
    report.penetration = float(depth.max(initial=0.0))
    if report.penetration > 0.0:
        row = int(contacts.rows[np.argmax(depth)])
        x1, x2, x3 = (state.position[row] + time_step * v[row]).tolist()
        report.deepest = Place(int(state.original[row]), (x1, x2, x3))


def driven_share(dissipation: float, released: float) -> float:
    """Share of a dissipation that tools and inertia give, where pressure that dies down has `released` the rest.

    Both in uN mm/s; what pressure takes up counts negative.
    """
    return float(np.clip(1.0 - released / dissipation, 0.0, 1.0)) if dissipation > 0.0 else 1.0


def add_tool_loads(
    model: Model, contacts: Contacts, forces: np.ndarray, positions: np.ndarray, report: StepReport
) -> None:
    """Add what the particles exert on the tools to a report.

    Forces act at the centres of wall layers, where the charge is in balance with them. A half-cell that is sheared
    passes a couple on as well, the traction along the wall times its width: taken at the wall, it would be lost.

    Parameters
    ----------
    model : Model
    contacts : Contacts
    forces : ndarray, shape (m, 3, 3)
        Forces of the faces on the particles, Pa mm^2.
    positions : ndarray, shape (m, 3)
        Of these particles, mm.
    report : StepReport
    """
    if len(report.tool_force) == 0:
        report.tool_force = np.zeros((len(model.walls.tools), 3))
        report.tool_moment = np.zeros((len(model.walls.tools), 3))
    whole = contacts.whole_cells()
    for k in range(contacts.tool.shape[1]):
        on = contacts.active[:, k]
        tool, force = contacts.tool[on, k], -whole[on, None] * forces[on, k]
        np.add.at(report.tool_force, tool, force)
        np.add.at(report.tool_moment, tool, np.cross(positions[on], force))


def _body_power(
    model: Model, state: ParticleState, power: np.ndarray, swelling: np.ndarray, velocities: np.ndarray,
    time_step: float,
) -> float:  # fmt: skip
    """Power, Pa mm^3/s, that the charge takes up, the half-cells behind wall layers included.

    `power` per volume of whole cells and divergence `swelling` are (n,), velocities (n, 3).
    """
    pressure = model.bulk_modulus * (state.volume_ratio - 1.0)
    whole = float(np.sum(state.volume * (power + pressure * swelling)))
    if model.density == 0.0:
        return whole
    gained = velocities * (velocities - state.velocity)
    return whole + model.density / time_step * float(np.sum(state.volume[:, None] * gained))
