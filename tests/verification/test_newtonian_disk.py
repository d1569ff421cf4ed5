"""Newtonian disk of radius 4 h between plates: force by slip (2 %), wall friction (3 %) and no-slip (Stefan, 10 %)."""

import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.solver.walls.tools import Walls
from ppmc.walls import NavierFriction, NoSlip, Slip
from tests.solver.scenes import make_squeeze

LAYERS, RATIO, SPEED = 6, 4.0, 3.0
STEPS, TIME_STEP = 18, 5e-3  # until the bulk penalty has built up the pressure


def squeezed_disk(wall, layers: int = LAYERS, material=None) -> tuple[float, float, float]:
    """Force on the ram, Pa mm^2, and the radius and height, mm, to which it belongs; viscosity 1 Pa s, if not given."""
    radius = RATIO * layers
    side = int(2 * radius)
    reduction = 1.0 - SPEED / layers
    integrator = make_squeeze((side, side, layers), reduction=reduction, bulk_ratio=1000.0, material=material)
    state, walls = integrator.state, integrator.model.walls
    state.reorder(np.flatnonzero(np.hypot(state.position[:, 0] - radius, state.position[:, 1] - radius) < radius))
    state.original = np.arange(len(state))
    planes = {
        name: tool.model_copy(update={"wall": wall})
        for name, tool in zip(walls.tools.names, walls.tools.tools, strict=True)
    }
    integrator.model.walls = Walls(compile_tools(planes), walls.spacing)
    integrator.initialise(0.0, TIME_STEP)
    for k in range(STEPS):
        report = integrator.step(k * TIME_STEP, TIME_STEP)
    assert report.unconverged == 0
    height = layers - SPEED * (STEPS - 0.5) * TIME_STEP
    return float(report.tool_force[1, 2]), radius * np.sqrt(layers / height), height


def slip_force(radius: float, height: float) -> float:
    return 3.0 * np.pi * radius**2 * SPEED / height


def test_slip():
    force, radius, height = squeezed_disk(Slip())
    assert force == pytest.approx(slip_force(radius, height), rel=0.02)


def test_wall_friction():
    friction = 0.005  # h friction/eta = 0.03: plug flow
    force, radius, height = squeezed_disk(NavierFriction(friction=friction))
    # Plug flow, v = r V/(2 h), rubs on both plates.
    added = np.pi * friction * SPEED * radius**4 / (4.0 * height**2)
    assert force == pytest.approx(slip_force(radius, height) + added, rel=0.03)


def test_stefan():
    force, radius, height = squeezed_disk(NoSlip())
    assert force == pytest.approx(1.5 * np.pi * radius**4 * SPEED / height**3, rel=0.10)
