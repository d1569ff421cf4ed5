"""Slip squeezes to a tenth of the height: force within 3 % all the way, stretches within 1 %."""

import numpy as np
import pytest

from ppmc.solver.step.time_step import fit_to_times, proposed_step
from tests.solver.scenes import make_squeeze


def check_deep(ratio: float, angle: float, **options: object) -> None:
    """Squeeze a block to a tenth, and compare force and stretch in every step after the first."""
    integrator = make_squeeze((6, 6, 10), ratio=ratio, angle=angle, reduction=0.1, bulk_ratio=4000.0, **options)
    state, settings = integrator.state, integrator.model.settings
    stress = 3.0 if ratio == 1.0 else 4.0 - 1.0 / ratio
    integrator.initialise(0.0, 1e-3)
    time, step = 0.0, np.inf
    while time < 1.0 - 1e-12:
        step = proposed_step(
            state.velocity_gradient, settings.max_strain_increment, settings.max_displacement, np.inf, step
        )
        length = fit_to_times(time, step, 1.0)
        report = integrator.step(time, length)
        height = 10.0 - 9.0 * (time + 0.5 * length)
        time += length
        assert report.tool_force[1, 2] == pytest.approx(stress * 9.0 * 360.0 / height**2, rel=0.03)
    f = state.deformation_gradient
    across, along = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
    exact = np.full(2, 10.0**0.5) if ratio == 1.0 else 10.0 ** np.array([1 - 0.5 / ratio, 0.5 / ratio])
    if angle == 0.0:
        found = [np.einsum("a,nab,b->n", d, f, d) for d in (across, along)]
        np.testing.assert_allclose([v.mean() for v in found], exact, rtol=0.01)
        assert max(v.std() / v.mean() for v in found) < 0.02
    np.testing.assert_allclose(np.linalg.det(f), 1.0, atol=0.02)


@pytest.mark.slow
def test_newtonian():
    check_deep(1.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 37.0])
def test_collimated(angle):
    check_deep(1000.0, angle)
