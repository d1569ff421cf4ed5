r"""Implicit step: one linear solve for the velocities, with or without scaled inertia.

.. math:: (M/\Delta t + A)\,v = M v^0/\Delta t - B^T V K (J - 1) I

The operator A stands at the positions half a step ahead, predicted with the last velocity. That makes the step second
order, and it removes a first-order error that a stiff fibre shows: a step from the old positions needs a little
volumetric strain to keep the volume, and the deviatoric fibre stress turns a third of that into strain along the
fibre.
"""

import math

import numpy as np

from ppmc.solver.linear.rigid_modes import Pieces
from ppmc.solver.particles.cells import Cells, sort_into_cells
from ppmc.solver.particles.kernel_shape import follow_lattice, inverse_shape, kernel_of, rearrangement_rate
from ppmc.solver.particles.neighbours import NeighbourList, Pairs, build_list, extents, list_is_stale, weigh_pairs
from ppmc.solver.particles.smoothing import SUPPORT, pair_weight
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.gradient import mean_around, moment_inverses, moments_and_gradient, velocity_gradient
from ppmc.solver.sph.operator import Operator
from ppmc.solver.sph.packing import Packing
from ppmc.solver.sph.transport import convect_deformation, convect_directions, jeffery_increment
from ppmc.solver.sph.volume_balance import correct_volume, measured_packing, reference_packing
from ppmc.solver.step.contact_passes import solve_with_contacts
from ppmc.solver.step.flow_laws import FlowLaws
from ppmc.solver.step.measures import PackingMeasure, packing_inside
from ppmc.solver.step.model import Model, StepReport
from ppmc.solver.step.rheology import Rheology
from ppmc.solver.step.spread import check_spread
from ppmc.solver.step.time_step import limit_rate
from ppmc.solver.step.tool_loads import account
from ppmc.solver.step.turning import chords
from ppmc.solver.walls.contact import Contacts, between_wall_layers
from ppmc.solver.walls.tools import RATE_MEMORY

SKIN = 0.1  # of the support radius
LEAST_STRAIN = 1e-3  # of the mean strain of a step: nothing flows below
# Solves from rest, the first of which knows nothing of how wall layers flatten, and change of that in parts of itself
# with which it counts as found.
MOST_STARTS, SETTLED = 10, 1e-3
# Share of a change of the flattening that is taken: at first, since two layers need half and more would pull them off,
# and at least.
FIRST_SHARE, LEAST_SHARE = 0.5, 0.25
# Share of the dissipation that tools give, below which the correction of packing, which gives the rest, is curbed.
LEAST_DRIVEN = 1.0 / 3.0
EXCEEDED, MOST_PARTS = 2.0, 16  # times its limits that divide a step; parts at once
MOST_DIVISIONS = 4  # of parts into parts: what is left is taken as it is
RESTING = 0.01  # displacement in a step, in spacings, that is not worth resolving while all tools rest
UNMOVED = 1e-4  # speed of the charge, in parts of the fastest tool's, that is not worth resolving
TOUCH = 1e-6  # gap, in spacings, at which a face counts as touched


class ImplicitIntegrator:
    """Advances a state step by step; holds the neighbour list and nothing else that outlives a step."""

    def __init__(self, model: Model, state: ParticleState) -> None:
        self.model = model
        self.state = state
        self.neighbours: NeighbourList | None = None
        self.list_shape = np.empty((0, 6))
        self.measured: tuple[np.ndarray, np.ndarray | None, float] | None = None
        self.packed: PackingMeasure | None = None

    @property
    def affine(self) -> bool:
        """Whether the kernel follows the lattice."""
        return bool(self.model.settings.kernel_shape == "affine")

    def refresh_neighbours(self, force: bool = False) -> None:
        """Sort the particles and list neighbours anew if the list is stale."""
        state, h = self.state, self.model.smoothing_length
        if (
            self.neighbours is not None
            and not force
            and (not self.affine or self.list_shape is state.kernel_shape)
            and not list_is_stale(self.neighbours, state.position)
        ):
            return
        cutoff = SUPPORT * h * (1.0 + SKIN)
        metric, longest = self.metric(state.kernel_shape) if self.affine else (None, 1.0)
        cells = sort_into_cells(state.position, cutoff if metric is None else cutoff * extents(metric))
        if not cells.in_order:
            self.reorder(cells.order)
            metric = None if metric is None else metric[cells.order]
            cells = cells.in_their_order()
        self.list_shape = state.kernel_shape
        if self.affine:
            self.measured = self.list_shape, metric, longest
        self.rebuild_list(state.position, cells)

    def reorder(self, order: np.ndarray) -> None:
        """Permute all that is kept with one row a particle."""
        self.state.reorder(order)

    def rebuild_list(self, positions: np.ndarray, cells: Cells | None = None) -> None:
        """List neighbours at given positions (those of the last rebuild, when a run is resumed).

        `cells` are those of the particles there, if they have been sorted already with the length that is searched.
        """
        support, last = SUPPORT * self.model.smoothing_length, self.neighbours
        metric, longest = self.metric(self.list_shape) if self.affine else (None, 1.0)
        self.neighbours = None
        cutoff, slack = support * (1.0 + SKIN), 0.5 * support * SKIN
        self.neighbours = build_list(positions, cutoff, slack, metric, longest, last, cells)

    def weigh(self, positions: np.ndarray) -> Pairs:
        """Weighted pairs at positions near the current ones; they end those that were weighed before."""
        assert self.neighbours is not None
        metric = self.metric(self.state.kernel_shape)[0] if self.affine else None
        return weigh_pairs(self.neighbours, positions, self.model.smoothing_length, metric)

    def metric(self, shape: np.ndarray) -> tuple[np.ndarray | None, float]:
        """Inverse shape tensors, shape (n, 6), of kernels, None for spheres, and the longest axis; once a shape."""
        if self.measured is None or self.measured[0] is not shape:
            inverse, longest = inverse_shape(shape)
            self.measured = shape, None if longest == 1.0 else inverse, longest
        return self.measured[1:]

    def initialise(self, time: float, time_step: float) -> StepReport:
        """Find the velocities at the start (inertia-free only), so that the first step can predict."""
        self.refresh_neighbours(force=True)
        self.set_reference(time)
        if self.model.density > 0.0:
            self._solve(time, time_step, update=False)
            return StepReport()
        return self._start(time, time_step)

    def _start(self, time: float, time_step: float) -> StepReport:
        """Solve from rest until wall layers flatten as the solve was told they would.

        In N layers whose outer ones flatten faster the N - 1 gaps between close more slowly: if each solve is told what
        the last one found, that goes up and down, and an error fades by 1 / (N - 1) only. What it answers to a change
        shows which share of a change to take (Aitken's relaxation, in its form for vectors).
        """
        state, spacing, share, last = self.state, self.model.spacing, FIRST_SHARE, None
        for _ in range(MOST_STARTS):
            told = state.smooth_gradient
            report = self._solve(time, time_step, update=False)
            change = state.smooth_gradient - told
            found, here = self._flattening(state.smooth_gradient), self._flattening(change)
            # The noise of single rates is left out: what changes them all is what moves the tools.
            squares, nothing = _inner(found, found), len(found) * (self._negligible(time, time_step) / spacing) ** 2
            if abs(_inner(here, found)) <= SETTLED * squares or squares <= nothing:
                return report
            if last is not None:
                before = self._flattening(last)
                answer = here - before
                share *= -_inner(before, answer) / max(_inner(answer, answer), 1e-300)
                share = float(np.clip(share, LEAST_SHARE, 1.0))
            last = change
            state.smooth_gradient = told + share * change
            state.twice_smooth_gradient = state.smooth_gradient.copy()
        report.unconverged += 1
        return report

    def _flattening(self, gradient: np.ndarray) -> np.ndarray:
        """Rates, 1/s, at which velocity gradients (n, 3, 3) stretch touched faces' particles along the normals."""
        touched = self.state.contact_tool >= 0
        normal = self.state.contact_normal[touched]
        return np.einsum("fa,fab,fb->f", normal, gradient[np.nonzero(touched)[0]], normal)

    def _travel(self, time: float, dt: float) -> float:
        """Longest way of a tool in a step, mm."""
        walls = self.model.walls
        ways = walls.offsets(time + dt) - walls.offsets(time), dt * walls.forced.velocities(dt)
        return max(float(np.linalg.norm(way, axis=1).max(initial=0.0)) for way in ways)

    def _negligible(self, time: float, dt: float) -> float:
        """Speed, mm/s, below which nothing drives what still flows: tools at rest, or on their way to the charge."""
        travel = self._travel(time, dt)
        return (RESTING * self.model.spacing if travel == 0.0 else UNMOVED * travel) / dt

    def longest_step(self) -> float:
        """Longest step that the method allows, s: any."""
        return float("inf")

    def step(self, time: float, time_step: float) -> StepReport:
        """Advance the state from `time` by `time_step` (s), in parts where the limits turn out to be exceeded.

        The length of a step is chosen by the flow before it, which knows nothing of a tool that strikes the charge.
        """
        return self._step(time, time_step, MOST_DIVISIONS)

    def _step(self, time: float, time_step: float, divisions: int) -> StepReport:
        self.refresh_neighbours()
        report = self._solve(time, time_step, update=True, divisible=divisions > 0)
        if report.parts > 1:
            part, tried = time_step / report.parts, report
            for k in range(report.parts):
                report = self._step(time + k * part, part, divisions - 1)
                report.add_work_of(tried)
                tried = report
        return report

    def operator(self, ahead: float, time: float, time_step: float) -> Operator:
        """Operator at the positions predicted for `ahead` seconds later, with viscosities at the last velocities."""
        return self._operator(self._rheology(ahead, time), time_step)

    def _rheology(self, ahead: float, time: float) -> Rheology:
        positions = self.state.position + ahead * self.state.velocity
        return Rheology(self.model, self.state, time, positions, ahead)

    def _operator(self, rheology: Rheology, time_step: float) -> Operator:
        state, model = self.state, self.model
        pairs, gradient = self.weigh(rheology.positions), state.velocity_gradient
        if model.material.rate_dependent:
            inverse = moment_inverses(pairs, rheology.positions, state.volume)[0]
            gradient = velocity_gradient(pairs, rheology.positions, state.volume, inverse, state.velocity)
        bulk = model.bulk_modulus * state.volume_ratio * time_step * between_wall_layers(state.wall_layers)
        return rheology.operator(pairs, bulk, gradient)

    def _parts(self, operator: Operator, velocities: np.ndarray, dt: float) -> int:
        """Parts into which a step of `dt` (s) with velocities (n, 3), mm/s, is to be divided; one if it may stand."""
        settings = self.model.settings
        gradient = velocity_gradient(
            operator.pairs, operator.positions, operator.volumes, operator.inverse, velocities
        )  # fmt: skip
        used = dt * limit_rate(gradient, settings.max_strain_increment, settings.max_displacement)
        return math.ceil(min(used, MOST_PARTS)) if used > EXCEEDED else 1

    def _solve(self, time: float, dt: float, update: bool, divisible: bool = False) -> StepReport:
        state, model = self.state, self.model
        speed, pushed = self._travel(time, dt), model.walls.forced.velocities(dt)
        reach = 1.3 * float(model.walls.spacing.max()) + 2.0 * speed
        ahead = 0.5 * dt if update else 0.0
        contacts = model.walls.contacts(state, time, dt, reach, ahead, flows=speed > 0.0 or model.density > 0.0)
        contacts.active |= contacts.gap <= TOUCH * model.spacing
        contacts.active |= contacts.violations(state.velocity[contacts.rows], dt) > TOUCH * model.spacing
        state.wall_layers = contacts.wall_layers(len(state))
        rheology = self._rheology(ahead, time)
        operator = self._operator(rheology, dt)
        check_spread(operator.pairs, operator.inverse, state)
        laws = FlowLaws(model, state, rheology, contacts, operator, dt)
        pieces = Pieces.of(operator.pairs, operator.positions, operator.volumes)
        report = StepReport(time_step=dt)
        self.measured = None  # not needed while the solve holds most
        negligible = self._negligible(time, dt)
        solution = solve_with_contacts(model, state, laws, contacts, dt, report, negligible, pieces)
        operator = laws.operator
        if divisible:
            report.parts = self._parts(operator, solution.velocities, dt)
            if report.parts > 1:
                return report
        account(model, state, operator, contacts, solution, dt, report)
        self.remember(contacts)
        model.walls.forced.adjust(report.tool_force, started=update)
        # What the solve held makes room for what the end of the step needs.
        velocities = chords(pieces, solution.velocities, state.position, dt) if update else solution.velocities
        del operator, laws, rheology, contacts, solution, pieces
        if update:
            model.walls.forced.advance(pushed, dt)
            self._advance(velocities, dt)
            # The correction itself strains the charge: a flow that it makes must not ask for more of it.
            driven = dt * min(report.driven_share / LEAST_DRIVEN, 1.0)
            self.balance_volume(time + dt, driven * strain_rate(state.velocity_gradient))
        else:
            gradient, around, _ = self._gradient_at_start(velocities)
            if model.density == 0.0:
                state.velocity, state.velocity_gradient = velocities, gradient
                state.smooth_gradient, state.twice_smooth_gradient = around, around.copy()
        return report

    def _gradient_at_start(self, velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity gradient (n, 3, 3) where the step began, its mean around wall layers, rate of rearrangement (n,)."""
        state = self.state
        pairs = self.weigh(state.position)
        gradient = moments_and_gradient(pairs, state.position, state.volume, velocities)
        pairs.moments = None
        around = self._around_walls(pairs, gradient)
        loose = rearrangement_rate(pairs, state.position, state.volume, velocities, gradient)
        return gradient, around, loose

    def _around_walls(self, pairs: Pairs, gradient: np.ndarray) -> np.ndarray:
        """Velocity gradients (n, 3, 3), those of wall layers averaged over their neighbourhoods."""
        # Half-widths of a wall layer that differ by the noise of single gradients would carve the charge.
        own_weight = pair_weight(0.0, self.model.smoothing_length)
        return mean_around(pairs, gradient, self.state.wall_layers > 0, own_weight)

    def remember(self, contacts: Contacts) -> None:
        """Put the faces touched into the state, where the next search finds them again."""
        # What touches now touches in the next solve, unless that finds otherwise; a solve that starts from no contact
        # would first let the whole charge drift.
        state = self.state
        state.contact_tool[:] = -1
        state.contact_tool[contacts.rows] = np.where(contacts.active, contacts.tool, -1)
        state.contact_normal[:] = 0.0
        state.contact_normal[contacts.rows] = contacts.normal
        if self.model.walls.bend:
            state.contact_slip[:] = np.inf
            state.contact_slip[contacts.rows] = np.where(contacts.active, contacts.slip_length, np.inf)

    def _advance(self, velocities: np.ndarray, dt: float) -> None:
        state, settings = self.state, self.model.settings
        gradient, around, loose = self._gradient_at_start(velocities)
        increment = np.eye(3) + dt * gradient
        state.position = state.position + dt * velocities
        state.velocity, state.velocity_gradient = velocities, gradient
        keep = 1.0 - RATE_MEMORY
        state.smooth_gradient = keep * state.smooth_gradient + RATE_MEMORY * around
        state.twice_smooth_gradient = keep * state.twice_smooth_gradient + RATE_MEMORY * state.smooth_gradient
        convect_deformation(increment, state.deformation_gradient, state.volume_ratio)
        turn = increment if settings.shape_factor == 1.0 else jeffery_increment(gradient, dt, settings.shape_factor)
        convect_directions(turn, state.fibre_direction)
        if settings.transport_normals:
            convect_directions(increment, state.in_plane_direction)
        self.follow(increment, dt * loose, dt * strain_rate(state.velocity_gradient))

    def follow(self, increment: np.ndarray, rearrangement: np.ndarray, strain: np.ndarray) -> None:
        """Carry lattice and kernel shapes over a step; arguments as in :func:`follow_lattice`."""
        state = self.state
        state.flow_residual = rearrangement / np.maximum(strain, LEAST_STRAIN * strain.mean() + 1e-300)
        state.lattice_shape = follow_lattice(state.lattice_shape, increment, rearrangement, strain)
        if self.affine:
            state.kernel_shape = kernel_of(state.lattice_shape, self.model.settings.kernel_aspect_limit)

    def packing(self, pairs: Pairs, time: float) -> Packing:
        """Packing of each particle."""
        model = self.model
        return measured_packing(
            self.state, model.walls, time, pairs, *self.metric(self.state.kernel_shape), model.smoothing_length,
            model.spacing,
        )  # fmt: skip

    def take_packing(self, time: float) -> PackingMeasure:
        """Packing inside the material at the end of a step, taken anew where no correction has looked at it."""
        packed, self.packed = self.packed, None
        if packed is None:
            pairs = self.weigh(self.state.position)
            packed = packing_inside(self.state, pairs, self.packing(pairs, time), self.model.smoothing_length)
        return packed

    def set_reference(self, time: float) -> None:
        """Take the packing at the start as the one to keep."""
        if self.model.settings.volume_correction > 0.0:
            pairs, h = self.weigh(self.state.position), self.model.smoothing_length
            self.state.packing_reference = reference_packing(pairs, self.packing(pairs, time), h)

    def balance_volume(self, time: float, strain: np.ndarray) -> None:
        """Correct the pressure's volume ratio after a `strain` (n,) that ended at `time`."""
        state, model = self.state, self.model
        if model.settings.volume_correction == 0.0:
            return
        pairs = self.weigh(state.position)
        found = self.packing(pairs, time)
        self.packed = packing_inside(state, pairs, found, model.smoothing_length)
        correct_volume(state, pairs, found, strain, model.settings.volume_correction, model.smoothing_length)


def _inner(a: np.ndarray, b: np.ndarray) -> float:
    """Inner product of (m,) by (m,): einsum, so that no thread count changes a bit."""
    return float(np.einsum("m,m->", a, b))


def strain_rate(gradient: np.ndarray) -> np.ndarray:
    """Norm of the rate of deformation, shape (n,), 1/s, of velocity gradients (n, 3, 3)."""
    rate = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
    return np.sqrt(np.einsum("nij,nij->n", rate, rate))
