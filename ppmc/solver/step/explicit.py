r"""Explicit integrator: the papers' route, with scaled mass.

Velocities advance by :math:`\Delta t\,f/m` with the force of the same operator, pressure :math:`-K(J-1)` and
unilateral contact by projection of the velocity. As in the implicit integrator a face that was touched stays so until
the charge around it pulls, and tools bear what their power says: reactions at the centres of wall layers exceed the
pressure on the faces, by a sixth for two plies of two layers each. The stable step follows from the operator itself:
with the largest eigenvalues of the viscous and of the volumetric stiffness over the mass, :math:`\lambda_v` and
:math:`\lambda_K` (power iterations),

.. math:: \Delta t = \frac{0.8}{\lambda_v/2 + \sqrt{\lambda_K}/2},

which holds for each alone (2/lambda_v and 2/sqrt(lambda_K), less the safety) and for both together.

A step costs one list of weights, one sweep for moments and velocity gradient and one product. The sweep is taken where
the step ends: its gradient brings deformation and directions up to date, exactly for any affine motion
(:func:`ppmc.solver.sph.transport.increment_to_here`), and its moments serve the forces of the next step. Tools concern
the particles near them only.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.notices import inform
from ppmc.solver.linear.block_jacobi import multiply_rows
from ppmc.solver.particles.kernel_shape import rearrangement_rate
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.reductions import dot
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph import single_direction
from ppmc.solver.sph.gradient import moments_and_gradient, velocity_gradient
from ppmc.solver.sph.operator import Operator
from ppmc.solver.sph.power import material_power, power_scale, tool_powers
from ppmc.solver.sph.reactions import add_reactions
from ppmc.solver.sph.transport import (
    compose,
    convect_deformation,
    convect_directions,
    increment_to_here,
    jeffery_increment,
    small_strain,
)
from ppmc.solver.step.contact_passes import pulled_off
from ppmc.solver.step.flow_laws import half_cells_differ, see_half_cells
from ppmc.solver.step.implicit import TOUCH, ImplicitIntegrator
from ppmc.solver.step.measures import place_of
from ppmc.solver.step.model import StepReport
from ppmc.solver.step.rheology import Rheology
from ppmc.solver.step.spread import check_spread
from ppmc.solver.step.tool_loads import (
    add_tool_loads,
    driven_share,
    face_areas,
    half_cell_power,
    in_half_cells,
    slide_on,
    touched_faces,
    wall_drag,
)
from ppmc.solver.walls.contact import Contacts, between_wall_layers
from ppmc.solver.walls.tools import RATE_MEMORY
from ppmc.solver.walls.wall_layer import brake

SAFETY = 0.8
POWER_ITERATIONS = 20
CONTACT_EVERY = 10  # steps between searches for faces; gaps are advanced linearly in between
LIMITS_EVERY = 200  # steps between estimates of the stable step
TOUCHING = 0.01  # gap after one step, in half-widths, up to which it is the flattening of that step
HALF_CELL_PASSES = 3  # between the viscosity of a half-cell and the rate that it leaves there, beside a wall's law
# Largest shear viscosity, in parts of what it was when the stable step was estimated, that asks for another estimate:
# half of the growth that `SAFETY` leaves room for.
STIFFENED = 1.1
FOLLOWED = 5e-3  # largest strain of a particle that lattice and volume balance may lag behind
MOST_STEPS = 200  # explicit steps in one reported step


@dataclass
class Limits:
    """Stable steps, s: by viscosity, by sound, and the one used."""

    viscous: float
    courant: float
    used: float


@dataclass
class NearTools:
    """Particles that have a tool within reach.

    Attributes
    ----------
    contacts : Contacts
        They and their faces.
    drag : ndarray, shape (m, 3, 3, 3)
        Drag of each face, Pa s mm; (0, 3, 3, 3) if all slip.
    flattening : ndarray, shape (m, 3)
        What a touching particle's half-width loses in a step, mm; negative where it grows.
    kept : ndarray, shape (m, 3), bool
        Faces touched from before, which stay so until the charge around them pulls.
    pressing : ndarray, shape (m, 3)
        Sum of the normal reactions of the steps since, Pa mm^2.
    """

    contacts: Contacts
    drag: np.ndarray
    flattening: np.ndarray
    kept: np.ndarray
    pressing: np.ndarray


@dataclass
class Loads:
    """What the tools bear in a number of steps, summed: what presses apart from what rubs, and their powers.

    Attributes
    ----------
    pressing, rubbing : StepReport
        Of these forces and moments alone are used.
    powers : ndarray, shape (3,)
        Pa mm^3/s: taken up by the charge, of the pressing forces as they are, lost in sliding; see
        :func:`ppmc.solver.sph.power.power_scale`.
    """

    pressing: StepReport
    rubbing: StepReport
    powers: np.ndarray

    @classmethod
    def on(cls, tools: int) -> Loads:
        """No load yet on a number of tools."""
        pressing = StepReport(tool_force=np.zeros((tools, 3)), tool_moment=np.zeros((tools, 3)))
        return cls(pressing, copy.deepcopy(pressing), np.zeros(3))

    def put_into(self, report: StepReport, steps: int) -> None:
        """Put the means over a number of steps into a report, the pressing forces scaled by their power."""
        scale = power_scale(*self.powers.tolist())
        report.tool_force = (scale * self.pressing.tool_force + self.rubbing.tool_force) / steps
        report.tool_moment = (scale * self.pressing.tool_moment + self.rubbing.tool_moment) / steps


class ExplicitIntegrator(ImplicitIntegrator):
    """Advances by many small steps within each reported one."""

    limits: Limits | None = None
    present: Operator | None = None
    rheology: Rheology | None = None
    passed: np.ndarray | None = None
    passed_time: float = 0.0

    def initialise(self, time: float, time_step: float) -> StepReport:
        """Start from rest."""
        self.refresh_neighbours(force=True)
        self.set_reference(time)
        self._assemble(self.weigh(self.state.position), time)
        used = self.limits = self._estimate_limits()
        # What lies on a tool touches it, until the charge around it pulls.
        contacts = self._near_tools(time, used.used).contacts
        contacts.active |= contacts.gap <= TOUCH * self.model.spacing
        self.remember(contacts)
        self.present = None
        inform(
            f"explicit: viscous limit {used.viscous:.3g} s, Courant limit {used.courant:.3g} s, step {used.used:.3g} s"
        )
        return StepReport()

    def longest_step(self) -> float:
        """Longest reported step, s."""
        return math.inf if self.limits is None else MOST_STEPS * self.limits.used

    def reorder(self, order: np.ndarray) -> None:
        """Permute all that is kept with one row a particle, the deformation that is yet to be followed, too."""
        super().reorder(order)
        if self.passed is not None:
            self.passed = self.passed[order]

    def step(self, time: float, time_step: float) -> StepReport:
        """Advance the state from `time` by `time_step` (s), in steps that are stable."""
        report, loads = StepReport(), Loads.on(len(self.model.walls.tools))
        forced = self.model.walls.forced
        elapsed, ahead = 0.0, True
        while ahead:
            self._follow_flow(time + elapsed)
            self.refresh_neighbours()
            self._assemble(self.weigh(self.state.position), time + elapsed)
            assert self.present is not None
            check_spread(self.present.pairs, self.present.inverse, self.state)
            self.limits = self._estimate_limits()
            count = max(1, math.ceil((time_step - elapsed) / self.limits.used - 1e-9))
            dt, steps = (time_step - elapsed) / count, min(count, LIMITS_EVERY)
            stiffest = STIFFENED * float(self.present.shear.max())
            for k in range(steps):
                if k % CONTACT_EVERY == 0:
                    near = self._near_tools(time + elapsed, dt)
                if self.model.material.rate_dependent and float(self.present.shear.max()) > stiffest:
                    steps = k + 1
                ahead = steps < count
                forced.advance(forced.velocities(dt), dt)
                self._push(near, dt, loads)
                done = (k + 1) % CONTACT_EVERY == 0 or k == steps - 1
                if done:
                    self._let_go(near, k % CONTACT_EVERY + 1, loads)
                if k == steps - 1 and not ahead:
                    self._account_for(near, report)
                elapsed += dt
                self._move(time + elapsed, dt, refresh=done)
                if k + 1 == steps:
                    break
            report.iterations += steps
            self.present = None
            self._follow_flow(time + elapsed)
        report.time_step = time_step / report.iterations
        loads.put_into(report, report.iterations)
        forced.adjust(report.tool_force)
        return report

    def _assemble(self, pairs: Pairs, time: float) -> None:
        """Make the operator at the present positions."""
        self.rheology = Rheology(self.model, self.state, time)
        self.present = self.rheology.operator(pairs, np.zeros(len(self.state)), self.state.velocity_gradient)

    def _estimate_limits(self) -> Limits:
        state, model, operator = self.state, self.model, self.present
        assert operator is not None
        mass = model.density * state.volume[:, None]
        viscous = _largest_eigenvalue(operator.apply, mass, state)
        n = len(state)
        sound = Operator(
            operator.pairs, operator.positions, operator.volumes, operator.inverse, operator.trace, operator.first,
            np.zeros(n), np.full(n, model.bulk_modulus), np.zeros((n, 0)), np.zeros((n, 0, 3)), np.zeros((n, 2)),
        )  # fmt: skip
        courant = math.sqrt(_largest_eigenvalue(sound.apply, mass, state))
        return Limits(2.0 / viscous, 2.0 / courant, SAFETY / (0.5 * viscous + 0.5 * courant))

    def _near_tools(self, time: float, dt: float) -> NearTools:
        walls = self.model.walls
        state = self.state
        assert self.present is not None
        _blend(state.smooth_gradient, self._around_walls(self.present.pairs, state.velocity_gradient), RATE_MEMORY)
        _blend(state.twice_smooth_gradient, state.smooth_gradient, RATE_MEMORY)
        here = walls.contacts(state, time, dt, 1.5 * float(walls.spacing.max()))
        if half_cells_differ(self.model):
            assert self.rheology is not None
            for _ in range(HALF_CELL_PASSES):
                see_half_cells(
                    self.model, state, self.rheology, here, self.present, state.velocity, state.velocity_gradient
                )  # fmt: skip
        drag = wall_drag(self.model, state, here, self.present, here.tool >= 0)
        state.wall_layers = here.wall_layers(len(state))
        # Half-widths of particles that touch were carried on by one step: they grow where tools part.
        change = np.where(here.active, here.gap, np.maximum(here.gap, 0.0))
        flattening = np.where(np.abs(here.gap) < TOUCHING * here.half_width, change, 0.0)
        return NearTools(here, drag, flattening, here.active.copy(), np.zeros(here.gap.shape))

    def _push(self, near: NearTools, dt: float, loads: Loads) -> None:
        """Advance the velocities by the forces of the charge and of the tools."""
        state, model, contacts, rows = self.state, self.model, near.contacts, near.contacts.rows
        assert self.present is not None
        pressure_stress = model.bulk_modulus * (state.volume_ratio - 1.0) * between_wall_layers(state.wall_layers)
        opposing = _opposing_force(self.present, state.velocity, pressure_stress)
        velocities = np.empty_like(opposing)
        _kick(state.velocity, opposing, state.volume, dt / model.density, velocities)
        if len(rows) == 0:
            state.velocity = velocities
            return
        here, per_mass = velocities[rows], (-dt / (model.density * state.volume[rows]))[:, None]
        rubbing = np.zeros_like(contacts.wall_velocity)
        if len(near.drag):
            rubbing = brake(near.drag, contacts.active, contacts.wall_velocity, -per_mass[:, 0], here)
        contacts.active = near.kept.copy()
        contacts.active |= contacts.violations(here, dt) > 0.0
        free, held = contacts.constrain(dt)
        moved = multiply_rows(np.arange(len(rows)), free, here.copy()) + held
        pressing, forces = contacts.reactions((here - moved) / per_mass)
        near.pressing += pressing
        add_tool_loads(model, contacts, forces, state.position[rows], loads.pressing)
        if model.walls.rub:
            add_tool_loads(model, contacts, rubbing, state.position[rows], loads.rubbing)
        mean = 0.5 * (state.velocity[rows] + moved)
        body = float(np.sum((forces + rubbing).sum(axis=1) * mean)) + self._behind_layers(near, mean)
        loads.powers += body, *tool_powers(contacts, forces, rubbing, mean)
        relative = moved[:, None, :] - contacts.wall_velocity
        contacts.gap = contacts.gap + dt * np.einsum("nkc,nkc->nk", contacts.normal, relative) + near.flattening
        velocities[rows] = moved
        state.velocity = velocities

    def _let_go(self, near: NearTools, steps: int, loads: Loads) -> None:
        """Release what was pulled off in a number of steps, and remember what touches."""
        assert self.present is not None
        contacts, pressing = near.contacts, near.pressing / steps
        released = pulled_off(self.model, self.state, contacts, self.present.pairs, pressing)
        contacts.active &= ~released
        if self.model.walls.bend:
            here, pressing = self.state.velocity[contacts.rows], pressing * power_scale(*loads.powers.tolist())
            contacts.slip_length = slide_on(self.model, self.state, contacts, self.present, pressing, here)
        self.remember(near.contacts)

    def _behind_layers(self, near: NearTools, velocities: np.ndarray) -> float:
        """Power, Pa mm^3/s, that the half-cells behind wall layers take up, which do not resist.

        What tools do on the particles with the mean `velocities` (m, 3), mm/s, of a step is just what dissipates, is
        stored or sets the charge in motion; to that comes this, without the shear that walls drag on.
        """
        state, operator, contacts = self.state, self.present, near.contacts
        assert operator is not None
        rows = contacts.rows
        share, gradient, lost = between_wall_layers(state.wall_layers[rows]), state.velocity_gradient[rows], 0.0
        pressure = self.model.bulk_modulus * (state.volume_ratio[rows] - 1.0)
        swelling = np.einsum("nii->n", gradient)
        if len(near.drag):
            slide = velocities[:, None, :] - contacts.wall_velocity
            gradient, lost = in_half_cells(self.model, state, contacts, near.drag, slide, gradient)
        power = half_cell_power(state, contacts, operator, gradient, rows)
        behind = (1.0 / share - 1.0) * power + (1.0 - share) * pressure * swelling
        return float(np.sum(state.volume[rows] * behind)) - lost

    def _account_for(self, near: NearTools, report: StepReport) -> None:
        """Put the work done at the last positions into the report."""
        state, operator = self.state, self.present
        assert operator is not None
        moments = operator.pairs, operator.positions, operator.volumes, operator.inverse
        gradient = velocity_gradient(*moments, state.velocity)
        report.dissipation = float(np.sum(state.velocity * operator.apply(state.velocity)))
        physical = float(np.sum(state.volume * material_power(operator, gradient)))
        report.zero_energy_share = max(0.0, 1.0 - physical / max(report.dissipation, 1e-300))
        pressure = self.model.bulk_modulus * (1.0 - state.volume_ratio)
        released = float(np.sum(state.volume * pressure * np.einsum("nii->n", gradient)))
        report.driven_share = driven_share(report.dissipation, released)
        # Heat of whole cells and at walls; so far it was that of the parts that resist.
        contacts, rows = near.contacts, near.contacts.rows
        gradient = gradient[rows]
        if len(near.drag):
            slide = state.velocity[rows, None, :] - contacts.wall_velocity
            gradient, lost = in_half_cells(self.model, state, contacts, near.drag, slide, gradient)
            heat = np.einsum("nka,nkab,nkb->nk", slide, near.drag, slide) * contacts.whole_cells()[:, None]
            report.dissipation += float(np.sum(np.where(contacts.active, heat, 0.0))) - lost
        power = half_cell_power(state, contacts, operator, gradient, rows)
        behind = (1.0 / between_wall_layers(state.wall_layers[rows]) - 1.0) * power
        report.dissipation += float(np.sum(state.volume[rows] * behind))
        report.contacts = int(near.contacts.active.any(axis=1).sum())
        report.touched = touched_faces(contacts, face_areas(state, contacts))
        depth = -(contacts.gap - near.flattening).min(axis=1, initial=0.0)
        report.penetration = float(depth.max(initial=0.0))
        if report.penetration > 0.0:
            report.deepest = place_of(state, int(contacts.rows[np.argmax(depth)]))

    def _move(self, time: float, dt: float, refresh: bool = False) -> None:
        """Advance everything else with the new velocities, and make the operator at the new positions."""
        state, settings = self.state, self.model.settings
        self.present = None
        state.position = state.position + dt * state.velocity
        if refresh:
            self._follow_flow(time, FOLLOWED)
            self.refresh_neighbours()
        pairs = self.weigh(state.position)
        there = moments_and_gradient(pairs, state.position, state.volume, state.velocity)
        increment, gradient = increment_to_here(there, dt)
        state.velocity_gradient = gradient
        convect_deformation(increment, state.deformation_gradient, state.volume_ratio)
        turn = increment if settings.shape_factor == 1.0 else jeffery_increment(gradient, dt, settings.shape_factor)
        convect_directions(turn, state.fibre_direction)
        if settings.transport_normals:
            convect_directions(increment, state.in_plane_direction)
        if self.passed is None:
            self.passed = increment
        else:
            compose(increment, self.passed)
        self.passed_time += dt
        self._assemble(pairs, time)

    def _follow_flow(self, time: float, least: float = 0.0) -> None:
        """Carry lattice and volume balance over the strain since the last time, once it is more than `least`."""
        state = self.state
        if self.passed is None:
            return
        strain = small_strain(self.passed)
        if float(strain.max()) < least:
            return
        pairs = self.weigh(state.position)
        loose = rearrangement_rate(pairs, state.position, state.volume, state.velocity, state.velocity_gradient)
        self.follow(self.passed, self.passed_time * loose, strain)
        self.balance_volume(time, strain)
        self.passed, self.passed_time = None, 0.0


def _opposing_force(operator: Operator, velocities: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Force that the viscous stress and a given isotropic one, shape (n,), Pa, oppose to the motion; Pa mm^2."""
    if operator.directions.shape[1] > 1:
        return operator.apply(velocities) + operator.pressure_force(operator.volumes * stress)
    pairs, blocks, out = operator.pairs, operator.pairs.blocks, np.empty_like(velocities)
    window = np.empty((int(blocks.offset[-1]), 3))
    single_direction.stress_sweep(
        pairs.start, pairs.count, pairs.index, pairs.weight, operator.positions, operator.volumes, operator.inverse,
        operator.shear, operator.bulk, operator.fibre, operator.directions, operator.control, velocities,
        int(pairs.count.max(initial=0)), blocks.rows, blocks.low, blocks.offset, window, out, stress,
    )  # fmt: skip
    add_reactions(blocks.rows, blocks.low, blocks.offset, window, out)
    return out


@njit(cache=True, parallel=True)
def _kick(velocities, opposing, volume, time_per_density, out):
    for i in prange(velocities.shape[0]):
        factor = time_per_density / volume[i]
        for c in range(3):
            out[i, c] = velocities[i, c] - factor * opposing[i, c]


@njit(cache=True, parallel=True)
def _blend(smooth, gradient, share):
    for i in prange(smooth.shape[0]):
        for r in range(3):
            for c in range(3):
                smooth[i, r, c] += share * (gradient[i, r, c] - smooth[i, r, c])


def _largest_eigenvalue(apply, mass: np.ndarray, state: ParticleState) -> float:
    """Largest eigenvalue of M^-1 A by power iterations.

    They start from anyhow combined places of particles that follow one another in the charge, which depends on neither
    the order of the state nor the directions of the axes.
    """
    places = state.in_original_order(state.position - state.position.mean(axis=0))
    factors = np.sin(np.arange(1.0, 3.0 * len(places) + 1.0)).reshape(-1, 3, 1)
    start = sum(factors[:, k] * np.roll(places, -k, axis=0) for k in range(3))
    vector, value = start[state.original], 0.0
    for _ in range(POWER_ITERATIONS):
        image = apply(vector) / mass
        value = math.sqrt(dot(image, image) / max(dot(vector, vector), 1e-300))
        vector = image / max(math.sqrt(dot(image, image)), 1e-300)
    # Power iterations come from below; a twentieth is more than they miss after so many.
    return 1.05 * value
