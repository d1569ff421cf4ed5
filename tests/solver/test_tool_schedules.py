"""Tools that strike, carry and rest: free ways before the charge is reached, and holds after it."""

import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.implicit import ImplicitIntegrator, strain_rate
from ppmc.solver.step.model import Model, StepReport
from ppmc.solver.walls.tools import Walls

from .blocks import lattice

SIDE, GAP = 6, 2.0
Heights = tuple[tuple[float, float], ...]


def table_of(heights: Heights) -> dict:
    times, along = zip(*heights, strict=True)
    return {"times": times, "displacements": [(0.0, 0.0, z) for z in along]}


def between_plates(lower: Heights, upper: Heights, ratio: float = 1.0, mixed: bool = False) -> ImplicitIntegrator:
    """A cube on a plate, the other one `GAP` above it; times and displacements of both."""
    x = lattice((SIDE, SIDE, SIDE))
    planes = {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1), motion=table_of(lower)),
        "upper": PlaneTool(shape="plane", point=(0, 0, SIDE + GAP), normal=(0, 0, -1), motion=table_of(upper)),
    }
    walls = Walls(compile_tools(planes), np.ones(3))
    section = SolverSection(end_time=1.0)
    angle = np.random.default_rng(0).uniform(0.0, np.pi, len(x)) if mixed else np.zeros(len(x))
    p = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(x))], axis=1)
    state = ParticleState.at_rest(
        x, np.ones(len(x)), p, np.cross([0.0, 0.0, 1.0], p), walls.starting_half_widths(x)
    )  # fmt: skip
    material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=ratio)
    return ImplicitIntegrator(
        Model(section, material, walls, section.smoothing_ratio, 300.0 * (ratio + 2.0), 0.0), state
    )  # fmt: skip


def in_steps(integrator: ImplicitIntegrator, times: list[float]) -> list[StepReport]:
    integrator.initialise(0.0, 1e-3)
    return [integrator.step(a, b - a) for a, b in zip([0.0, *times], times, strict=False)]


REST, AWAY = ((0.0, 0), (1.0, 0)), GAP + 0.5 * SIDE


@pytest.mark.parametrize("carried", [False, True])
def test_a_tool_strikes_in_the_middle_of_a_step_and_the_squeeze_is_exact(carried):
    # Half of the way is free. A step ten times too long for the flow that follows begins before the tool strikes.
    table = ((0.0, 0), (1.0, AWAY if carried else -AWAY))
    integrator = between_plates(*((table, REST) if carried else (REST, table)))
    in_steps(integrator, [0.3, 0.6, 0.8, 0.9, 1.0])
    state = integrator.state
    stretch = state.deformation_gradient.mean(axis=0)
    np.testing.assert_allclose(stretch, np.diag([2.0**0.5, 2.0**0.5, 0.5]), atol=0.015)
    assert state.deformation_gradient.std(axis=0).max() < 0.02
    assert np.abs(state.volume_ratio - 1.0).max() < 0.01
    height = np.ptp(state.position[:, 2]) * SIDE / (SIDE - 1)
    assert height == pytest.approx(0.5 * SIDE, rel=0.01)


def test_nothing_is_solved_on_the_free_way():
    table = ((0.0, 0), (1.0, -0.9 * GAP))
    integrator = between_plates(REST, table, ratio=1000.0, mixed=True)
    start = integrator.state.in_original_order(integrator.state.position).copy()
    reports = in_steps(integrator, [0.25, 0.5, 1.0])
    assert sum(report.iterations for report in reports) == 0
    np.testing.assert_array_equal(integrator.state.in_original_order(integrator.state.position), start)


def test_what_the_charge_creeps_before_a_tool_arrives_is_not_resolved():
    table = ((0.0, 0), (1.0, -0.9 * GAP))
    integrator = between_plates(REST, table, ratio=1000.0, mixed=True)
    integrator.initialise(0.0, 1e-3)
    noise = np.random.default_rng(1).normal(size=integrator.state.velocity.shape)
    integrator.state.velocity[:] = 1e-9 * noise
    integrator.state.volume_ratio[:] += 1e-12 * noise[:, 0]
    assert integrator.step(0.0, 0.1).iterations < 72  # two solves of three windows each
    assert np.abs(integrator.state.velocity).max() < 1e-3


def test_what_tools_give_and_what_pressure_gives_back_are_told_apart(monkeypatch):
    """All of a squeeze is driven, and nothing of what swollen and shrunken particles do between resting tools."""
    table = ((0.0, 0), (0.4, -GAP - 0.5), (1.0, -GAP - 0.5))
    integrator = between_plates(REST, table, ratio=1000.0, mixed=True)
    pressing = in_steps(integrator, [0.3, 0.35, 0.4])[-1]
    assert pressing.driven_share == pytest.approx(1.0, abs=0.02)
    integrator.state.volume_ratio[:] = 1.0 + np.random.default_rng(1).uniform(-0.02, 0.02, len(integrator.state))
    asked: list[np.ndarray] = []
    monkeypatch.setattr(integrator, "balance_volume", lambda _, strain: asked.append(strain))
    relaxing = integrator.step(0.4, 1e-3)
    assert relaxing.dissipation > pressing.dissipation
    assert relaxing.driven_share < 0.01
    # Else the correction of packing, which makes such flows, would feed on them.
    assert asked[0].max() < 0.01 * 1e-3 * strain_rate(integrator.state.velocity_gradient).max()


@pytest.mark.parametrize("ratio", [1.0, 1000.0])
def test_nothing_moves_or_costs_in_a_hold(ratio):
    # What the bulk's penalty has stored, 1/300 of the volume and less, is given back in the first step.
    table = ((0.0, 0), (0.4, -GAP - 0.5), (1.0, -GAP - 0.5))
    integrator = between_plates(REST, table, ratio)
    in_steps(integrator, [0.1, 0.2, 0.3, 0.35, 0.4])
    start = integrator.state.in_original_order(integrator.state.position).copy()
    hold = [integrator.step(time, 0.1) for time in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9)]
    moved = integrator.state.in_original_order(integrator.state.position) - start
    assert np.abs(moved).max() < 0.02
    assert max(report.iterations for report in hold[1:]) < 72  # two solves of three windows each
    assert abs(integrator.state.volume_ratio - 1.0).max() < 1e-3


def test_a_tool_that_withdraws_does_not_pull():
    table = ((0.0, 0), (0.5, -GAP - 1.0), (1.0, -GAP))
    integrator = between_plates(REST, table, ratio=1000.0, mixed=True)
    pressing = in_steps(integrator, [0.3, 0.4, 0.45, 0.5])[-1]
    assert pressing.tool_force[1, 2] > 0.0
    away = [integrator.step(time, 0.05) for time in (0.5, 0.55, 0.6)]
    for report in away:
        assert report.tool_force[1, 2] > -0.01 * pressing.tool_force[1, 2]
    distance = integrator.model.walls.tools.distances(integrator.state.position, 0.65)[0][1]
    assert distance.min() > 0.4
