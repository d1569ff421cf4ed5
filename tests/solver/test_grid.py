"""Velocities on a grid: exact for linear fields, adjoint, symmetric, in balance with walls, and deterministic."""

import numpy as np
import pytest
import scipy.sparse as sp
from pydantic import ValidationError

from ppmc.scene.sections.solver import SolverSection
from ppmc.solver.grid.body import make_body
from ppmc.solver.grid.cells import lay_lines
from ppmc.solver.grid.factor import has_pardiso
from ppmc.solver.grid.integrator import GridIntegrator
from ppmc.solver.grid.recover import recover
from ppmc.solver.grid.shapes import NODES, sub_points
from ppmc.solver.grid.stiffness import Material, make_stiffness

from . import scenes
from .blocks import lattice, unit_vectors
from .test_squeeze import collimated_stretch

NO_WALLS = (np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)))
SPHERE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def block(shape, jitter=0.0, ratio=100.0, directions=None):
    """Positions and stiffness of a block of particles of unit spacing."""
    x = lattice(shape, jitter)
    n, extents = len(x), np.ones((len(x), 3))
    metric = np.broadcast_to(SPHERE, (n, 6)).copy()
    body = make_body(lay_lines(x, extents, NO_WALLS), x, np.ones(n), metric, extents, 1.0, NO_WALLS)
    p = unit_vectors(n) if directions is None else directions
    material = Material(np.ones(n), np.full((n, p.shape[1]), 4.0 * (ratio - 1.0)), p, np.full(n, 50.0))
    return x, make_stiffness(body, material)


def nodes_of(grid):
    """Places of the nodes, shape (nodes, 3), mm."""
    out, offset = np.empty((grid.node_count, 3)), np.array(list(np.ndindex(3, 3, 3))) / 2.0
    out[grid.nodes] = grid.low[:, None] + offset * grid.size[:, None]
    return out


def dense(stiffness):
    """Return the stiffness as a matrix."""
    n = 3 * stiffness.body.grid.node_count
    upper = sp.triu(sp.bsr_matrix((stiffness.data, stiffness.indices, stiffness.pointers), shape=(n, n))).toarray()
    return np.asarray(upper + np.triu(upper, 1).T)


def on_grid(shape, **options):
    """Integrator of a squeeze with velocities on a grid."""
    made = scenes.make_squeeze(shape=shape, operator="grid", **options)
    return GridIntegrator(made.model, made.state)


def test_functions_add_up_to_one_and_reproduce_linear_fields():
    local, gradients = sub_points()
    corners = np.array(list(np.ndindex(3, 3, 3))) - 1.0
    assert gradients.shape == (len(local), NODES, 3)
    np.testing.assert_allclose(gradients.sum(axis=1), 0.0, atol=1e-14)
    np.testing.assert_allclose(np.einsum("qac,ad->qcd", gradients, corners), np.broadcast_to(np.eye(3), (64, 3, 3)))


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_the_body_has_the_volume_of_its_particles_and_each_cell_as_many_shares(jitter):
    x, stiffness = block((6, 6, 6), jitter)
    body = stiffness.body
    assert body.weight.sum() == pytest.approx(len(x), rel=1e-9 if jitter == 0.0 else 0.05)
    assert stiffness.volume.sum() == pytest.approx(body.weight.sum(), rel=1e-12)
    assert set(body.particle) == set(range(len(x)))


@pytest.mark.parametrize("directions", [1, 2])
def test_symmetric_and_positive_with_six_rigid_motions(directions):
    p = np.concatenate([unit_vectors(4 * 4 * 3, seed) for seed in range(directions)], axis=1)
    _, stiffness = block((4, 4, 3), 0.2, 1000.0, p)
    matrix = dense(stiffness)
    values = np.linalg.eigvalsh(matrix)
    assert values[0] > -1e-9 * values[-1]
    assert np.sum(values < 1e-11 * values[-1]) == 6
    places = nodes_of(stiffness.body.grid)
    spin = np.cross([0.3, -0.8, 0.5], places) + np.array([1.0, 2.0, 3.0])
    assert np.abs(matrix @ spin.ravel()).max() < 1e-11 * values[-1] * np.abs(spin).max()


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_linear_field_is_recovered_and_takes_the_power_of_the_material(jitter):
    p = np.tile([[[0.6, 0.8, 0.0]]], (216, 1, 1))
    x, stiffness = block((6, 6, 6), jitter, 1000.0, p)
    gradient = np.array([[0.3, -1.2, 0.7], [0.1, 0.4, -0.9], [2.0, 0.6, -0.7]])
    found = recover(stiffness, x, nodes_of(stiffness.body.grid) @ gradient.T + 5.0)
    np.testing.assert_allclose(found.velocity, x @ gradient.T + 5.0, atol=1e-12)
    np.testing.assert_allclose(found.gradient, np.broadcast_to(gradient, (216, 3, 3)), atol=1e-11)
    rate, volume = 0.5 * (gradient + gradient.T), stiffness.volume.sum()
    along = p[0, 0] @ rate @ p[0, 0]
    assert found.viscous == pytest.approx(volume * (2.0 * np.sum(rate**2) + 4.0 * 999.0 * along**2), rel=1e-10)
    assert found.bulk == pytest.approx(0.0, abs=1e-10)


def test_pressure_is_the_adjoint_of_the_divergence():
    _, stiffness = block((6, 5, 4), 0.2)
    nodal = np.random.default_rng(2).normal(size=(stiffness.body.grid.node_count, 3))
    load = stiffness.pressure_load(np.full(6 * 5 * 4, 3.0))
    divergence = np.einsum("ca,ca->", stiffness.moments[:, 0], nodal[stiffness.body.grid.nodes].reshape(-1, 81))
    assert np.sum(load * nodal) == pytest.approx(-3.0 * divergence, rel=1e-10)


def test_power_is_that_of_the_matrix():
    x, stiffness = block((4, 4, 4), 0.3, 61215.0)
    nodal = np.random.default_rng(3).normal(size=(stiffness.body.grid.node_count, 3))
    found = recover(stiffness, x, nodal)
    whole = nodal.ravel() @ dense(stiffness) @ nodal.ravel()
    assert found.viscous + found.air + found.bulk == pytest.approx(whole, rel=1e-9)


@pytest.mark.parametrize(("ratio", "shape"), [(1.0, (6, 6, 3)), (61215.0, (6, 6, 4))])
def test_squeeze_of_a_lattice_is_exact(ratio, shape):
    integrator = on_grid(shape, ratio=ratio, max_strain_increment=0.05, bulk_ratio=4000.0)
    result = scenes.run_to_end(integrator)
    exact = collimated_stretch(ratio, 2.0, 0.0)
    np.testing.assert_allclose(result.stretch, np.broadcast_to(exact, result.stretch.shape), atol=2e-3)
    force = (4.0 - 1.0 / ratio) * result.closing_rate * shape[0] * shape[1] * result.compression
    assert result.press_force == pytest.approx(force, rel=3e-3)
    lower, ram = result.reports[-1].tool_force[:, 2]
    assert lower == pytest.approx(-ram, rel=1e-3)
    assert max(report.penetration for report in result.reports) < 1e-6


def test_same_bytes_whatever_is_solved_before():
    first, second = (on_grid((4, 4, 4), ratio=1000.0, jitter=0.2) for _ in range(2))
    first.initialise(0.0, 1e-3)
    on_grid((4, 4, 3), jitter=0.1).initialise(0.0, 1e-3)
    second.initialise(0.0, 1e-3)
    assert first.state.velocity.tobytes() == second.state.velocity.tobytes()


def test_both_direct_solvers_find_the_same(monkeypatch):
    found = []
    for here in (has_pardiso(), False):
        monkeypatch.setattr("ppmc.solver.grid.factor.has_pardiso", lambda here=here: here)
        integrator = on_grid((4, 4, 4), ratio=1000.0, jitter=0.2)
        integrator.initialise(0.0, 1e-3)
        found.append(integrator.state.velocity)
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)


def test_the_grid_knows_no_inertia():
    for given in ({"reynolds_number": 1e-3}, {"density": 1.0}, {"integrator": "explicit", "reynolds_number": 1e-3}):
        with pytest.raises(ValidationError, match="the operator `grid` knows no inertia"):
            SolverSection(end_time=1.0, operator="grid", **given)
