"""Collimated disk between slip plates: the outline becomes an ellipse of aspect lambda^(1 - 1/R), within 1 %."""

import numpy as np
import pytest

from tests.solver.scenes import make_squeeze, run_to_end


@pytest.mark.slow  # 1,500 particles: a coarser disk has no outline to speak of
@pytest.mark.parametrize("compression", [2.0, 6.0 / 2.45])
def test_outline(compression):
    ratio, radius = 1000.0, 9.0
    integrator = make_squeeze((18, 18, 6), ratio=ratio, reduction=1.0 / compression)
    state = integrator.state
    from_axis = np.hypot(state.position[:, 0] - radius, state.position[:, 1] - radius)
    state.reorder(np.flatnonzero(from_axis < radius))
    state.original = np.arange(len(state))
    start = state.position.copy()
    result = run_to_end(integrator)
    end = result.state.in_original_order(result.state.position)
    exact = compression ** (1.0 - 1.0 / ratio)
    # Semi-axes from second moments, and from the outermost particles.
    stretch = end[:, :2].std(axis=0) / start[:, :2].std(axis=0)
    assert stretch[1] / stretch[0] == pytest.approx(exact, rel=0.01)
    reach = np.ptp(end[:, :2], axis=0) / np.ptp(start[:, :2], axis=0)
    assert reach[1] / reach[0] == pytest.approx(exact, rel=0.01)
