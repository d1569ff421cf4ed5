"""Plates that part: the charge follows as long as its pull is less than the ambient pressure, and stays behind else.

Between slip plates a block is drawn out uniformly; the plates bear 3 eta rate, at R = 1,000 and with fibres along the
plates 4 eta rate, for these let it narrow across them only. Pull beyond the ambient pressure leaves it as it was.
"""

import numpy as np
import pytest

from ppmc.solver.step.explicit import ExplicitIntegrator
from tests.solver.scenes import make_squeeze, run_to_end

DRAWN = 1.3  # height at the end over that of the start
RATE = DRAWN - 1.0  # at the start, where the pull is largest, 1/s


# What pulls most decides, and where fibres are stiff and stand unevenly, reactions scatter.
@pytest.mark.parametrize(
    ("ratio", "trouton", "jitter", "reserve"),
    [(1, 3, 0.0, 1.5), (1, 3, 0.2, 1.5), (1000, 4, 0.0, 1.5), (1000, 4, 0.2, 20)],
)
def test_block_follows_plates_that_part(ratio, trouton, jitter, reserve):
    ambient = reserve * trouton * RATE
    result = run_to_end(make_squeeze((8, 8, 6), float(ratio), DRAWN, jitter=jitter, ambient_pressure=ambient))
    narrow = DRAWN**-0.5 if ratio == 1 else 1.0 / DRAWN
    expected = [DRAWN**-0.5 if ratio == 1 else 1.0, narrow, DRAWN]
    np.testing.assert_allclose(np.diagonal(result.stretch.mean(axis=0)), expected, rtol=0.01)
    height = 6.0 / result.compression
    pull = trouton * (6.0 * RATE / height) * (384.0 / height)
    assert result.press_force == pytest.approx(-pull, rel=0.03)
    assert result.reports[-1].contacts == 128


@pytest.mark.parametrize("ambient_pressure", [0.0, 0.5 * 3.0 * RATE])
def test_charge_stays_behind_where_the_pull_is_too_strong(ambient_pressure):
    result = run_to_end(make_squeeze((8, 8, 6), 1.0, DRAWN, ambient_pressure=ambient_pressure))
    np.testing.assert_allclose(np.diagonal(result.stretch.mean(axis=0)), 1.0, atol=0.01)
    assert result.press_force == pytest.approx(0.0, abs=1e-6)


# The plate starts at once, which takes some eta23 v / dx beside the 3 eta23 rate.
@pytest.mark.parametrize(("ambient_pressure", "height"), [(20.0, 1.1), (0.1, 1.0)])
def test_explicit_integrator_holds_and_lets_go(ambient_pressure, height):
    implicit = make_squeeze(
        (5, 5, 4), 1.0, 1.1, bulk_ratio=30.0, integrator="explicit", reynolds_number=1e-3,
        ambient_pressure=ambient_pressure,
    )  # fmt: skip
    implicit.model.density = 1e-3 * 3.0 / (0.4 * 4.0)
    integrator = ExplicitIntegrator(implicit.model, implicit.state)
    integrator.initialise(0.0, 1e-3)
    for k in range(20):
        integrator.step(0.05 * k, 0.05)
    stretch = integrator.state.deformation_gradient.mean(axis=0)
    assert stretch[2, 2] == pytest.approx(height, abs=0.01)
