r"""The implicit step with velocities on a grid.

Everything that particles carry, how they meet tools and how their packing is kept is that of the particle method
(:mod:`ppmc.solver.step.implicit`); what finds the velocities, and the gradient that carries directions and
deformation, is the grid's. The grid is laid anew in every solve, over the places predicted for the middle of the step.
With the gradient G of the last velocities where the step begins, and L that of the new ones in its middle, positions
move by :math:`A = I + \Delta t\,L (I + \tfrac12\Delta t\,G)`, which is the increment that F takes.
"""

import math

import numpy as np

from ppmc.errors import SceneError
from ppmc.solver.grid.body import make_body
from ppmc.solver.grid.cells import lay_lines
from ppmc.solver.grid.loads import account
from ppmc.solver.grid.passes import HOLD, solve_with_walls
from ppmc.solver.grid.recover import Recovered, recover
from ppmc.solver.grid.stiffness import Material, Stiffness, make_stiffness
from ppmc.solver.grid.wall_points import WallPoints, wall_points
from ppmc.solver.linear.rigid_modes import Pieces, free_rigid_modes
from ppmc.solver.particles.kernel_shape import full, inverse_shape, rearrangement_rate, six
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.gradient import moment_inverses
from ppmc.solver.sph.transport import convect_deformation, convect_directions, jeffery_increment
from ppmc.solver.step.implicit import EXCEEDED, LEAST_DRIVEN, MOST_PARTS, TOUCH, ImplicitIntegrator, strain_rate
from ppmc.solver.step.model import Model, StepReport
from ppmc.solver.step.spread import check_spread
from ppmc.solver.step.time_step import limit_rate
from ppmc.solver.step.turning import chords
from ppmc.solver.walls.contact import Contacts

# Least stiffness against changes of volume, in units of (R + 10) eta23. A brief step's K J dt is less, and would let
# the charge shrink; a pressure that keeps no memory of it stands in.
LEAST_BULK = 100.0
STIFFENING = 10.0  # beside R, as in the run's bulk modulus


class GridIntegrator(ImplicitIntegrator):
    """Advances a state step by step with velocities on a grid."""

    def __init__(self, model: Model, state: ParticleState) -> None:
        """Take a model whose laws do not depend on the flow.

        Raises
        ------
        SceneError
            If viscosities or friction do.
        """
        if model.material.rate_dependent or model.walls.bend:
            raise SceneError(
                "solver.operator: grid takes materials and walls whose laws do not depend on the flow; use `particles`"
            )
        super().__init__(model, state)

    def _start(self, time: float, time_step: float) -> StepReport:
        return self._solve(time, time_step, update=False)

    def stiffness(
        self, positions: np.ndarray, lattice: np.ndarray, ahead: float, time: float, dt: float,
        near: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> Stiffness:  # fmt: skip
        """Stiffness of the grid laid over `positions` (n, 3), mm, those predicted for `ahead` seconds later.

        `lattice`, shape (n, 6), are the shapes of the lattice there, `near` the faces near them as in
        :func:`ppmc.solver.grid.body.make_body`.
        """
        state, model = self.state, self.model
        rheology = self._rheology(ahead, time)
        shear, fibre = rheology.viscosities(state.velocity_gradient)
        extents = model.spacing * np.sqrt(lattice[:, :3])
        body = make_body(
            lay_lines(positions, extents, near), positions, state.volume * state.volume_ratio,
            inverse_shape(lattice)[0], extents, model.spacing, near,
        )  # fmt: skip
        stiff = np.maximum(model.bulk_modulus * state.volume_ratio * dt, LEAST_BULK * self._stiff(shear))
        material = Material(shear, fibre, rheology.directions, stiff)
        return make_stiffness(body, material)

    def _stiff(self, shear: np.ndarray) -> np.ndarray:
        return (self.model.material.ratio + STIFFENING) * shear

    def _solve(self, time: float, dt: float, update: bool, divisible: bool = False) -> StepReport:
        state, model = self.state, self.model
        speed, pushed = self._travel(time, dt), model.walls.forced.velocities(dt)
        reach = 1.3 * float(model.walls.spacing.max()) + 2.0 * speed
        ahead = 0.5 * dt if update else 0.0
        # Half-widths as they are: the body reaches to the wall, and flattens there by itself.
        contacts = model.walls.contacts(state, time, dt, reach, ahead, flows=False)
        contacts.active |= contacts.gap <= TOUCH * model.spacing
        contacts.active |= contacts.violations(state.velocity[contacts.rows], dt) > TOUCH * model.spacing
        state.wall_layers = contacts.wall_layers(len(state))
        positions = state.position + ahead * state.velocity
        carried = np.eye(3) + ahead * state.velocity_gradient
        lattice = six(carried @ full(state.lattice_shape) @ np.swapaxes(carried, 1, 2))
        pairs = self.weigh(positions)
        check_spread(pairs, moment_inverses(pairs, positions, state.volume)[0], state)
        pieces = Pieces.of(pairs, positions, state.volume)
        away = contacts.gap + contacts.half_width
        away += ahead * np.einsum(
            "mkc,mkc->mk", contacts.normal, state.velocity[contacts.rows, None] - contacts.wall_velocity
        )
        away[contacts.tool < 0] = np.inf
        stiffness = self.stiffness(positions, lattice, ahead, time, dt, (contacts.rows, contacts.normal, away))
        points = wall_points(
            stiffness.body, contacts, away, positions, inverse_shape(lattice)[0],
            state.volume * state.volume_ratio, dt,
        )  # fmt: skip
        hold = HOLD * float(self._stiff(stiffness.material.shear).mean()) / model.spacing
        excess = model.bulk_modulus * (state.volume_ratio - 1.0)
        report = StepReport(time_step=dt)
        solution = solve_with_walls(
            model, stiffness, contacts, points, stiffness.pressure_load(excess), hold, dt, pairs, report
        )  # fmt: skip
        found = recover(stiffness, positions, solution.nodal)
        self._rest(pieces, contacts, points, hold, found, dt)
        if divisible:
            settings = model.settings
            used = dt * limit_rate(found.gradient, settings.max_strain_increment, settings.max_displacement)
            report.parts = math.ceil(min(used, MOST_PARTS)) if used > EXCEEDED else 1
            if report.parts > 1:
                return report
        account(model, state, contacts, points, solution, found, excess, dt, report)
        self.remember(contacts)
        model.walls.forced.adjust(report.tool_force, started=update)
        if update:
            velocities = chords(pieces, found.velocity, state.position, dt)
            gradient = _over_chords(pieces, found.velocity, found.gradient, state.velocity_gradient, dt)
            model.walls.forced.advance(pushed, dt)
            self._move(velocities, gradient, dt)
            driven = dt * min(report.driven_share / LEAST_DRIVEN, 1.0)
            self.balance_volume(time + dt, driven * strain_rate(state.velocity_gradient))
        else:
            state.velocity, state.velocity_gradient = found.velocity, found.gradient
        return report

    def _rest(
        self, pieces: Pieces, contacts: Contacts, points: WallPoints, hold: float, found: Recovered, dt: float
    ) -> None:
        """Take out of the motion found what nothing resists: no momentum along free rigid motions."""
        m = len(contacts.rows)
        free, _ = contacts.constrain(dt)
        slip = contacts.slip_length[points.row, points.face]
        per = np.where(slip == 0.0, hold, 1.0 / np.where(slip > 0.0, slip, 1.0))
        on = contacts.active[points.row, points.face]
        along = np.eye(3) - points.normal[:, :, None] * points.normal[:, None, :]
        drag = np.zeros((m, 3, 3))
        np.add.at(drag, points.row, (per * points.area * on)[:, None, None] * along)
        rigid = free_rigid_modes(pieces, 0.0, contacts.rows, free, drag, hold * float(points.area.mean()))
        if rigid.count > 0:
            before = found.velocity.copy()
            rigid.rest(found.velocity)
            found.gradient[:] += _spins(pieces, pieces.motion(found.velocity - before))[pieces.piece]

    def _move(self, velocities: np.ndarray, gradient: np.ndarray, dt: float) -> None:
        """Carry the particles over a step with a gradient (n, 3, 3) where it began."""
        state, settings = self.state, self.model.settings
        pairs = self.weigh(state.position)
        loose = rearrangement_rate(pairs, state.position, state.volume, velocities, gradient)
        increment = np.eye(3) + dt * gradient
        state.position = state.position + dt * velocities
        state.velocity = velocities
        state.velocity_gradient = gradient @ np.linalg.inv(increment)
        convect_deformation(increment, state.deformation_gradient, state.volume_ratio)
        turn = increment if settings.shape_factor == 1.0 else jeffery_increment(gradient, dt, settings.shape_factor)
        convect_directions(turn, state.fibre_direction)
        if settings.transport_normals:
            convect_directions(increment, state.in_plane_direction)
        self.follow(increment, dt * loose, dt * strain_rate(state.velocity_gradient))


def _spins(pieces: Pieces, motion: np.ndarray) -> np.ndarray:
    """Rates of rotation (pieces, 3, 3), 1/s, of rigid motions (pieces, 6)."""
    spin = np.zeros((len(motion), 3, 3))
    w0, w1, w2 = pieces.per_length * motion[:, 3:].T
    spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0] = w0, w1, w2
    return np.asarray(spin - np.swapaxes(spin, 1, 2))


def _over_chords(
    pieces: Pieces, velocities: np.ndarray, gradient: np.ndarray, before: np.ndarray, dt: float
) -> np.ndarray:
    """Gradient where the step began of what :func:`ppmc.solver.step.turning.chords` makes of the velocities.

    `gradient` (n, 3, 3) is that of the velocities in the middle of the step, `before` that with which it was predicted.
    """
    spin = _spins(pieces, pieces.motion(velocities))
    turned = np.linalg.inv(np.eye(3) - 0.5 * dt * spin)
    left = (gradient - spin[pieces.piece]) @ (np.eye(3) + 0.5 * dt * before)
    return np.asarray(turned[pieces.piece] @ (spin[pieces.piece] + left))
