"""Coarse grid, its factorisation and the vectorised sweeps, against plain NumPy and against the general sweeps."""

import numba
import numpy as np
import pytest

from ppmc.errors import NumericalError
from ppmc.solver.linear.block_jacobi import multiply_rows, multiply_symmetric, restricted_inverse
from ppmc.solver.linear.coarse_grid import FREE_VALUES, MOST_VALUES, SHIFT, USUAL_CANDIDATES, CoarseGrid, make_grid
from ppmc.solver.linear.conjugate_gradient import conjugate_gradient
from ppmc.solver.linear.rigid_modes import Pieces, free_rigid_modes
from ppmc.solver.linear.skyline import factorise
from ppmc.solver.linear.system import VelocitySystem
from ppmc.solver.sph.operator import Operator

from .blocks import dense_matrix, lattice, make_operator, unit_vectors


def hold_floor(positions: np.ndarray) -> np.ndarray:
    """Projections that hold the lowest layer along x3, its edge altogether."""
    free = np.tile(np.eye(3), (len(positions), 1, 1))
    free[positions[:, 2] < 1.0, 2, 2] = 0.0
    free[(positions[:, 2] < 1.0) & (positions[:, 0] < 1.0)] = 0.0
    return free


def stiff_grid(operator: Operator, free: np.ndarray, cell: float = 3.0) -> tuple[CoarseGrid, np.ndarray]:
    grid = make_grid(operator.positions, cell)
    own = operator.diagonal()[:, :3].mean(axis=1)
    point = own[:, None, None] * (np.eye(3) - free)
    rows = held_rows(free)
    grid.stiffen(operator, np.zeros(len(free)), rows, point[rows])
    return grid, point


def held_rows(free: np.ndarray) -> np.ndarray:
    return np.flatnonzero(np.trace(free, axis1=1, axis2=2) < 3.0)


def pieces_of(operator: Operator) -> Pieces:
    return Pieces.of(operator.pairs, operator.positions, operator.volumes)


def correction(grid: CoarseGrid, residual: np.ndarray) -> np.ndarray:
    out = np.zeros_like(residual)
    grid.add_correction(residual, out)
    return out


def make_system(operator: Operator, free: np.ndarray, grid: CoarseGrid | None = None) -> VelocitySystem:
    """System without inertia or drag."""
    rows, none = held_rows(free), np.zeros(len(free))
    drag, free = np.zeros((len(rows), 3, 3)), free[rows]
    blocks = operator.diagonal()
    return VelocitySystem(
        operator, none, rows, drag, free, restricted_inverse(blocks, rows, drag, free), grid,
        free_rigid_modes(pieces_of(operator), 0.0, rows, free, drag, float(blocks[:, :3].mean())),
    )  # fmt: skip


def shape_functions(grid: CoarseGrid) -> np.ndarray:
    """Values (n, nodes) of the grid's trilinear functions at the particles."""
    n = len(grid.local)
    values = np.zeros((n, len(grid.corners)))
    cell = np.empty(n, dtype=int)
    cell[grid.order] = np.repeat(np.arange(len(grid.nodes)), np.diff(grid.start))
    for corner in range(8):
        bits = np.array([corner >> 2 & 1, corner >> 1 & 1, corner & 1])
        weight = np.where(bits, grid.local, 1.0 - grid.local)
        values[np.arange(n), grid.nodes[cell, corner]] += weight.prod(axis=1)
    return values


def grid_stiffness(grid: CoarseGrid) -> np.ndarray:
    """Stiffness of the grid, dense, put together from its factor, less the shift of the diagonal."""
    factor = grid.factor
    assert factor is not None
    lower = np.zeros((len(factor.first), len(factor.first)))
    for row, first in enumerate(factor.first):
        lower[row, first : row + 1] = factor.values[factor.offset[row] : factor.offset[row + 1]]
    matrix = lower @ lower.T
    diagonal = np.diag(matrix) / (1.0 + SHIFT)
    np.fill_diagonal(matrix, diagonal - 1e-14 / (1.0 + SHIFT) * diagonal.max())
    return matrix


def as_matrix(apply, n: int) -> np.ndarray:
    return np.stack([apply(unit.reshape(n, 3)).ravel() for unit in np.eye(3 * n)], axis=1)


def test_skyline_solution_against_numpy():
    rng = np.random.default_rng(0)
    n = 40
    first = np.maximum(0, np.arange(n) - rng.integers(0, 12, n))
    offset = np.append(0, np.cumsum(np.arange(n) - first + 1))
    factor = np.zeros((n, n))
    for i in range(n):
        factor[i, first[i] : i + 1] = rng.normal(size=i - first[i] + 1)
        factor[i, i] = 5.0 + abs(factor[i, i])
    matrix = factor @ factor.T
    values = np.concatenate([matrix[i, first[i] : i + 1] for i in range(n)])
    load = rng.normal(size=n)
    found = factorise(first, offset, values, 0.0).solve(load)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, load), rtol=1e-9, atol=1e-12)


def test_motions_without_stiffness_do_not_spoil_the_factor():
    values = np.array([1.0, -1.0, 1.0])  # two nodes joined by one spring, free to move together
    solution = factorise(np.array([0, 0]), np.array([0, 1, 3]), values, 1e-9).solve(np.array([1.0, -1.0]))
    assert np.all(np.isfinite(solution))
    assert solution[0] - solution[1] == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_grid_is_as_stiff_as_the_operator_on_its_motions(count):
    positions = lattice((7, 5, 7), 0.2)
    directions = np.concatenate([unit_vectors(len(positions), seed) for seed in range(2)], axis=1)[:, :count]
    operator = make_operator(positions, directions, ratio=1e4)
    # The grid knows the mean of a particle's control only: it is that of every pair if it has no direction.
    operator.control[:, 1:] = 0.0
    grid, point = stiff_grid(operator, hold_floor(positions), 4.5)  # cells wider than the kernels: no pair is left out
    shapes = np.kron(shape_functions(grid), np.eye(3))
    exact = shapes.T @ (dense_matrix(operator) @ shapes)
    held = shapes.reshape(len(positions), 3, -1)
    exact += np.einsum("iam,iab,ibk->mk", held, point, held)
    np.testing.assert_allclose(grid_stiffness(grid), exact, atol=1e-11 * abs(exact).max())


def test_grid_solves_its_own_problem_exactly():
    positions = lattice((6, 5, 4), 0.2)
    grid, _ = stiff_grid(make_operator(positions, unit_vectors(len(positions))), hold_floor(positions))
    shapes, stiffness = np.kron(shape_functions(grid), np.eye(3)), grid_stiffness(grid)
    exact = shapes @ np.linalg.solve(stiffness, shapes.T)
    found = as_matrix(lambda r: correction(grid, r), len(positions))
    np.testing.assert_allclose(found, exact, atol=1e-6 * abs(exact).max())
    # A load that a motion of the grid causes gives that motion back.
    motion = np.random.default_rng(3).normal(size=shapes.shape[1])
    load = np.linalg.lstsq(shapes.T, stiffness @ motion, rcond=None)[0].reshape(-1, 3)
    np.testing.assert_allclose(correction(grid, load).ravel(), shapes @ motion, atol=1e-6)


def test_affine_motions_cost_the_grid_what_they_cost_the_operator():
    positions = lattice((6, 5, 4), 0.2)
    operator = make_operator(positions, unit_vectors(len(positions)), ratio=6e4)
    grid, _ = stiff_grid(operator, np.tile(np.eye(3), (len(positions), 1, 1)))
    nodes = np.linalg.lstsq(shape_functions(grid), positions, rcond=None)[0]  # the grid's own places
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    coarse = (nodes @ gradient.T).ravel()
    fine = positions @ gradient.T
    assert coarse @ grid_stiffness(grid) @ coarse == pytest.approx(np.sum(fine * operator.apply(fine)), rel=1e-10)


def test_preconditioner_is_symmetric_and_positive_definite():
    positions = lattice((5, 4, 4), 0.2)
    n = len(positions)
    operator = make_operator(positions, unit_vectors(n), ratio=1e4)
    free = hold_floor(positions)
    system = make_system(operator, free, stiff_grid(operator, free)[0])
    matrix = as_matrix(lambda r: system.precondition(system.project(r)), n)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-10 * abs(matrix).max())
    values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    held = 3 * n - round(np.trace(free, axis1=1, axis2=2).sum())
    assert np.sum(values < 1e-12 * values.max()) == held
    assert values.min() > -1e-12 * values.max()


def test_grid_is_equal_to_the_bit_for_any_thread_count():
    positions = lattice((9, 8, 6), 0.2)
    operator = make_operator(positions, unit_vectors(len(positions)))
    load = np.random.default_rng(5).normal(size=positions.shape)
    results = []
    before = numba.get_num_threads()
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        free = hold_floor(positions)
        grid, _ = stiff_grid(operator, free)
        system = make_system(operator, free, grid)
        results.append((system.precondition(system.project(load)), system.apply(load)))
    numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0][0], results[1][0])
    np.testing.assert_array_equal(results[0][1], results[1][1])


def test_grid_saves_most_iterations():
    positions = lattice((14, 10, 4), 0.1)
    n = len(positions)
    # Platelets of 7 x 5 particles in each layer, turned at random.
    tile = np.ravel_multi_index((positions // (7, 5, 1)).astype(int).T, (3, 3, 5))
    angle = np.random.default_rng(2).uniform(0.0, np.pi, tile.max() + 1)[tile]
    directions = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)[:, None]
    operator = make_operator(positions, directions, ratio=1e4, bulk=6e4)
    free, start = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    plates = (positions[:, 2] < 1.0) | (positions[:, 2] > 3.0)
    free[plates, 2, 2] = 0.0
    start[positions[:, 2] > 3.0, 2] = -1.0
    # Between slip plates the block may slide and turn as it likes; the system keeps these motions out, or their
    # round-off would decide the number of iterations.
    system = make_system(operator, free, stiff_grid(operator, free, 3.0)[0])
    assert system.rigid is not None and system.rigid.count == 3

    def solve(precondition, tolerance: float) -> tuple[np.ndarray, int]:
        solution = conjugate_gradient(
            operator.apply, system.project, precondition, np.zeros((n, 3)), start,
            tolerance=tolerance, max_iterations=2000,
        )  # fmt: skip
        return solution.velocities, solution.iterations

    plain, many = solve(lambda r: multiply_rows(system.rows, system.free, multiply_symmetric(system.inverse, r)), 1e-6)
    quick, few = solve(system.precondition, 1e-6)
    np.testing.assert_allclose(system.rigid.remove(quick - plain), 0.0, atol=1e-3)
    assert few < 0.35 * many


@pytest.mark.parametrize(("held", "count"), [((), 6), ((2,), 3), ((0, 2), 1), ((0, 1, 2), 0)])
def test_free_rigid_modes_between_slip_plates(held, count):
    positions = lattice((5, 4, 3), 0.2)
    n = len(positions)
    free, hold = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3, 3))
    for axis in held:
        at = positions[:, axis]
        free[(at < 1.0) | (at > at.max() - 1.0), axis, axis] = 0.0
    everyone, operator = np.arange(n), make_operator(positions, unit_vectors(n))
    pieces = pieces_of(operator)
    modes = free_rigid_modes(pieces, 0.0, everyone, free, hold, 1.0)
    projection = np.eye(3 * n) - as_matrix(lambda v: modes.remove(v.copy()), n)
    np.testing.assert_allclose(projection, projection.T, atol=1e-12)
    np.testing.assert_allclose(projection @ projection, projection, atol=1e-9)
    assert np.trace(projection) == pytest.approx(count, abs=1e-9)
    # Each is rigid, and no tool is in its way.
    motions = projection.reshape(n, 3, 3 * n)
    np.testing.assert_allclose((np.eye(3) - free) @ motions, 0.0, atol=1e-5)
    stiffness = np.abs(operator.diagonal()).max()
    for k in range(0, 3 * n, 7):
        assert np.abs(operator.apply(np.ascontiguousarray(motions[..., k]))).max() < 1e-9 * stiffness
    assert free_rigid_modes(pieces, 0.0, everyone, free, hold + np.eye(3), 1.0).count == 0
    assert free_rigid_modes(pieces, 1.0, everyone, free, hold, 1.0).count == 0


@pytest.mark.parametrize(
    ("shape", "cell", "widened"),
    [((20, 20, 9), 3.0, ()), ((60, 28, 60), 3.0, (0, 2)), ((70, 60, 50), 2.0, (0, 1, 2))],
)
def test_cells_widen_along_the_longer_extents_until_the_factor_is_small(shape, cell, widened):
    positions = lattice(shape)
    grid = make_grid(positions, cell)
    assert grid.offset[-1] <= max(FREE_VALUES, MOST_VALUES * len(positions))
    assert tuple(np.flatnonzero(grid.size > 1.2 * cell)) == widened
    # Not by more than needed, and the factor has the size that was foreseen.
    assert not widened or grid.offset[-1] > 0.8 * MOST_VALUES * len(positions)
    cells = np.prod([round(np.ptp(positions[:, k]) / grid.size[k]) for k in range(3)])
    assert len(grid.nodes) == cells


def test_sheets_whose_lists_are_short_have_narrower_cells():
    positions = lattice((110, 110, 3))
    n = len(positions)
    bulk, sheet = (make_grid(positions, 3.0, candidates * n) for candidates in (USUAL_CANDIDATES, 40))
    assert bulk.offset[-1] <= MOST_VALUES * n < sheet.offset[-1] <= (MOST_VALUES + USUAL_CANDIDATES - 40) * n
    assert sheet.size.max() < 0.9 * bulk.size.max()
    np.testing.assert_array_equal(bulk.size, make_grid(positions, 3.0).size)


def test_grid_refuses_lost_particles():
    positions = lattice((3, 3, 3))
    positions[4] = np.nan
    with pytest.raises(NumericalError, match="lost"):
        make_grid(positions, 3.0)


@pytest.mark.parametrize("count", [0, 1])
def test_vectorised_sweeps_against_the_general_ones(count):
    positions = lattice((6, 5, 5), 0.25)
    n = len(positions)
    single = make_operator(positions, unit_vectors(n)[:, :count], ratio=1e4)
    general = make_operator(positions, np.concatenate([unit_vectors(n), unit_vectors(n, 7)], axis=1), ratio=1e4)
    general.fibre[:, 0], general.control[:, 2] = 0.0, 0.0
    if count:
        general.fibre[:, 0], general.control[:, 2] = single.fibre[:, 0], single.control[:, 2]
    general.fibre[:, 1], general.control[:, 3] = 0.0, 0.0
    general.control[:, 1] = single.control[:, 1]
    velocities = np.random.default_rng(4).normal(size=(n, 3))
    expected = general.apply(velocities)
    np.testing.assert_allclose(single.apply(velocities), expected, atol=1e-12 * abs(expected).max())
