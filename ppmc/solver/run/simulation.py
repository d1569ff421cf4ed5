"""The run: steps, frames, checkpoints, stop requests, from a prepared model to the end time."""

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppmc.errors import NumericalError, StoppedWithCheckpoint
from ppmc.files.verdict import FORCE_ESTIMATE, KEY
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.notices import inform, tell
from ppmc.progress import Progress
from ppmc.solver.grid.integrator import GridIntegrator
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.run import mixing, verdict
from ppmc.solver.run.checkpoint import Checkpoint
from ppmc.solver.run.coverage import Coverage, least_force, touching
from ppmc.solver.run.frames import Snapshot, field_names, frame
from ppmc.solver.run.history import History, StepMeasures
from ppmc.solver.run.records import Record
from ppmc.solver.run.resume import constants_of
from ppmc.solver.run.stop_requests import StopRequests
from ppmc.solver.step.explicit import ExplicitIntegrator
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.measures import outside
from ppmc.solver.step.model import Model, Place, StepReport
from ppmc.solver.step.time_step import event_times, fit_to_times, proposed_step

MOST_VOLUME_ERROR = 0.3  # mean |J - 1| beyond which a result means nothing; soft K reaches 0.26 (model of A5)
FIRST_STEP_SHARE = 1e-3  # of the end time: step assumed by the solve that finds the velocities at the start


@dataclass
class Simulation:
    """One run on its way.

    Attributes
    ----------
    model : Model
    state : ParticleState
    record : Record
        Takes the frames, and what else a run leaves behind: in files, or in memory.
    """

    model: Model
    state: ParticleState
    record: Record

    def run(self, resume: bool = True, max_walltime: float | None = None) -> None:
        """Go to the end time, or as far as a stop request lets it.

        Raises
        ------
        NumericalError
            If values stop being finite; a record in files keeps the state.
        StoppedWithCheckpoint
            On SIGTERM or the wall-clock limit; the same command goes on from there.
        KeyboardInterrupt
            On Ctrl-C, after the checkpoint; at once where the record keeps none.
        """
        settings = self.model.settings
        events = event_times(
            settings.end_time, settings.output_interval or settings.end_time / 20.0, settings.output_times or ()
        )
        self._open(resume)
        last_save, step_cost = clock.monotonic(), 0.0
        requests = StopRequests(max_walltime, signals=self.record.keeps)
        with requests, Progress("flow", total=settings.end_time, unit="s") as bar:
            while self.time < events[-1]:
                target = min(next(t for t in events if t > self.time), self.model.walls.tools.next_break(self.time))
                before = clock.monotonic()
                self._step(target)
                if self.time == target and target in events:
                    self._write_frame()
                bar.update(self.time, self._note())
                now = clock.monotonic()
                step_cost = max(now - before, 0.5 * step_cost)
                expired = requests.expired(3.0 * step_cost + 1.0)
                if self.time >= events[-1]:
                    break
                if requests.checkpoint or requests.stop or expired or now - last_save > settings.checkpoint_interval:
                    self._save()
                    last_save, requests.checkpoint = now, False
                if requests.interrupted:
                    raise KeyboardInterrupt(
                        f"at t = {self.time:.6g} s, {self.record.frames} frames and a checkpoint are written; "
                        "the same command goes on from there"
                    )
                if requests.stop or expired:
                    reason = requests.stop or "the wall-clock limit"
                    raise StoppedWithCheckpoint(
                        f"stopped by {reason} at t = {self.time:.6g} s; the same command resumes there"
                    )
            # While signals are still requests: neither they nor a full disk then cost more than joining the file.
            self._save()
        history = self.history.by_column()
        told = verdict.judge(
            history, self.model.walls.tools.names, self.model.spacing, self.model.bulk_modulus
        )  # fmt: skip
        self.record.seal(history, self._facts() | self._force_estimate() | {KEY: told.as_facts()})

    def _open(self, resume: bool) -> None:
        table = self.record.table
        names = self.model.walls.tools.names
        saved = self.record.going_on(self.model, resume)
        if saved is None:
            self.integrator = self._make_integrator()
            self.time, self.step_size = 0.0, np.inf
            self.history = History(names, table)
            self.coverage = Coverage(len(names), self._least_force)
            self.report = self._guarded(
                lambda: self.integrator.initialise(0.0, FIRST_STEP_SHARE * self.model.settings.end_time)
            )
            static = {
                "platelet_id": self.state.platelet_id, "reference_position": self.state.reference_position,
                "volume": self.state.volume,
            }  # fmt: skip
            self.record.begin(
                {k: self.state.in_original_order(v) for k, v in static.items()},
                field_names(self.model), ("press_force", "mean_volume_ratio_error", "contacts"),
            )  # fmt: skip
            self._write_frame()
            return
        self.state = saved.state
        self.integrator = self._make_integrator()
        self.integrator.list_shape = saved.list_shape
        self.integrator.rebuild_list(saved.list_positions)
        self.model.walls.forced.displacement = saved.forced
        self.model.walls.forced.speed, self.model.walls.forced.trend = saved.forced_speed
        self.time, self.step_size = saved.time, saved.time_step
        self.report = StepReport()
        self.history = History(names, table, saved.history)
        self.coverage, _ = verdict.follow(self.history.by_column(), names, self._least_force)
        inform(f"resumed at t = {self.time:.6g} s, step {len(self.history.rows)}")

    @property
    def _least_force(self) -> float:
        """Force below which a tool has not pressed, Pa mm^2."""
        return least_force(self.model.bulk_modulus, self.model.spacing)

    def _make_integrator(self) -> ImplicitIntegrator:
        settings = self.model.settings
        if settings.operator == "grid":
            return GridIntegrator(self.model, self.state)
        explicit = settings.integrator == "explicit"
        return (ExplicitIntegrator if explicit else ImplicitIntegrator)(self.model, self.state)

    def _step(self, target: float) -> None:
        settings = self.model.settings
        step = proposed_step(
            self.state.velocity_gradient, settings.max_strain_increment, settings.max_displacement,
            min(settings.max_time_step or np.inf, self.integrator.longest_step()), self.step_size,
        )  # fmt: skip
        if not np.isfinite(step):
            step = 10.0 * FIRST_STEP_SHARE * settings.end_time
        self.step_size = step
        step = fit_to_times(self.time, step, target)
        last = step >= target - self.time
        before, start = touching(self.state, self.coverage.direction), self.time
        self.report = self._guarded(lambda: self.integrator.step(self.time, step))
        self.time = target if last else self.time + step
        self.history.add(self.time, self.report, self.state, self._measure(before, self.time - start))
        self._check_coverage()

    def _guarded(self, advance: Callable[[], StepReport]) -> StepReport:
        try:
            report = advance()
            self._check_finite()
        except NumericalError as error:
            raise NumericalError(f"{error} (t = {self.time:.6g} s{self._dump()})") from error
        return report

    def _check_finite(self) -> None:
        s = self.state
        for name in ("position", "velocity", "deformation_gradient", "fibre_direction", "volume_ratio"):
            values = getattr(s, name).reshape(len(s), -1)
            bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
            if len(bad):
                ids = sorted(s.original[bad].tolist())
                raise NumericalError(f"{name} is not finite at {len(bad)} particles, the first: {ids[:5]}")
        worst = int(np.argmin(s.volume_ratio))
        if s.volume_ratio[worst] <= 0.0:
            raise NumericalError(
                f"particle {s.original[worst]} has turned inside out (J = {s.volume_ratio[worst]:.3g})"
            )

        lost = abs(float(np.average(s.volume_ratio, weights=s.volume)) - 1.0)
        if lost > MOST_VOLUME_ERROR:
            raise NumericalError(
                f"the charge's mean volume ratio is off by {lost:.3g}: the step has gone astray; "
                "try a smaller solver.max_strain_increment or a larger solver.bulk_ratio"
            )

    def _measure(self, before: np.ndarray, dt: float) -> StepMeasures:
        """Measure what a step of `dt` (s) has left; `before`, shape (tools, n), touched each tool at its start."""
        neighbours, walls = self.integrator.neighbours, self.model.walls
        assert neighbours is not None
        touched = touching(self.state, self.coverage.direction)
        cover = self.coverage.cover(self.report.touched, self.report.tool_force)
        closing = self.coverage.closing(self._tool_velocities(dt))
        self.coverage.add(self.time, cover, self.report.tool_force, closing, dt)
        share = self.coverage.share(cover, closing)
        released = self.history.last_place("released")
        if not np.isnan(share).all():
            tool = int(np.nanargmin(share))
            gone = np.flatnonzero(before[tool] & ~touched[tool])
            if len(gone):
                x1, x2, x3 = self.state.position[self.state.original == gone[0]][0].tolist()
                released = Place(int(gone[0]), (x1, x2, x3))
        return StepMeasures(
            self.integrator.take_packing(self.time), outside(self.state, walls, neighbours, self.time),
            self._press_force(), cover, closing, released,
        )  # fmt: skip

    def _check_coverage(self) -> None:
        told = verdict.let_go(
            self.coverage, self.model.walls.tools.names, self.model.spacing, self.history.last_place("released")
        )
        if told is not None:
            raise NumericalError(f"{told} (t = {self.time:.6g} s{self._dump()})")

    def _tool_velocities(self, dt: float) -> np.ndarray:
        """Velocities of all tools in a step of `dt` (s) that has just ended, shape (tools, 3), mm/s."""
        walls = self.model.walls
        velocities = walls.tools.velocities(max(self.time - 1e-9 * self.model.settings.end_time, 0.0))
        return np.asarray(velocities + walls.forced.velocities(dt))

    def _dump(self) -> str:
        """Keep the state that went wrong, and return in words where it is; nothing where it is not kept."""
        path = self.record.dump(self.state, self.time)
        return "" if path is None else f"; the state is in {path}"

    def _press_force(self) -> float:
        """Force, uN, with which the moving tools press against the charge, along their motion."""
        tools = self.model.walls.tools
        velocities = tools.velocities(max(self.time - 1e-9 * self.model.settings.end_time, 0.0))
        for forced in tools.motions.forced:
            velocities[forced.tool] = forced.direction
        total = 0.0
        for velocity, force in zip(velocities, self.report.tool_force, strict=False):
            speed = float(np.linalg.norm(velocity))
            total -= float(force @ velocity) / speed if speed > 0.0 else 0.0
        return total

    def _write_frame(self) -> None:
        snapshot = Snapshot.take(self.integrator, self.time)
        error = float(np.abs(self.state.volume_ratio - 1.0).mean())
        scalars = {
            "press_force": self._press_force(),
            "mean_volume_ratio_error": error,
            "contacts": float(self.report.contacts),
        }
        self.record.append(self.time, snapshot.state.position, frame(snapshot, self.model), scalars)

    def _save(self) -> None:
        if not self.record.keeps:
            return
        neighbours = self.integrator.neighbours
        assert neighbours is not None
        self.record.save(Checkpoint(
            self.state, neighbours.positions, self.integrator.list_shape, self.history.table(),
            self.model.walls.forced.displacement,
            np.stack([self.model.walls.forced.speed, self.model.walls.forced.trend]),
            self.time, self.step_size, self.record.frames, constants_of(self.model),
        ))  # fmt: skip

    def _note(self) -> str:
        return f"step {len(self.history.rows)}, {self.report.iterations} iterations, {self.report.contacts} contacts"

    def _force_estimate(self) -> dict[str, dict[str, Any]]:
        """Return, as a fact, how far the force may be too high; nothing where that is not known. Says it, too."""
        model, state = self.model, self.state
        if model.settings.operator != "particles" or not isinstance(model.material, TransverselyIsotropic):
            return {}
        estimate = mixing.estimate_force(
            self.integrator.weigh(state.position), state.fibre_direction, model.material.ratio
        )  # fmt: skip
        if estimate.is_bound:
            tell(estimate.told())
        return {FORCE_ESTIMATE: estimate.as_facts()}

    def _facts(self) -> dict[str, Any]:
        return {
            "bulk_modulus": self.model.bulk_modulus, "density": self.model.density,
            "smoothing_length": self.model.smoothing_length, "spacing": self.model.spacing,
            "steps": len(self.history.rows), "iterations": int(sum(row[2] for row in self.history.rows)),
            "tools": list(self.model.walls.tools.names),
        }  # fmt: skip
