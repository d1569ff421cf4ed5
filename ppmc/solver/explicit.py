r"""Explicit integrator: the papers' route, with scaled mass.

Velocities advance by :math:`\Delta t\,f/m` with the force of the same operator, pressure :math:`-K(J-1)` and
unilateral contact by projection of the velocity. The stable step follows from the operator itself: with the largest
eigenvalues of the viscous and of the volumetric stiffness over the mass, :math:`\lambda_v` and :math:`\lambda_K`
(power iterations),

.. math:: \Delta t = \frac{0.8}{\lambda_v/2 + \sqrt{\lambda_K}/2},

which holds for each alone (2/lambda_v and 2/sqrt(lambda_K), less the safety) and for both together.
"""

import math
from dataclasses import dataclass

import numpy as np

from ppmc.solver import materials
from ppmc.solver.block_jacobi import multiply_blocks
from ppmc.solver.contact import Contacts
from ppmc.solver.implicit import ImplicitIntegrator, StepReport, material_power
from ppmc.solver.operator import Operator, assemble
from ppmc.solver.reductions import dot

SAFETY = 0.8
POWER_ITERATIONS = 20
CONTACT_EVERY = 10  # steps between searches for faces; gaps are advanced linearly in between
LIMITS_EVERY = 100  # steps between estimates of the stable step
MOST_STEPS = 200  # explicit steps in one reported step


@dataclass
class Limits:
    """Stable steps, s: by viscosity, by sound, and the one used."""

    viscous: float
    courant: float
    used: float


class ExplicitIntegrator(ImplicitIntegrator):
    """Advances by many small steps within each reported one."""

    limits: Limits | None = None

    def initialise(self, time: float, time_step: float) -> StepReport:
        """Start from rest."""
        self.refresh_neighbours(force=True)
        self.limits = self._estimate_limits(self._explicit_operator(time))
        used = self.limits
        print(
            f"explicit: viscous limit {used.viscous:.3g} s, Courant limit {used.courant:.3g} s, step {used.used:.3g} s"
        )
        return StepReport()

    def longest_step(self) -> float:
        """Longest reported step, s."""
        return math.inf if self.limits is None else MOST_STEPS * self.limits.used

    def step(self, time: float, time_step: float) -> StepReport:
        """Advance the state from `time` by `time_step` (s), in steps that are stable."""
        report = StepReport()
        report.tool_force = np.zeros((len(self.model.walls.tools), 3))
        elapsed, ahead = 0.0, True
        while ahead:
            self.limits = self._estimate_limits(self._explicit_operator(time))
            count = max(1, math.ceil((time_step - elapsed) / self.limits.used - 1e-9))
            dt, steps = (time_step - elapsed) / count, min(count, LIMITS_EVERY)
            ahead = steps < count
            for k in range(steps):
                if k % CONTACT_EVERY == 0:
                    self.refresh_neighbours()
                    reach = 1.5 * float(self.model.walls.spacing.max())
                    contacts = self.model.walls.contacts(self.state, time + elapsed, dt, reach)
                self.model.walls.forced.advance(self.model.walls.forced.velocities(dt), dt)
                self._substep(contacts, time + elapsed, dt, report, last=not ahead and k == steps - 1)
                elapsed += dt
            report.iterations += steps
        report.time_step = time_step / report.iterations
        report.tool_force /= report.iterations
        self.model.walls.forced.adjust(report.tool_force)
        return report

    def _explicit_operator(self, time: float) -> Operator:
        state, model = self.state, self.model
        normals = None
        if model.material.model in materials.NEEDS_NORMALS:
            normals = model.walls.nearest_normals(state.position, time)
        viscosity = materials.evaluate(model.material, state, normals)
        # Pressure is a given stress here; its zero-energy modes are held with the stiffness of a planar random squeeze.
        stiffness = (model.material.ratio + 2.0) * viscosity.shear
        control = model.settings.zero_energy
        operator = assemble(
            self.weigh(state.position), state.position, state.volume, viscosity.shear, stiffness, viscosity.fibre,
            viscosity.directions, control.isotropic, control.volumetric, control.fibre,
        )  # fmt: skip
        operator.bulk = np.zeros(len(state))
        return operator

    def _estimate_limits(self, operator: Operator) -> Limits:
        state, model = self.state, self.model
        mass = model.density * state.volume[:, None]
        viscous = _largest_eigenvalue(operator.apply, mass, state.original)
        n = len(state)
        sound = Operator(
            operator.pairs, operator.positions, operator.volumes, operator.inverse, operator.trace, operator.first,
            np.zeros(n), np.full(n, model.bulk_modulus), np.zeros((n, 0)), np.zeros((n, 0, 3)), np.zeros((n, 2)),
        )  # fmt: skip
        courant = math.sqrt(_largest_eigenvalue(sound.apply, mass, state.original))
        return Limits(2.0 / viscous, 2.0 / courant, SAFETY / (0.5 * viscous + 0.5 * courant))

    def _substep(self, contacts: Contacts, time: float, dt: float, report: StepReport, last: bool) -> None:
        state, model = self.state, self.model
        operator = self._explicit_operator(time)
        pressure = -model.bulk_modulus * state.volume * (state.volume_ratio - 1.0)
        force = operator.stress_force(pressure[:, None, None] * np.eye(3))
        force -= operator.apply(state.velocity)
        drag, load = self._friction(contacts)
        force += load - multiply_blocks(drag, state.velocity)
        mass = model.density * state.volume[:, None]
        trial = state.velocity + dt * force / mass
        contacts.active = np.zeros_like(contacts.active)
        contacts.active = contacts.violations(trial, dt) > 0.0
        free, held = contacts.constrain(dt)
        velocities = multiply_blocks(free, trial) + held
        push = mass * (velocities - trial) / dt
        _, forces = contacts.reactions(push)
        # Velocities at the wall chatter; the layer moves with the tool, less its own flattening.
        flattening = np.einsum("nab,nkb->nka", state.smooth_gradient, contacts.normal)
        layer = contacts.wall_velocity + contacts.half_width[..., None] * flattening
        forces *= contacts.power_factor(forces, layer)
        for k in range(contacts.tool.shape[1]):
            on = contacts.active[:, k]
            np.add.at(report.tool_force, contacts.tool[on, k], -forces[on, k])
        relative = velocities[:, None, :] - contacts.wall_velocity
        contacts.gap = contacts.gap + dt * np.einsum("nkc,nkc->nk", contacts.normal, relative)
        if last:
            rate = 0.5 * (state.velocity_gradient + np.swapaxes(state.velocity_gradient, 1, 2))
            report.dissipation = float(np.sum(state.velocity * operator.apply(state.velocity)))
            physical = float(np.sum(state.volume * material_power(operator, rate)))
            report.zero_energy_share = max(0.0, 1.0 - physical / max(report.dissipation, 1e-300))
            report.contacts = int(contacts.active.any(axis=1).sum())
        self._remember(contacts)
        self._advance(velocities, dt)


def _largest_eigenvalue(apply, mass: np.ndarray, original: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    """Largest eigenvalue of M^-1 A by power iterations from a start that depends on the particles' numbers alone."""
    start = np.sin(np.arange(1.0, 3.0 * len(original) + 1.0)).reshape(-1, 3)[original]
    vector, value = start, 0.0
    for _ in range(POWER_ITERATIONS):
        image = apply(vector) / mass
        value = math.sqrt(dot(image, image) / max(dot(vector, vector), 1e-300))
        vector = image / max(math.sqrt(dot(image, image)), 1e-300)
    # Power iterations come from below; a twentieth is more than they miss after so many.
    return 1.05 * value
