"""What a solve says about the tools: drag of their faces, forces and moments on them, and the power they give."""

from dataclasses import dataclass

import numpy as np

from ppmc.errors import NumericalError
from ppmc.solver.linear.conjugate_gradient import Solution
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.gradient import velocity_gradient
from ppmc.solver.sph.operator import Operator
from ppmc.solver.sph.power import material_power, power_scale, tool_powers
from ppmc.solver.step.model import Model, Place, StepReport, Touched
from ppmc.solver.walls.contact import FACES, Contacts, between_wall_layers
from ppmc.solver.walls.sliding import slip_lengths
from ppmc.solver.walls.wall_layer import layer_drag, sheared


def wall_drag(
    model: Model, state: ParticleState, contacts: Contacts, operator: Operator, on: np.ndarray | None = None
) -> np.ndarray:
    """Drag of walls that rub at each face, shape (m, 3, 3, 3), Pa s mm; (0, 3, 3, 3) if all slip.

    The particle's part at a face resists, as in its contact forces. `on`, shape (m, 3), are the faces that count:
    those that touch if not given. Wall layers in `state` must be those that the operator was made with.
    """
    if not model.walls.rub:
        return np.zeros((0, FACES, 3, 3))
    on = contacts.active if on is None else on
    return _drag(state, contacts, operator, np.where(on, contacts.slip_length, np.inf))


def _drag(state: ParticleState, contacts: Contacts, operator: Operator, slip_length: np.ndarray) -> np.ndarray:
    """Drag of faces with given slip lengths (m, 3), mm/(Pa s); shape (m, 3, 3, 3), Pa s mm."""
    rows = contacts.rows
    if contacts.half_cells is None:
        share = between_wall_layers(state.wall_layers[rows])
        shear, fibre = operator.shear[rows] / share, operator.fibre[rows] / share[:, None]
    else:
        shear, fibre = contacts.half_cells
    areas = _resisting_areas(state, contacts)
    return layer_drag(contacts, slip_length, areas, shear, fibre, operator.directions[rows])


def slide_on(
    model: Model, state: ParticleState, contacts: Contacts, operator: Operator, pressing: np.ndarray,
    velocities: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Slip lengths of all faces, shape (m, 3), mm/(Pa s), where the sliding and the pressure found decide them.

    Parameters
    ----------
    pressing : ndarray, shape (m, 3)
        Normal reactions, see :meth:`Contacts.reactions`, scaled as the tools' forces are; walls feel their mean around
        each face.
    velocities : ndarray, shape (m, 3)
        Of the particles near tools, mm/s.
    """
    on, out = contacts.active & model.walls.bending(contacts.tool), contacts.slip_length.copy()
    if not on.any():
        return out
    areas = _resisting_areas(state, contacts)[on]
    stiffness = _drag(state, contacts, operator, np.where(on, 0.0, np.inf))[on] / areas[:, None, None]
    values, axes = np.linalg.eigh(stiffness)
    slide = (velocities[:, None, :] - contacts.wall_velocity)[on]
    slide = np.einsum("fca,fc->fa", axes, slide)
    around = np.maximum(contacts.pressure_around(pressing, operator.pairs, model.smoothing_length)[on], 0.0)
    whole = np.broadcast_to(contacts.whole_cells()[:, None], on.shape)[on]
    tool, found = contacts.tool[on], np.empty(len(areas))
    for number in np.unique(tool):
        of_it = tool == number
        # What the means of all faces add up to is what presses on the tool.
        share = whole[of_it] * around[of_it]
        pressure = (
            around / areas * max(float(np.sum(whole * pressing[on], where=of_it)), 0.0) / max(share.sum(), 1e-300)
        )
        found[of_it] = slip_lengths(model.walls.laws[number], values[of_it], slide[of_it], pressure[of_it])
    out[on] = found
    return out


def half_cell_power(
    state: ParticleState, contacts: Contacts, operator: Operator, gradient: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """Power, shape (m,), Pa/s, per volume of the parts of particles that resist, at the rates of half-cells.

    `gradient`, shape (m, 3, 3), 1/s, is that in the half-cells; see :func:`in_half_cells`.
    """
    if contacts.half_cells is None:
        return material_power(operator, gradient, rows)
    share = between_wall_layers(state.wall_layers[rows])
    shear, fibre = contacts.half_cells
    return material_power(operator, gradient, rows, (share * shear, share[:, None] * fibre))


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
    slip = np.where(contacts.active, contacts.slip_length, np.inf)
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
    found = power_balance(model, state, operator, contacts, v, solution.residual, time_step)
    report.dissipation = found.total - found.stored
    released = -float(np.sum(held_pressure(model, state) * found.swelling)) - found.stored
    moving = model.density > 0.0 or bool(contacts.wall_velocity[contacts.active].any())
    control = found.total - found.physical
    report.driven_share = driven_share(report.dissipation, released) if moving else 0.0
    report.zero_energy_share = max(0.0, control / report.dissipation) if report.dissipation > 0.0 else 0.0
    # Heat of whole cells and at walls; so far it was that of the parts that resist.
    shares = between_wall_layers(state.wall_layers)
    kept = operator.bulk / shares * found.swelling**2
    heat = float(np.sum(operator.volumes * (found.power - kept)))
    report.dissipation = heat + found.total - found.physical + found.rubbed - found.lost
    forces = found.forces * found.scale
    add_tool_loads(model, contacts, forces + found.drag, operator.positions[contacts.rows], report)
    report.contacts = int(contacts.active.any(axis=1).sum())
    report.touched = touched_faces(contacts, face_areas(state, contacts))
    # Of touched faces, too: between two that close on it a particle can obey one only.
    depth = -contacts.departures(v[contacts.rows], time_step).min(axis=1, initial=0.0)
    report.penetration = float(depth.max(initial=0.0))
    if report.penetration > 0.0:
        row = int(contacts.rows[np.argmax(depth)])
        x1, x2, x3 = (state.position[row] + time_step * v[row]).tolist()
        report.deepest = Place(int(state.original[row]), (x1, x2, x3))


@dataclass(frozen=True)
class PowerBalance:
    """Powers of a solve, uN mm/s, and the forces of the tools that go with them.

    Attributes
    ----------
    total, physical, stored : float
        Of the parts of particles that resist: v . A v, that without zero-energy control, and what pressure stores.
    rubbed, lost : float
        Turned into heat at walls, and in the half-cells there.
    power, swelling : ndarray, shape (n,)
        Power per volume of whole cells, Pa/s, and divergence, 1/s.
    forces, drag : ndarray, shape (m, 3, 3)
        Of the faces on the particles, Pa mm^2, across and along the walls.
    scale : float
        Factor on `forces`, see :func:`ppmc.solver.sph.power.power_scale`.
    """

    total: float
    physical: float
    stored: float
    rubbed: float
    lost: float
    power: np.ndarray
    swelling: np.ndarray
    forces: np.ndarray
    drag: np.ndarray
    scale: float


def power_balance(
    model: Model, state: ParticleState, operator: Operator, contacts: Contacts, v: np.ndarray, residual: np.ndarray,
    time_step: float,
) -> PowerBalance:  # fmt: skip
    """Balance the powers of a solve that found velocities v (n, 3), mm/s, with a `residual` (n, 3), Pa mm^2."""
    total = float(np.sum(v * operator.apply(v)))
    gradient = velocity_gradient(operator.pairs, operator.positions, operator.volumes, operator.inverse, v)
    power, swelling = material_power(operator, gradient), np.einsum("nii->n", gradient)
    physical = float(np.sum(operator.volumes * power))
    # Pressure that builds up or dies down in the step is no dissipation.
    stored = float(np.sum(operator.volumes * operator.bulk * swelling**2))
    _, forces = contacts.reactions(-residual[contacts.rows])
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
        power[contacts.rows] += (1.0 / share - 1.0) * half_cell_power(state, contacts, operator, behind, contacts.rows)
    body = _body_power(model, state, power, swelling, v, time_step) + total - physical - lost
    scale = power_scale(body, *tool_powers(contacts, forces, drag, v[contacts.rows]))
    return PowerBalance(total, physical, stored, rubbed, lost, power, swelling, forces, drag, scale)


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
