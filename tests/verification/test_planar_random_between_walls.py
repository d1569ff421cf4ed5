"""Planar random charge between walls: A11 = lambda/(1 + lambda) within 0.01, force within 3 % (model.md 2.6).

The random fibres are in every particle (several directions with volume fractions, A3), which is the exact solution's
premise: all of them see the same deformation.
"""

import numpy as np
import pytest

from ppmc.scene.materials.orientation_mixture import OrientationMixture
from ppmc.solver import materials
from tests.solver.scenes import make_squeeze, run_to_end

DIRECTIONS = 12


def test_orientation_and_force():
    compression = 1.5
    ratio, shape = 116.0, (8, 8, 8)
    sides = (((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, 8.0, 0.0), (0.0, -1.0, 0.0)))
    integrator = make_squeeze(shape, ratio=ratio, reduction=1.0 / compression, walls=sides)
    integrator.model.material = OrientationMixture(
        shear_viscosity=1.0, anisotropy_ratio=ratio, angles=np.arange(DIRECTIONS) * 180.0 / DIRECTIONS,
        fractions=np.full(DIRECTIONS, 1.0 / DIRECTIONS),
    )  # fmt: skip
    result = run_to_end(integrator)
    p = materials.evaluate(integrator.model.material, result.state).directions
    assert np.mean(p[..., 0] ** 2) == pytest.approx(compression / (1.0 + compression), abs=0.01)
    fourth = compression * (2.0 * compression + 1.0) / (2.0 * (1.0 + compression) ** 2)
    assert np.mean(p[..., 0] ** 4) == pytest.approx(fourth, abs=0.01)
    now = result.compression
    fourth = now * (2.0 * now + 1.0) / (2.0 * (1.0 + now) ** 2)
    stress = (4.0 * (ratio - 1.0) * fourth + 4.0) * result.closing_rate
    assert result.press_force == pytest.approx(stress * 64.0 * now, rel=0.03)
