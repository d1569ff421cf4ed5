"""Collimated disk between slip plates: the outline becomes an ellipse of aspect lambda^(1 - 1/R), within 1 %."""

import numpy as np
import pytest

from tests.solver.scenes import make_squeeze, run_to_end

RADIUS = 9.0


def disk(ratio, **options):
    """Integrator of 1,500 particles in six layers; a coarser disk has no outline to speak of."""
    integrator = make_squeeze((18, 18, 6), ratio=ratio, **options)
    state = integrator.state
    state.reorder(np.flatnonzero(np.hypot(*(state.position[:, :2] - RADIUS).T) < RADIUS))
    state.original = np.arange(len(state))
    return integrator


@pytest.mark.parametrize("velocity_tolerance", [5e-4, 2e-3])
def test_no_face_lets_go_whatever_the_tolerance(velocity_tolerance):
    # All faces press, with 4 - 1/R viscosities times the closing rate. At this ratio reactions of single faces are
    # noise where velocities are right to a thousandth; at the rim, where columns end, some may be.
    integrator = disk(61_215.0, velocity_tolerance=velocity_tolerance)
    integrator.initialise(0.0, 1e-3)
    touching = int((integrator.state.contact_tool >= 0).any(axis=1).sum())
    for k in range(4):
        height = 6.0 - 3.0 * 0.02 * (k + 0.5)
        report = integrator.step(0.02 * k, 0.02)
        area = len(integrator.state) / height
        assert report.contacts > 0.97 * touching
        assert report.tool_force[1, 2] == pytest.approx(4.0 * 3.0 / height * area, rel=0.02)
        assert report.tool_force[0, 2] == pytest.approx(-report.tool_force[1, 2], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("compression", [2.0, 6.0 / 2.45])
def test_outline(compression):
    ratio = 1000.0
    integrator = disk(ratio, reduction=1.0 / compression)
    start = integrator.state.position.copy()
    result = run_to_end(integrator)
    end = result.state.in_original_order(result.state.position)
    exact = compression ** (1.0 - 1.0 / ratio)
    # Semi-axes from second moments, and from the outermost particles.
    stretch = end[:, :2].std(axis=0) / start[:, :2].std(axis=0)
    assert stretch[1] / stretch[0] == pytest.approx(exact, rel=0.01)
    reach = np.ptp(end[:, :2], axis=0) / np.ptp(start[:, :2], axis=0)
    assert reach[1] / reach[0] == pytest.approx(exact, rel=0.01)
