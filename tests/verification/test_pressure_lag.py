"""Pressure lag of the bulk penalty (A5), K/(eta11 rate) = 1, 10, 100: within 1 % of the incompressible pressure.

The papers stretch one element along its fibres. Tools can only push, so here a block is squeezed along its fibres,
which obeys the same equation, J - 1 = (2/9)(eta11/K)(F11'/F11 - F22'/F22) with F22 = F33 = sqrt(J/F11).
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.solver.scenes import make_squeeze

RATIO, END = 10.0, 1.0
CASES = [(k, closing, shape) for k in (1.0, 10.0, 100.0) for closing, shape in ((0.15, (4, 4, 8)), (0.05, (6, 6, 10)))]


def exact_volume_ratio(bulk: float, closing: float, times: np.ndarray) -> np.ndarray:
    eta11 = 4.0 * RATIO - 1.0

    def rate_of_log_j(time: float, log_j: np.ndarray) -> np.ndarray:
        stretch_rate = -closing / (1.0 - closing * time)
        lateral = stretch_rate - 4.5 * bulk / eta11 * (np.exp(log_j) - 1.0)
        return stretch_rate + 2.0 * lateral

    return np.exp(solve_ivp(rate_of_log_j, (0.0, END), [0.0], "LSODA", times, rtol=1e-10, atol=1e-12).y[0])


@pytest.mark.parametrize(("stiffness", "closing", "shape"), CASES)
def test_pressure_follows_the_lag_equation(stiffness, closing, shape):
    eta11 = 4.0 * RATIO - 1.0
    bulk = stiffness * eta11 * closing
    up = np.tile([0.0, 0.0, 1.0], (int(np.prod(shape)), 1))
    integrator = make_squeeze(shape, ratio=RATIO, reduction=1.0 - closing, directions=up)
    integrator.model.bulk_modulus = bulk
    integrator.state.in_plane_direction[:] = [1.0, 0.0, 0.0]
    # The lag time is eta11/(9 K), the pressure first order in time: short steps, above all at first.
    times = np.concatenate([[0.0], np.geomspace(5e-4, 0.1, 120), np.linspace(0.1, END, 160)[1:]])
    integrator.initialise(0.0, 1e-9)
    exact = exact_volume_ratio(bulk, closing, times)
    pressures = [0.0]
    for start, end in pairwise(times):
        integrator.step(start, end - start)
        pressures.append(float(-bulk * (integrator.state.volume_ratio.mean() - 1.0)))
    incompressible = eta11 * closing / (3.0 * (1.0 - closing * times))
    np.testing.assert_allclose(pressures, -bulk * (exact - 1.0), atol=0.01 * incompressible.max())
