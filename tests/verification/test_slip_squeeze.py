"""Slip squeeze to half height: mean F within 0.5 %, scatter below 2 %, press force within 2 % (model.md 2.6)."""

import numpy as np
import pytest

from tests.solver.scenes import squeeze
from tests.solver.test_squeeze import collimated_stretch

ALL = [(r, angle, jitter) for r in (116.0, 1000.0, 61215.0) for angle in (0.0, 33.0, 90.0) for jitter in (0.0, 0.2)]
QUICK = [(61215.0, 33.0, 0.2)]
SLOW = [pytest.param(*case, marks=pytest.mark.slow) for case in ALL if case not in QUICK]


@pytest.mark.parametrize(("ratio", "angle", "jitter"), QUICK + SLOW)
def test_collimated(ratio, angle, jitter):
    result = squeeze(shape=(8, 8, 8), ratio=ratio, angle=angle, jitter=jitter)
    found, exact = result.stretch, collimated_stretch(ratio, 2.0, angle)
    np.testing.assert_allclose(found.mean(axis=0).diagonal(), exact.diagonal(), rtol=5e-3)
    assert np.all(found.std(axis=0).diagonal() < 0.02 * exact.diagonal())
    force = (4.0 - 1.0 / ratio) * result.closing_rate * 64.0 * result.compression
    assert result.press_force == pytest.approx(force, rel=0.02)
    assert result.state.volume_ratio.mean() == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("shape", "jitter"), [((8, 8, 8), 0.2), ((8, 8, 3), 0.0), pytest.param((12, 12, 10), 0.0, marks=pytest.mark.slow)]
)
def test_isotropic(shape, jitter):
    result = squeeze(shape=shape, jitter=jitter)
    found, exact = result.stretch, collimated_stretch(1.0, 2.0, 0.0)
    np.testing.assert_allclose(found.mean(axis=0).diagonal(), exact.diagonal(), rtol=5e-3)
    assert np.all(found.std(axis=0).diagonal() < 0.02 * exact.diagonal())
    force = 3.0 * result.closing_rate * shape[0] * shape[1] * result.compression
    assert result.press_force == pytest.approx(force, rel=0.02)
    assert result.state.volume_ratio.mean() == pytest.approx(1.0, abs=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "shape"), [(1.0, (12, 12, 10)), (1000.0, (8, 8, 8)), (61215.0, (8, 8, 8))])
def test_to_a_fifth_of_the_height(ratio, shape):
    result = squeeze(shape=shape, ratio=ratio, reduction=0.2)
    found, exact = result.stretch, collimated_stretch(ratio, 5.0, 0.0)
    np.testing.assert_allclose(found.mean(axis=0).diagonal(), exact.diagonal(), rtol=0.01)
    assert np.all(found.std(axis=0).diagonal() < 0.05 * exact.diagonal())
