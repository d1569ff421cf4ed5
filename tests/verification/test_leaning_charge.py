"""A charge of tilted planes between slip plates with free sides: it leans, as the exact homogeneous flow does."""

import numpy as np
import pytest

from ppmc.materials.orientation_mixture import OrientationMixture
from tests.solver.scenes import make_squeeze, squeeze

SHAPE = (10, 8, 6)
ANGLES = (0.0, 60.0, 120.0)  # as isotropic in their plane, up to the fourth order, as all directions are


def exact_flow(ratio, tilt):
    """D11, D22, twice D13 and -sigma33 / eta23 for a closing rate of one: the least power with s11 = s22 = s13 = 0.

    Fibres lie evenly in a plane turned by `tilt` (radians) about x2; with D_tt in its direction t
    <(D : pp)^2> = (3 D_tt^2 + 3 D_22^2 + 2 D_tt D_22) / 8.
    """
    c, s = np.cos(tilt), np.sin(tilt)
    # Columns: what a unit of closing, of D11 at the cost of D22, and of shear 2 D13 adds to D_tt and D_22.
    in_plane = np.array([[-s * s, c * c, c * s], [1.0, -1.0, 0.0]])
    fibres = 4.0 * (ratio - 1.0) / 8.0 * in_plane.T @ np.array([[3.0, 1.0], [1.0, 3.0]]) @ in_plane
    matrix = 2.0 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, 0.0], [0.0, 0.0, 0.5]])  # D22 = 1 - D11
    power = fibres + matrix
    along, shear = np.linalg.solve(power[1:, 1:], -power[1:, 0])
    every = np.array([1.0, along, shear])
    return along, 1.0 - along, shear, every @ power @ every


def leaning(ratio, tilt, velocity_tolerance):
    """Integrator of a block whose planes of fibres are tilted by `tilt` degrees."""
    angle = np.radians(tilt)
    directions = np.tile([np.cos(angle), 0.0, np.sin(angle)], (int(np.prod(SHAPE)), 1))
    integrator = make_squeeze(
        shape=SHAPE, ratio=ratio, directions=directions, bulk_ratio=1e6, velocity_tolerance=velocity_tolerance
    )  # fmt: skip
    integrator.state.in_plane_direction[:] = [0.0, 1.0, 0.0]
    integrator.model.material = OrientationMixture(
        shear_viscosity=1.0, anisotropy_ratio=ratio, angles=ANGLES, fractions=(1 / 3, 1 / 3, 1 / 3)
    )
    return integrator


@pytest.mark.parametrize(
    ("ratio", "tilt"), [(100.0, 5.0), (1000.0, 2.0), (1000.0, 0.5), (61215.0, 2.0), (61215.0, 0.2)]
)
def test_tilted_planes_slide_as_the_exact_flow(ratio, tilt):
    angle = np.radians(tilt)
    integrator = leaning(ratio, tilt, velocity_tolerance=1e-4)
    report = integrator.initialise(0.0, 1e-3)
    gradient = integrator.state.velocity_gradient.mean(axis=0)
    closing = -gradient[2, 2]
    assert closing == pytest.approx(0.5, rel=2e-3)
    along, across, shear, force = exact_flow(ratio, angle)
    found = np.array([gradient[0, 0], gradient[1, 1], gradient[0, 2]]) / closing
    np.testing.assert_allclose(found, [along, across, shear], rtol=5e-3, atol=2e-3)
    assert report.tool_force[1, 2] == pytest.approx(force * 0.5 * SHAPE[0] * SHAPE[1], rel=5e-3)


@pytest.mark.parametrize("velocity_tolerance", [1e-4, 5e-4])
def test_rounding_decides_nothing(velocity_tolerance):
    """Positions that differ by what processors differ by: the same faces touch, and the plates bear the same."""
    forces, faces = [], 2 * SHAPE[0] * SHAPE[1]
    for seed in range(3):
        integrator = leaning(61215.0, 2.0, velocity_tolerance)
        noise = np.random.default_rng(seed).uniform(-1.0, 1.0, integrator.state.position.shape)
        integrator.state.position += 1e-12 * noise
        report = integrator.initialise(0.0, 1e-3)
        assert report.contacts > 0.9 * faces
        forces.append(report.tool_force[1, 2])
    np.testing.assert_allclose(forces, forces[0], rtol=2e-3)


def test_planes_that_cannot_stretch_slide_with_twice_the_cotangent():
    tilt = np.radians(2.0)
    assert exact_flow(1e12, tilt)[2] == pytest.approx(-2.0 / np.tan(2.0 * tilt), rel=1e-6)


def test_a_flat_charge_of_mixed_fibres_keeps_volume_and_contact():
    """A random fibre in each particle, thickness a sixth of the width: mean F and the interior's packing hold."""
    shape = (24, 24, 4)
    n = int(np.prod(shape))
    angles = np.random.default_rng(0).uniform(0.0, np.pi, n)
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(n)], axis=1)
    result = squeeze(shape=shape, ratio=1000.0, directions=directions, bulk_ratio=4000.0, max_strain_increment=0.05)
    f = result.state.deformation_gradient
    assert f[:, 2, 2].mean() == pytest.approx(0.5, rel=0.03)
    assert np.linalg.det(f[:, :2, :2]).mean() == pytest.approx(2.0, rel=0.03)
    assert result.reports[-1].contacts > 0.9 * 2 * shape[0] * shape[1]
    integrator, x = result.integrator, result.state.position
    packing = integrator.packing(integrator.weigh(x), 1.0).value / result.state.packing_reference
    away = np.abs(x[:, :2] - x[:, :2].mean(axis=0))
    middle = packing[(away < np.median(away, axis=0)).all(axis=1)]
    assert np.quantile(middle, 0.05) > 0.97
    assert np.quantile(middle, 0.95) < 1.03
