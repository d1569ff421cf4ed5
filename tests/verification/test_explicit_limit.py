"""Explicit and implicit integrator in their common limit: the same motion, velocities and press force without inertia.

Two unlike plies (R = 100, 0 and 90 degrees) between slip plates, to .8 of the height: they slide over one another, and
a third of the power is the zero-energy control's. Scaled mass is an error of first order in the Reynolds number.
"""

from itertools import pairwise

import numpy as np
import pytest

from ppmc.solver.step.explicit import ExplicitIntegrator
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.time_step import fit_to_times
from tests.solver.scenes import make_squeeze

SHAPE, RATIO, REDUCTION = (6, 6, 4), 100.0, 0.8
LATE = 0.9  # s, of one: the mean press force is taken from here on
REYNOLDS = (4e-3, 2e-3, 1e-3)


class Outcome:
    """Positions and velocities (n, 3) at the end, in the charge's order, and the mean force of the last tenth."""

    def __init__(self, integrator: ImplicitIntegrator, longest: float) -> None:
        integrator.initialise(0.0, 1e-3)
        time, impulse = 0.0, 0.0
        while time < 1.0 - 1e-12:
            step = min(longest, integrator.longest_step())
            step = fit_to_times(time, step, LATE if time < LATE - 1e-12 else 1.0)
            report = integrator.step(time, step)
            time += step
            impulse += step * report.tool_force[1, 2] if time > LATE + 1e-12 else 0.0
        state = integrator.state
        self.force = impulse / (1.0 - LATE)
        self.position = state.in_original_order(state.position)
        self.velocity = state.in_original_order(state.velocity)


def block(**settings: object) -> ImplicitIntegrator:
    """Two plies of two layers each."""
    count = SHAPE[0] * SHAPE[1]
    upper = np.tile(np.arange(SHAPE[2]) >= SHAPE[2] // 2, count)
    directions = np.where(upper[:, None], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    return make_squeeze(
        shape=SHAPE, ratio=RATIO, reduction=REDUCTION, bulk_ratio=100.0, directions=directions, **settings
    )


def explicit(implicit: ImplicitIntegrator, reynolds: float, height: float) -> ExplicitIntegrator:
    """Explicit integrator of a block of a height, mm, with the mass that makes a Reynolds number."""
    material = implicit.model.material
    speed = height * (1.0 - REDUCTION)
    implicit.model.density = reynolds * (material.ratio + 2.0) * material.shear / (speed * height)
    return ExplicitIntegrator(implicit.model, implicit.state)


def relative(difference: np.ndarray, reference: np.ndarray) -> float:
    """Root mean square of a difference over that of the reference."""
    return float(np.linalg.norm(difference) / np.linalg.norm(reference))


def test_explicit_and_implicit_agree_without_inertia():
    start = block().state.position
    steady = Outcome(block(max_strain_increment=0.2, velocity_tolerance=1e-5), 1.0 / 80.0)
    runs = [
        Outcome(explicit(block(integrator="explicit", reynolds_number=value), value, SHAPE[2]), 0.05)
        for value in REYNOLDS
    ]
    forces = np.array([run.force for run in runs])
    moved = [relative(run.position - steady.position, steady.position - start) for run in runs]
    velocities = [relative(run.velocity - steady.velocity, steady.velocity) for run in runs]
    assert velocities[-1] < 0.01
    assert moved[-1] < 0.01
    assert forces[-1] == pytest.approx(steady.force, rel=0.01)
    # First order in what inertia adds: halving it halves the differences between runs.
    orders = np.log2((forces[0] - forces[1]) / (forces[1] - forces[2]))
    changes = [relative(a.position - b.position, start) for a, b in pairwise(runs)]
    assert orders == pytest.approx(1.0, abs=0.3)
    assert np.log2(changes[0] / changes[1]) == pytest.approx(1.0, abs=0.3)


def test_walls_rub_alike():
    options = {"shape": (8, 8, 3), "reduction": REDUCTION, "wall": {"friction": 2.0}}
    steady = Outcome(make_squeeze(**options, max_strain_increment=0.2, velocity_tolerance=1e-5), 1.0 / 80.0)
    scaled = make_squeeze(**options, integrator="explicit", reynolds_number=4e-3)
    start = scaled.state.position
    run = Outcome(explicit(scaled, 4e-3, 3.0), 0.05)
    assert run.force == pytest.approx(steady.force, rel=0.002)
    assert relative(run.position - steady.position, steady.position - start) < 0.002
