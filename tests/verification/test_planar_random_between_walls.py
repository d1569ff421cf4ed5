"""Planar random charge between walls: A11 = lambda/(1 + lambda) within 0.01, force within 3 % (model.md 2.6).

The random fibres are in every particle (several directions with volume fractions, A3), which is the exact solution's
premise: all of them see the same deformation.
"""

import numpy as np
import pytest

from ppmc.materials.orientation_mixture import OrientationMixture
from ppmc.solver.step.rheology import Rheology
from tests.solver.scenes import make_squeeze, run_to_end

DIRECTIONS, RATIO = 12, 116.0


def squeezed(compression: float):
    """Squeeze of 8 x 8 x 8 particles, and the fibre directions at its end."""
    shape = (8, 8, 8)
    sides = (((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, 8.0, 0.0), (0.0, -1.0, 0.0)))
    integrator = make_squeeze(shape, ratio=RATIO, reduction=1.0 / compression, walls=sides)
    integrator.model.material = OrientationMixture(
        shear_viscosity=1.0, anisotropy_ratio=RATIO, angles=np.arange(DIRECTIONS) * 180.0 / DIRECTIONS,
        fractions=np.full(DIRECTIONS, 1.0 / DIRECTIONS),
    )  # fmt: skip
    result = run_to_end(integrator)
    return result, Rheology(integrator.model, result.state, 1.0).directions


def fourth_moment(compression: float) -> float:
    """A1111."""
    return compression * (2.0 * compression + 1.0) / (2.0 * (1.0 + compression) ** 2)


@pytest.mark.parametrize("compression", [1.5, pytest.param(7.0 / 3.0, marks=pytest.mark.slow)])
def test_orientation(compression):
    _, p = squeezed(compression)
    assert np.mean(p[..., 0] ** 2) == pytest.approx(compression / (1.0 + compression), abs=0.01)
    assert np.mean(p[..., 0] ** 4) == pytest.approx(fourth_moment(compression), abs=0.01)


@pytest.mark.parametrize("compression", [1.5, pytest.param(7.0 / 3.0, marks=pytest.mark.slow)])
def test_force(compression):
    result, _ = squeezed(compression)
    now = result.compression
    stress = (4.0 * (RATIO - 1.0) * fourth_moment(now) + 4.0) * result.closing_rate
    assert result.press_force == pytest.approx(stress * 64.0 * now, rel=0.03)
