"""Jeffery orbit: period 2 pi (a + 1/a)/rate, for a = 10 (xi = .980198), within 0.1 % (model.md 2.2)."""

import numpy as np
import pytest

from ppmc.solver.sph.transport import convect_directions, jeffery_increment


def test_period():
    shear = np.zeros((1, 3, 3))
    shear[0, 0, 1] = 1.0
    step, aspect = 0.05, 10.0
    shape_factor = (aspect**2 - 1.0) / (aspect**2 + 1.0)
    assert shape_factor == pytest.approx(0.980198, abs=1e-6)
    increment = jeffery_increment(shear, step, shape_factor)
    direction, angles = np.array([[1.0, 0.0, 0.0]]), [0.0]
    for _ in range(1400):
        convect_directions(increment, direction)
        angles.append(np.arctan2(direction[0, 1], direction[0, 0]))
    turned = -np.unwrap(angles)
    period = step * np.interp(2.0 * np.pi, turned, np.arange(len(turned)))
    assert period == pytest.approx(2.0 * np.pi * (aspect + 1.0 / aspect), rel=1e-3)
    assert period == pytest.approx(63.4602, rel=1e-3)


def test_disc_normals_stay_orthogonal_to_fibres():
    gradient = np.random.default_rng(0).normal(size=(5, 3, 3))
    p, r = np.tile([1.0, 0.0, 0.0], (5, 1)), np.tile([0.0, 0.0, 1.0], (5, 1))
    for xi in (1.0, 0.9):
        convect_directions(jeffery_increment(gradient, 0.3, xi), p)
        convect_directions(jeffery_increment(gradient, 0.3, -xi), r)
        np.testing.assert_allclose(np.einsum("na,na->n", p, r), 0.0, atol=1e-12)
