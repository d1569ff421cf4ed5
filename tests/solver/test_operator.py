"""The discrete operator: exact for linear fields, adjoint, conserving, and equal to its definition."""

import numpy as np
import pytest

from ppmc.solver.particles.kernel_shape import full
from ppmc.solver.particles.smoothing import kernel_value
from ppmc.solver.sph.gradient import velocity_gradient
from ppmc.solver.sph.power import material_power
from ppmc.solver.sph.viscosity import dissipation, viscous_stress

from .blocks import dense_matrix, lattice, make_operator, power_by_definition, stretched, unit_vectors


@pytest.fixture(scope="module")
def spheres() -> tuple:
    positions = lattice((6, 5, 4), jitter=0.2)
    return positions, make_operator(positions, unit_vectors(len(positions)))


@pytest.fixture(scope="module", params=["spheres", "a shape each"])
def block(request) -> tuple:
    positions = lattice((6, 5, 4), jitter=0.2)
    shape = None if request.param == "spheres" else stretched(len(positions), 1.5, 2)
    return positions, make_operator(positions, unit_vectors(len(positions)), shape=shape), shape


def test_linear_patch_is_exact_on_jittered_particles_with_free_surfaces(block):
    positions, operator, _ = block
    gradient = np.array([[0.3, -1.2, 0.7], [0.1, 0.4, -0.9], [2.0, 0.6, -0.7]])
    found = velocity_gradient(
        operator.pairs, positions, operator.volumes, operator.inverse, positions @ gradient.T + 5.0
    )
    np.testing.assert_allclose(found, np.broadcast_to(gradient, found.shape), rtol=0, atol=1e-10)


def test_power_and_gradient_equal_their_definition(block):
    positions, operator, shape = block
    velocities = np.random.default_rng(3).normal(size=positions.shape)
    power, gradients = power_by_definition(operator, velocities, shape=shape)
    assert np.sum(velocities * operator.apply(velocities)) == pytest.approx(power, rel=1e-8)
    found = velocity_gradient(operator.pairs, positions, operator.volumes, operator.inverse, velocities)
    np.testing.assert_allclose(found, gradients, atol=3e-7)  # weights may differ in their last single bit


@pytest.mark.parametrize("directions", [0, 1, 3])
@pytest.mark.parametrize("aspect", [1.0, 1.5])
def test_symmetric_positive_semidefinite_with_six_rigid_modes(directions, aspect):
    positions = lattice((4, 4, 3), jitter=0.2)
    p = np.concatenate([unit_vectors(len(positions), seed) for seed in range(3)], axis=1)[:, :directions]
    matrix = dense_matrix(make_operator(positions, p, shape=stretched(len(positions), aspect, 2)))
    scale = np.abs(matrix).max()
    assert np.abs(matrix - matrix.T).max() < 1e-12 * scale
    eigenvalues = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    assert eigenvalues.min() > -1e-10 * scale
    # No zero-energy modes but the three translations and three rotations.
    assert np.sum(eigenvalues < 1e-8 * scale) == 6


@pytest.mark.parametrize("ratio", [1.0, 1000.0, 61215.0])
@pytest.mark.parametrize("aspect", [1.0, 1.5])
def test_momentum_angular_momentum_and_rigid_motion(ratio, aspect):
    positions = lattice((6, 5, 4), jitter=0.2)
    shape = stretched(len(positions), aspect, 2)
    operator = make_operator(positions, unit_vectors(len(positions)), ratio=ratio, shape=shape)
    velocities = np.random.default_rng(4).normal(size=positions.shape)
    force = operator.apply(velocities)
    scale = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * scale
    assert np.abs(np.cross(positions, force).sum(axis=0)).max() < 1e-11 * scale
    spin = np.cross(np.array([0.3, -0.8, 0.5]), positions) + np.array([1.0, 2.0, 3.0])
    assert np.abs(operator.apply(spin)).max() < 1e-10 * np.abs(force).max()


def test_force_is_the_adjoint_of_the_gradient(block):
    positions, operator, _ = block
    rng = np.random.default_rng(5)
    stress = rng.normal(size=(len(positions), 3, 3))
    stress = stress + np.swapaxes(stress, 1, 2)
    velocities = rng.normal(size=positions.shape)
    gradient = velocity_gradient(operator.pairs, positions, operator.volumes, operator.inverse, velocities)
    work = np.sum(stress * gradient)
    assert np.sum(operator.stress_force(stress) * velocities) == pytest.approx(work, rel=1e-12)


def test_linear_field_dissipates_the_material_power_only(block):
    # The zero-energy control does not see linear fields.
    positions, operator, _ = block
    gradient = np.array([[0.3, -1.2, 0.7], [0.1, 0.4, -0.9], [2.0, 0.6, -0.2]])
    velocities = positions @ gradient.T
    rate = np.broadcast_to(0.5 * (gradient + gradient.T), (len(positions), 3, 3))
    stress = viscous_stress(rate, operator.shear, operator.fibre, operator.directions)
    power = np.sum(rate * stress) + np.sum(operator.bulk) * np.trace(gradient) ** 2
    assert np.sum(velocities * operator.apply(velocities)) == pytest.approx(power, rel=1e-8)


def test_trace_of_the_gradient_is_the_rate_of_the_packing_in_its_own_kernel(block):
    # d/dt sum_j V_j W(x_ij . G_i x_ij) = -tr(G_i L_i M_i) for any velocities: the gradient is made of the same sums.
    positions, operator, shape = block
    velocities = np.random.default_rng(6).normal(size=positions.shape)
    metric = np.broadcast_to(np.eye(3), (len(positions), 3, 3)) if shape is None else np.linalg.inv(full(shape))

    def packing(x: np.ndarray) -> np.ndarray:
        d = x[None] - x[:, None]
        squared = np.einsum("ija,iab,ijb->ij", d, metric, d)
        return np.array([[kernel_value(float(r2), 1.3) for r2 in line] for line in squared]).sum(axis=1)

    step = 1e-5
    rate = (packing(positions + step * velocities) - packing(positions - step * velocities)) / (2.0 * step)
    gradient = velocity_gradient(operator.pairs, positions, operator.volumes, operator.inverse, velocities)
    expected = -np.einsum("nab,nbc,nca->n", metric, gradient, np.linalg.inv(operator.inverse))
    np.testing.assert_allclose(rate, expected, atol=1e-6 * np.abs(expected).max())


def test_diagonal_blocks(spheres):
    _, operator = spheres
    isotropic = make_operator(operator.positions, np.empty((len(operator.positions), 0, 3)), bulk=0.0)
    isotropic.control[:, 1] = 0.0
    exact = dense_matrix(isotropic)
    blocks = full(isotropic.diagonal())
    for i in (0, 33, 119):
        np.testing.assert_allclose(blocks[i], exact[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], rtol=1e-10, atol=1e-10)
    # With directions the blocks are an estimate: same size, positive definite.
    exact = dense_matrix(operator)
    blocks = full(operator.diagonal())
    for i in (0, 33, 119):
        block = exact[3 * i : 3 * i + 3, 3 * i : 3 * i + 3]
        assert 0.7 < np.trace(blocks[i]) / np.trace(block) < 1.4
        assert np.linalg.eigvalsh(blocks[i]).min() > 0.0


def test_material_power_is_stress_times_rate(spheres):
    _, operator = spheres
    gradient = np.random.default_rng(4).normal(size=(len(operator.positions), 3, 3))
    stress = viscous_stress(gradient, operator.shear, operator.fibre, operator.directions)
    expected = dissipation(gradient, stress) + operator.bulk * np.trace(gradient, axis1=1, axis2=2) ** 2
    np.testing.assert_allclose(material_power(operator, gradient), expected, rtol=1e-12)
