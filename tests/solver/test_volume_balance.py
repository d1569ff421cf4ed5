"""J is drawn towards the packing at the rate asked for, and only where the flow turns within a kernel."""

import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.tooling import BoxTool
from ppmc.solver.particles.neighbours import Pairs, build_list, weigh_pairs
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.volume_balance import correct_volume, measured_packing
from ppmc.solver.walls.tools import Walls

from .blocks import lattice

H, RATE, CROWDED = 1.3, 20.0, 0.98  # spacing of the lattice in that of its volumes: too dense by 1/0.98^3


def crowded(flow_residual: float) -> tuple[ParticleState, Walls, Pairs]:
    """Lattice too dense by 6 %, in a closed box that it fills."""
    x = CROWDED * lattice((6, 6, 6))
    side = 6.0 * CROWDED
    box = BoxTool(shape="box", center=(side / 2,) * 3, size=(side,) * 3, inside=True)
    walls = Walls(compile_tools({"box": box}), np.ones(3))
    p = np.tile([1.0, 0.0, 0.0], (len(x), 1))
    state = ParticleState.at_rest(x, np.ones(len(x)), p, np.roll(p, 1, axis=1), walls.starting_half_widths(x))
    state.flow_residual[:] = flow_residual
    return state, walls, weigh_pairs(build_list(x, 2.7, 0.05), x, H)


def correct(state: ParticleState, walls: Walls, pairs: Pairs, strain: float) -> np.ndarray:
    found = measured_packing(state, walls, 0.0, pairs, None, 1.0, H, 1.0)
    correct_volume(state, pairs, found, np.full(len(state), strain), RATE, H)
    return found.value


def test_ratio_approaches_the_packing_exponentially_with_the_strain():
    # u = J / J*, with J* = 0.98^3: du/ds = -rate u (u - 1), so u = 1 / (1 - (1 - 1/u0) exp(-rate s)).
    state, walls, pairs = crowded(flow_residual=1.0)
    np.testing.assert_allclose(correct(state, walls, pairs, 0.0), CROWDED**-3, rtol=4e-3)
    steps, total = 200, 0.05
    for _ in range(steps):
        correct(state, walls, pairs, total / steps)
    expected = CROWDED**3 / (1.0 - (1.0 - CROWDED**3) * np.exp(-RATE * total))
    np.testing.assert_allclose(state.volume_ratio, expected, rtol=4e-3)
    np.testing.assert_allclose(np.linalg.det(state.deformation_gradient), state.volume_ratio, rtol=1e-12)


@pytest.mark.parametrize(("flow_residual", "strain"), [(0.2, 0.05), (0.0, 0.05), (1.0, 0.0)])
def test_nothing_is_corrected_in_smooth_flow_or_at_rest(flow_residual, strain):
    state, walls, pairs = crowded(flow_residual)
    correct(state, walls, pairs, strain)
    np.testing.assert_array_equal(state.volume_ratio, 1.0)
    np.testing.assert_array_equal(state.deformation_gradient, np.broadcast_to(np.eye(3), (len(state), 3, 3)))
