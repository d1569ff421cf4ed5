r"""Implicit step: one linear solve for the velocities, with or without scaled inertia.

.. math:: (M/\Delta t + A)\,v = M v^0/\Delta t - B^T V K (J - 1) I

The operator A stands at the positions half a step ahead, predicted with the last velocity. That makes the step second
order, and it removes a first-order error that a stiff fibre shows: a step from the old positions needs a little
volumetric strain to keep the volume, and the deviatoric fibre stress turns a third of that into strain along the
fibre.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ppmc.errors import NumericalError
from ppmc.solver import materials
from ppmc.solver.block_jacobi import restricted_inverse
from ppmc.solver.coarse_grid import CELL, CoarseGrid, make_grid
from ppmc.solver.conjugate_gradient import Solution, conjugate_gradient
from ppmc.solver.contact import FACES, Contacts, between_wall_layers
from ppmc.solver.gradient import mean_around, moments_and_gradient, velocity_gradient
from ppmc.solver.kernel_shape import follow_lattice, inverse_shape, limited, rearrangement_rate, smoothness
from ppmc.solver.neighbours import NeighbourList, Pairs, build_list, cell_order, list_is_stale, weigh_pairs
from ppmc.solver.operator import Operator, assemble
from ppmc.solver.power import material_power, power_scale
from ppmc.solver.rigid_modes import free_rigid_modes
from ppmc.solver.smoothing import SUPPORT, pair_weight
from ppmc.solver.state import ParticleState
from ppmc.solver.system import VelocitySystem
from ppmc.solver.tools import RATE_MEMORY, Walls
from ppmc.solver.transport import convect_deformation, convect_directions, jeffery_increment
from ppmc.solver.volume_balance import correct_volume, measured_packing, reference_packing

SKIN = 0.1  # of the support radius
RELEASE = 1e-3  # pull, in mean pressing reactions, that releases a contact
NEGLIGIBLE, DEEPEST = 1e-3, 0.01  # penetration in spacings: not worth a pass; worth one beyond those allowed
SPARE_PASSES = 2  # of such passes
ROUGH = 10.0  # factor on tolerances while it is open which faces touch
ROUGH_WINDOW, WINDOW = 4, 8  # iterations between estimates of the error
LEAST_STRAIN = 1e-3  # of the mean strain of a step: nothing flows below
STARTS = 3  # solves from rest: only the second and third know how wall layers flatten
TOUCH = 1e-6  # gap, in spacings, at which a face counts as touched


@dataclass
class StepReport:
    """What one step did; every number goes into the history."""

    time_step: float = 0.0
    iterations: int = 0
    passes: int = 0
    estimated_error: float = 0.0
    unconverged: int = 0
    contacts: int = 0
    penetration: float = 0.0
    dissipation: float = 0.0
    zero_energy_share: float = 0.0
    tool_force: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    tool_moment: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass
class Model:
    """Constants of a run.

    Attributes
    ----------
    settings : section `solver` of the scene
    material : section `material` of the scene
    walls : Walls
    smoothing_length : float
        h, mm.
    bulk_modulus : float
        K, Pa.
    density : float
        Scaled density, g/mm^3; zero leaves inertia out.
    """

    settings: Any
    material: Any
    walls: Walls
    smoothing_length: float
    bulk_modulus: float
    density: float

    @property
    def spacing(self) -> float:
        """Mean particle spacing, mm."""
        return float(np.cbrt(np.prod(self.walls.spacing)))


class ImplicitIntegrator:
    """Advances a state step by step; holds the neighbour list and nothing else that outlives a step."""

    def __init__(self, model: Model, state: ParticleState) -> None:
        self.model = model
        self.state = state
        self.neighbours: NeighbourList | None = None
        self.list_shape = np.empty((0, 6))
        self.measured: tuple[np.ndarray, np.ndarray | None, float] | None = None

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
        state.reorder(cell_order(state.position, cutoff))
        self.list_shape = state.kernel_shape
        self.rebuild_list(state.position)

    def rebuild_list(self, positions: np.ndarray) -> None:
        """List neighbours at given positions (those of the last rebuild, when a run is resumed)."""
        support, last = SUPPORT * self.model.smoothing_length, self.neighbours
        metric, longest = self.metric(self.list_shape) if self.affine else (None, 1.0)
        self.neighbours = None
        self.neighbours = build_list(positions, support * (1.0 + SKIN), 0.5 * support * SKIN, metric, longest, last)

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
        for _ in range(STARTS - 1):
            self._solve(time, time_step, update=False)
        return self._solve(time, time_step, update=False)

    def longest_step(self) -> float:
        """Longest step that the method allows, s: any."""
        return float("inf")

    def step(self, time: float, time_step: float) -> StepReport:
        """Advance the state from `time` by `time_step` (s)."""
        self.refresh_neighbours()
        return self._solve(time, time_step, update=True)

    def operator(self, ahead: float, time: float, time_step: float) -> Operator:
        """Operator at the positions predicted for `ahead` seconds later."""
        state, model = self.state, self.model
        positions = state.position + ahead * state.velocity
        normals = (
            model.walls.nearest_normals(positions, time) if model.material.model in materials.NEEDS_NORMALS else None
        )
        viscosity = materials.evaluate(model.material, state, normals)
        if ahead > 0.0 and normals is None:
            for k in range(viscosity.directions.shape[1]):
                turned = np.ascontiguousarray(viscosity.directions[:, k])
                convect_directions(np.eye(3) + ahead * state.velocity_gradient, turned)
                viscosity.directions[:, k] = turned
        control = model.settings.zero_energy
        share = between_wall_layers(state.wall_layers)
        return assemble(
            self.weigh(positions), positions, state.volume, viscosity.shear * share,
            model.bulk_modulus * state.volume_ratio * time_step * share,
            viscosity.fibre * share[:, None], viscosity.directions,
            control.isotropic, control.bond, control.fibre,
            control.smooth_flow * smoothness(state.flow_residual) * viscosity.shear * share,
        )  # fmt: skip

    def _solve(self, time: float, dt: float, update: bool) -> StepReport:
        state, model = self.state, self.model
        speed = np.linalg.norm(model.walls.offsets(time + dt) - model.walls.offsets(time), axis=1).max(initial=0.0)
        pushed = model.walls.forced.velocities(dt)
        speed = max(speed, dt * np.linalg.norm(pushed, axis=1).max(initial=0.0))
        reach = 1.3 * float(model.walls.spacing.max()) + 2.0 * float(speed)
        contacts = model.walls.contacts(state, time, dt, reach)
        contacts.active |= contacts.gap <= TOUCH * model.spacing
        contacts.active |= contacts.violations(state.velocity[contacts.rows], dt) > TOUCH * model.spacing
        state.wall_layers = contacts.wall_layers(len(state))
        operator = self.operator(0.5 * dt if update else 0.0, time, dt)
        report = StepReport(time_step=dt)
        self.measured = None  # not needed while the solve holds most
        solution = self._active_set(operator, contacts, dt, report)
        self._account(operator, contacts, solution, dt, report)
        self.remember(contacts)
        model.walls.forced.adjust(report.tool_force, started=update)
        # What the solve held makes room for what the end of the step needs.
        velocities = solution.velocities
        del operator, contacts, solution
        if update:
            model.walls.forced.advance(pushed, dt)
            self._advance(velocities, dt)
            self.balance_volume(time + dt, dt * strain_rate(state.velocity_gradient))
        else:
            gradient, around, _ = self._gradient_at_start(velocities)
            if model.density == 0.0:
                state.velocity, state.velocity_gradient = velocities, gradient
                state.smooth_gradient, state.twice_smooth_gradient = around, around.copy()
        return report

    def _active_set(self, operator: Operator, contacts: Contacts, dt: float, report: StepReport) -> Solution:
        state, model = self.state, self.model
        inertia, rows = (model.density / dt) * state.volume, contacts.rows
        pressure = model.bulk_modulus * state.volume * (state.volume_ratio - 1.0)
        pressure *= between_wall_layers(state.wall_layers)
        load = inertia[:, None] * state.velocity
        load -= operator.pressure_force(pressure)
        blocks = operator.diagonal()
        blocks[:, :3] += inertia[:, None]
        del pressure
        velocities = state.velocity
        last = model.settings.contact_passes - 1
        attempt, rough = 0, 1.0 if last == 0 else ROUGH
        coarse: CoarseGrid | None = None
        while True:
            faces = self._friction(contacts, operator)
            drag, right_side = np.zeros((len(rows), 3, 3)), load
            if len(faces):
                drag, right_side = faces.sum(axis=1), load.copy()
                right_side[rows] += np.einsum("nkab,nkb->na", faces, contacts.wall_velocity)
            free, held = contacts.constrain(dt)
            inverse = restricted_inverse(blocks, rows, drag, free)
            system = VelocitySystem(operator, inertia, rows, drag, free, inverse)
            coarse = system.coarse = coarse or self._coarse_grid(system, blocks)
            stiffness = float(blocks[:, :3].mean())
            system.rigid = free_rigid_modes(operator.positions, inertia, rows, free, drag, stiffness)
            solution = conjugate_gradient(
                system.apply, system.project, system.precondition, right_side,
                system.feasible(velocities, held), tolerance=rough * model.settings.velocity_tolerance,
                max_iterations=model.settings.max_iterations, power_tolerance=rough * model.settings.power_tolerance,
                window=WINDOW if rough == 1.0 else ROUGH_WINDOW,
            )  # fmt: skip
            velocities = solution.velocities
            report.iterations += solution.iterations
            report.passes += 1
            report.estimated_error = solution.estimated_error
            report.unconverged += not solution.converged
            pressing, _ = contacts.reactions(-solution.residual[rows])
            positive = pressing[pressing > 0.0]
            limit = RELEASE * float(positive.mean()) if len(positive) else 0.0
            depth = contacts.violations(velocities[rows], dt)
            added = depth > NEGLIGIBLE * model.spacing
            # In the last pass nothing is released: a small pull for one step does less harm than a penetration.
            around = contacts.pressure_around(pressing, operator.pairs, model.smoothing_length)
            released = contacts.active & (around < -limit) if attempt < last else np.zeros_like(added)
            settled = not (added.any() or released.any())
            enough = attempt >= last and (
                attempt >= last + SPARE_PASSES or depth.max(initial=0.0) < DEEPEST * model.spacing
            )
            if enough or (settled and rough == 1.0):
                break
            contacts.active = (contacts.active & ~released) | added
            del system, solution, pressing, around
            # Which faces touch shows long before the velocities are exact: only the last pass need be.
            attempt = attempt if settled else attempt + 1
            rough = ROUGH if not settled and attempt < last else 1.0
        return solution

    def _coarse_grid(self, system: VelocitySystem, blocks: np.ndarray) -> CoarseGrid | None:
        """Coarse level of the preconditioner, for all passes of a step: it need not know the last faces that touch."""
        if not self.model.settings.coarse_level:
            return None
        operator = system.operator
        grid = make_grid(operator.positions, CELL * self.model.spacing)
        # What a tool holds is as stiff for the grid as the particle itself: the grid then leaves it alone.
        own = blocks[system.rows, :3].mean(axis=1)
        hold = own[:, None, None] * (np.eye(3) - system.free) + system.drag
        grid.stiffen(operator, system.inertia, system.rows, hold)
        return grid

    def _friction(self, contacts: Contacts, operator: Operator) -> np.ndarray:
        """Drag of Navier and no-slip walls at each face, shape (m, 3, 3, 3), Pa s mm; (0, 3, 3, 3) if all slip."""
        state, rows = self.state, contacts.rows
        if not self.model.walls.rub:
            return np.zeros((0, FACES, 3, 3))
        shear = operator.shear[rows] / between_wall_layers(state.wall_layers[rows])
        factor = np.where(contacts.active, self.model.walls.friction(contacts, shear), 0.0)
        area = contacts.areas(state.volume[rows] * state.volume_ratio[rows])
        tangent = np.eye(3) - contacts.normal[..., :, None] * contacts.normal[..., None, :]
        return (factor * area)[..., None, None] * tangent

    def _account(
        self, operator: Operator, contacts: Contacts, solution: Solution, dt: float, report: StepReport
    ) -> None:
        v = solution.velocities
        if not np.all(np.isfinite(v)):
            raise NumericalError(
                f"{int(np.sum(~np.isfinite(v).all(axis=1)))} particles have velocities that are not finite"
            )
        resisted = operator.apply(v)
        total = float(np.sum(v * resisted))
        gradient = velocity_gradient(operator.pairs, operator.positions, operator.volumes, operator.inverse, v)
        power, swelling = material_power(operator, gradient), np.einsum("nii->n", gradient)
        del resisted, gradient
        physical = float(np.sum(operator.volumes * power))
        report.dissipation = total
        report.zero_energy_share = max(0.0, 1.0 - physical / total) if total > 0.0 else 0.0
        _, forces = contacts.reactions(-solution.residual[contacts.rows])
        slide = v[contacts.rows, None, :] - contacts.wall_velocity
        faces = self._friction(contacts, operator)
        drag = -np.einsum("nkab,nkb->nka", faces, slide) if len(faces) else np.zeros_like(slide)
        body = self._body_power(power, swelling, v, dt) + total - physical
        forces *= power_scale(contacts, forces, drag, slide, body)
        self.add_tool_loads(contacts, forces + drag, operator.positions[contacts.rows], report)
        report.contacts = int(contacts.active.any(axis=1).sum())
        report.penetration = float(contacts.violations(v[contacts.rows], dt).max(initial=0.0))

    def _body_power(self, power: np.ndarray, swelling: np.ndarray, velocities: np.ndarray, dt: float) -> float:
        """Power, Pa mm^3/s, that the charge takes up, the half-cells behind wall layers included.

        Arguments are the material's power per volume and the divergence, both (n,), and the velocities (n, 3).
        """
        state, model = self.state, self.model
        pressure = model.bulk_modulus * (state.volume_ratio - 1.0)
        whole = power / between_wall_layers(state.wall_layers) + pressure * swelling
        gained = velocities * (velocities - state.velocity)
        inertia = model.density / dt * float(np.sum(state.volume[:, None] * gained)) if model.density > 0.0 else 0.0
        return float(np.sum(state.volume * whole)) + inertia

    def add_tool_loads(self, contacts: Contacts, forces: np.ndarray, positions: np.ndarray, report: StepReport) -> None:
        """Add what the particles exert on the tools, given the forces of the faces on them (m, 3, 3), to a report."""
        if len(report.tool_force) == 0:
            report.tool_force = np.zeros((len(self.model.walls.tools), 3))
            report.tool_moment = np.zeros((len(self.model.walls.tools), 3))
        whole = contacts.whole_cells()
        for k in range(contacts.tool.shape[1]):
            on = contacts.active[:, k]
            tool, force = contacts.tool[on, k], -whole[on, None] * forces[on, k]
            at = positions[on] - contacts.half_width[on, k, None] * contacts.normal[on, k]
            np.add.at(report.tool_force, tool, force)
            np.add.at(report.tool_moment, tool, np.cross(at, force))

    def _gradient_at_start(self, velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity gradient (n, 3, 3) where the step began, its mean around wall layers, rate of rearrangement (n,)."""
        state = self.state
        pairs = self.weigh(state.position)
        gradient = moments_and_gradient(pairs, state.position, state.volume, velocities)
        pairs.moments = None
        # Half-widths of a wall layer that differ by the noise of single gradients would carve the charge.
        around = mean_around(pairs, gradient, state.wall_layers > 0, pair_weight(0.0, self.model.smoothing_length))
        loose = rearrangement_rate(pairs, state.position, state.volume, velocities, gradient)
        return gradient, around, loose

    def remember(self, contacts: Contacts) -> None:
        """Put the faces touched into the state, where the next search finds them again."""
        # What touches now touches in the next solve, unless that finds otherwise; a solve that starts from no contact
        # would first let the whole charge drift.
        state = self.state
        state.contact_tool[:] = -1
        state.contact_tool[contacts.rows] = np.where(contacts.active, contacts.tool, -1)
        state.contact_normal[:] = 0.0
        state.contact_normal[contacts.rows] = contacts.normal

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
            state.kernel_shape = limited(state.lattice_shape, self.model.settings.kernel_aspect_limit)

    def packing(self, pairs: Pairs, time: float) -> np.ndarray:
        """Packing of each particle, shape (n,)."""
        model = self.model
        return measured_packing(
            self.state, model.walls, time, pairs, *self.metric(self.state.kernel_shape), model.smoothing_length,
            model.spacing,
        )  # fmt: skip

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
        limit = model.settings.kernel_aspect_limit if self.affine else 1.0
        correct_volume(
            state, pairs, self.packing(pairs, time), strain, model.settings.volume_correction,
            model.smoothing_length, limit,
        )  # fmt: skip


def strain_rate(gradient: np.ndarray) -> np.ndarray:
    """Norm of the rate of deformation, shape (n,), 1/s, of velocity gradients (n, 3, 3)."""
    rate = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
    return np.sqrt(np.einsum("nij,nij->n", rate, rate))
