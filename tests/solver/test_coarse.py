"""Coarse level of the preconditioner: exactly the Galerkin operator, and worth its while."""

import numpy as np
import pytest

from ppmc.solver.block_jacobi import restricted_inverse
from ppmc.solver.coarse import MODES, _frames, _members, galerkin_operator, make_coarse_level
from ppmc.solver.conjugate_gradient import conjugate_gradient
from ppmc.solver.system import VelocitySystem
from ppmc.solver.tiles import make_tiles

from .blocks import dense_matrix, lattice, make_operator, unit_vectors


def make_system(shape: tuple[int, int, int], ratio: float) -> VelocitySystem:
    """Random fibres, a slip wall below, some inertia and drag."""
    positions = lattice(shape, jitter=0.1)
    n = len(positions)
    operator = make_operator(positions, unit_vectors(n), ratio=ratio)
    free = np.tile(np.eye(3), (n, 1, 1))
    free[positions[:, 2] < 0.8] = np.diag([1.0, 1.0, 0.0])
    drag = np.random.default_rng(0).uniform(size=(n, 1, 1)) * np.eye(3)
    return VelocitySystem(operator, np.full((n, 1), 0.3), drag, free, restricted_inverse(operator.diagonal(), free))


def test_coarse_operator_is_the_galerkin_product():
    system = make_system((5, 4, 4), 100.0)
    positions = system.operator.positions
    n = len(positions)
    tile = make_tiles(positions, 5)
    members, start = _members(tile)
    centre, scale, arm = _frames(positions, tile, members, start)
    found = galerkin_operator(system, tile, members, start, centre, scale)
    modes = np.zeros((n, 3, len(centre) * MODES))
    for i in range(n):
        o = tile[i] * MODES
        modes[i, :, o : o + 3] = system.free[i]
        for c in range(3):
            modes[i, :, o + 3 + 3 * c : o + 6 + 3 * c] = np.outer(system.free[i][:, c], arm[i])
    flat = modes.reshape(3 * n, -1)
    extra = np.zeros((3 * n, 3 * n))
    for i in range(n):
        extra[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = 0.3 * np.eye(3) + system.drag[i]
    expected = flat.T @ (dense_matrix(system.operator) + extra) @ flat
    np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())


def test_tiles_cover_all_particles_evenly():
    positions = lattice((8, 6, 4))
    tile = make_tiles(positions, 10)
    counts = np.bincount(tile)
    assert tile.min() == 0 and len(counts) >= 10
    assert counts.max() <= counts.min() + 1
    assert set(make_tiles(positions[:5], 10)) == {0}


@pytest.mark.parametrize("ratio", [1000.0, 61215.0])
def test_coarse_level_saves_iterations(ratio):
    system = make_system((8, 8, 6), ratio)
    n = len(system.free)
    # Load: squeeze by an internal stress.
    stress = np.tile(np.diag([1.0, 0.5, -1.0]), (n, 1, 1))
    load = system.project(system.operator.stress_force(stress))

    def iterations() -> int:
        return conjugate_gradient(
            system.apply,
            system.project,
            system.precondition,
            load,
            np.zeros((n, 3)),
            tolerance=1e-4,
            max_iterations=2000,
        ).iterations

    plain = iterations()
    original = np.random.default_rng(1).permutation(n)
    level = make_coarse_level(system, make_tiles(system.operator.positions, 16), original)
    system.coarse = level.sorted_as(original)
    # The preconditioner stays symmetric.
    a, b = np.random.default_rng(2).normal(size=(2, n, 3))
    a, b = system.project(a), system.project(b)
    assert np.sum(a * system.precondition(b)) == pytest.approx(np.sum(b * system.precondition(a)), rel=1e-8)
    assert iterations() < 0.6 * plain
