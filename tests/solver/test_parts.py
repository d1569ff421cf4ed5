"""Neighbours, packing, transport, contact, time steps and kernel shape, each against a plain reference."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ppmc.errors import NumericalError
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.tooling import BoxTool, PlaneTool
from ppmc.solver.linear.block_jacobi import restricted_inverse
from ppmc.solver.linear.conjugate_gradient import conjugate_gradient
from ppmc.solver.particles.cells import sort_into_cells
from ppmc.solver.particles.kernel_shape import (
    follow_lattice,
    full,
    inverse_shape,
    kernel_of,
    lattice_of,
    limited,
    rearrangement_rate,
    six,
    swelling,
)
from ppmc.solver.particles.neighbours import build_list, list_is_stale, weigh_pairs
from ppmc.solver.particles.reductions import dot
from ppmc.solver.particles.smoothing import kernel_value
from ppmc.solver.sph.packing import (
    EXPOSED_FALL,
    EXPOSED_PACKING,
    INTERIOR,
    SAMPLED,
    NearWalls,
    Packing,
    inside,
    packing,
)
from ppmc.solver.sph.transport import compose, convect_deformation, convect_directions, jeffery_increment, small_strain
from ppmc.solver.step.time_step import event_times, fit_to_times, proposed_step

from .blocks import lattice, stretched, wendland_weight


def near_walls(x: np.ndarray, tools: dict, reach: float) -> NearWalls:
    """Walls of tools at rest within reach of positions."""
    arrays = compile_tools({str(name): tool for name, tool in tools.items()}).arrays
    return NearWalls.find(arrays, np.zeros((len(tools), 3)), x, reach)


def test_neighbours_equal_brute_force_and_are_symmetric():
    x = lattice((6, 5, 4), jitter=0.3)
    x = x[sort_into_cells(x, 2.86).order]
    pairs = weigh_pairs(build_list(x, 2.86, 0.13), x, 1.3)
    distance = np.linalg.norm(x[:, None] - x[None], axis=2)
    for i in range(len(x)):
        row = slice(pairs.start[i], pairs.start[i] + pairs.count[i])
        near = np.flatnonzero((distance[i] < 2.6) & (distance[i] > 0.0))
        assert set(pairs.index[row]) == set(near)
        np.testing.assert_allclose(pairs.weight[row], wendland_weight(distance[i][pairs.index[row]], 1.3), atol=1e-7)
        for j, w in zip(pairs.index[row], pairs.weight[row], strict=True):
            back = slice(pairs.start[j], pairs.start[j] + pairs.count[j])
            assert pairs.weight[back][pairs.index[back] == i][0] == w


def test_shuffled_particles_give_the_same_sorted_neighbourhoods():
    x = lattice((5, 5, 5), jitter=0.3)
    order = sort_into_cells(x, 2.86).order
    assert sorted(order) == list(range(len(x)))
    counts = weigh_pairs(build_list(x[order], 2.86, 0.1), x[order], 1.3).count
    plain = weigh_pairs(build_list(x, 2.86, 0.1), x, 1.3).count
    np.testing.assert_array_equal(counts, plain[order])


def test_list_goes_stale_when_the_skin_is_used_up():
    x = lattice((5, 5, 5))
    neighbours = build_list(x, 2.86, 0.13)
    for particle in (7, 124):
        moved = x.copy()
        moved[particle, 1] += 0.12
        assert not list_is_stale(neighbours, moved)
        moved[particle, 1] += 0.02
        assert list_is_stale(neighbours, moved)


def test_a_lost_particle_is_named_as_such():
    x = lattice((4, 4, 4))
    x[0] = 1e9
    with pytest.raises(NumericalError, match="lost"):
        sort_into_cells(x, 2.6)


def test_affine_support_keeps_the_neighbours_of_a_stretched_lattice():
    stretch = np.diag([1.0, 3.0, 1.0 / 3.0])
    start = lattice((7, 7, 7))
    sphere = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (len(start), 1))
    none = np.zeros(len(start))
    shape = follow_lattice(sphere, np.broadcast_to(stretch, (len(start), 3, 3)), none, none)
    np.testing.assert_allclose(full(shape)[0], stretch @ stretch.T, atol=1e-12)
    metric, longest = inverse_shape(shape)
    assert longest == pytest.approx(3.0)
    x = start @ stretch
    pairs = weigh_pairs(build_list(x, 2.7, 0.05, metric, longest), x, 1.3, metric)
    plain = weigh_pairs(build_list(start, 2.7, 0.05), start, 1.3)
    np.testing.assert_array_equal(pairs.count, plain.count)
    axes = np.sqrt(np.linalg.eigvalsh(full(limited(shape, 4.0))[0]))
    assert axes[2] / axes[0] == pytest.approx(4.0)
    assert np.prod(axes) == pytest.approx(1.0)


@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.0, 2.0, 0.5), (3.0, 1.0, 1.0 / 3.0)])
def test_packing_is_one_inside_and_against_walls_whatever_the_stretch(stretch):
    x = lattice((9, 9, 9)) * stretch
    shape = np.tile(lattice_of(np.array(stretch)), (len(x), 1))
    metric, longest = inverse_shape(shape)
    pairs = weigh_pairs(build_list(x, 2.7, 0.05, metric, longest), x, 1.3, metric)
    planes = [PlaneTool(shape="plane", point=(0, 0, 0), normal=n) for n in ((0, 0, 1), (1, 0, 0))]
    one, walls = np.ones(len(x)), near_walls(x, dict(enumerate(planes)), 2.6 * longest)
    found = packing(pairs, x, one, metric, 1.3, one, walls).value.reshape(9, 9, 9)
    # Up to the floor, the wall and their common edge; free faces lack the half that lies beyond them.
    np.testing.assert_allclose(found[:5, 4, :5], 1.0, atol=1e-3)
    assert found[4, 4, 8] < 0.85


def test_packing_is_one_around_a_convex_edge_and_in_closed_corners():
    # Material below z = 4 and in a mouth above it, as where a base runs into a flange, up to four walls at once.
    x = lattice((12, 6, 8))
    x = x[(x[:, 2] < 4.0) | (x[:, 0] > 6.0)]
    shape, one = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (len(x), 1)), np.ones(len(x))
    pairs = weigh_pairs(build_list(x, 2.7, 0.05), x, 1.3)
    tools = {
        "cavity": BoxTool(shape="box", center=(6, 3, 4), size=(12, 6, 8), inside=True),
        "core": BoxTool(shape="box", center=(1, 3, 8), size=(10, 20, 8)),
    }
    found = packing(pairs, x, one, shape, 1.3, one, near_walls(x, tools, 2.6)).value
    np.testing.assert_allclose(found, 1.0, atol=0.01)


@pytest.mark.parametrize("stretch", [(3.0, 1.0, 1 / 3), (6.0, 1.0, 1 / 6), (3.0, 3.0, 1 / 9), (5.0, 5**-0.5, 5**-0.5)])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.5, 0.4, 0.9)])
def test_lattices_drawn_out_beyond_the_kernels_limit_are_as_well_packed_as_any(stretch, turn):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    deformation = rotation @ np.diag(stretch) @ rotation.T
    reach = 14
    x = (lattice((2 * reach + 1,) * 3) - reach - 0.5) @ deformation.T
    kernel = kernel_of(np.tile(six((deformation @ deformation.T)[None]), (len(x), 1)), 4.0)
    metric, _ = inverse_shape(kernel[:1])
    near = np.einsum("na,ab,nb->n", x, full(metric)[0], x) < 2.6**2
    middle = int(np.flatnonzero((np.abs(x[near]) < 1e-9).all(axis=1))[0])
    assert not near.reshape((2 * reach + 1,) * 3)[[0, -1]].any()
    x = np.ascontiguousarray(x[near])
    metrics = np.tile(metric, (len(x), 1))
    pairs = weigh_pairs(build_list(x, 2.7, 0.05, metrics, 20.0), x, 1.3, metrics)
    far = near_walls(x, {"far": PlaneTool(shape="plane", point=(0, 0, -99), normal=(0, 0, 1))}, 2.6)
    found = packing(pairs, x, np.ones(len(x)), metrics, 1.3, np.ones(len(x)), far)
    assert found.value[middle] == pytest.approx(1.0, abs=6e-3)


@pytest.mark.parametrize("stretch", [1.0, 3.2, 3.5, 4.0, 10.0])
def test_free_surfaces_are_told_from_the_inside_whatever_the_stretch(stretch):
    # Between plates, free on four sides: the outermost row is exposed, the others are not.
    spacing = np.array([stretch, 1.0, 1.0 / stretch])
    x = lattice((9, 9, 8)) * spacing
    lattices = np.tile(lattice_of(spacing), (len(x), 1))
    kernels = kernel_of(lattices, 4.0)
    metric, longest = inverse_shape(kernels)
    pairs = weigh_pairs(build_list(x, 2.7, 0.05, metric, longest), x, 1.3, metric)
    plates = {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1)),
        "upper": PlaneTool(shape="plane", point=(0, 0, 8.0 / stretch), normal=(0, 0, -1)),
    }
    one = np.ones(len(x))
    found = packing(pairs, x, one, metric, 1.3, one, near_walls(x, plates, 2.6 * longest))
    found.swollen = swelling(kernels, lattices)
    within = inside(pairs, found, 1.3).reshape(9, 9, 8)
    assert within[1:-1, 1:-1].all()
    assert not within[[0, -1]].any()
    assert not within[:, [0, -1]].any()


SPHERE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def packing_at(x: np.ndarray, shape: np.ndarray, volumes: np.ndarray | None = None) -> Packing:
    """Packing without walls; h = 1.3."""
    n = len(x)
    shapes = np.tile(shape, (n, 1))
    metric, longest = inverse_shape(shapes)
    pairs = weigh_pairs(build_list(x, 2.7, 0.05, metric, longest), x, 1.3, metric)
    far = near_walls(x, {"far": PlaneTool(shape="plane", point=(0, 0, -99), normal=(0, 0, 1))}, 2.6)
    return packing(pairs, x, np.ones(n) if volumes is None else volumes, metric, 1.3, np.ones(n), far)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.5), (0.4, -0.7, 0.2)])
def test_packing_and_its_fall_are_the_same_however_a_charge_is_turned(turn):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    x, shape = lattice((6, 5, 4), 0.3), full(stretched(1, 3.0, seed=4))
    here = packing_at(x, six(shape)[0])
    there = packing_at(x @ rotation.T, six(rotation @ shape @ rotation.T)[0])
    np.testing.assert_allclose(there.value, here.value, rtol=1e-12)
    np.testing.assert_allclose(there.fall, here.fall, rtol=1e-10)


def test_packing_is_the_mean_of_the_kernel_over_a_sphere_and_its_fall_the_slope_there():
    # Two particles, one of them without volume: what the other gives at a thousand points, but for its fading.
    rng, apart = np.random.default_rng(0), np.array([0.7, -0.9, 0.4])
    points = rng.normal(size=(500, 3))
    points = np.concatenate([points, -points])
    points *= SAMPLED / np.linalg.norm(points, axis=1, keepdims=True)
    # Points spread at random, weighted so that constants and linear fields are exact, and quadratic ones nearly.
    kernel = [kernel_value(float(d @ d), 1.3) for d in points - apart]
    lone = packing_at(np.zeros((1, 3)), SPHERE).value[0]
    both = packing_at(np.array([[0.0, 0.0, 0.0], apart]), SPHERE, np.array([0.0, 1.0]))
    fading = 1.0 - (apart @ apart / 2.6**2) ** 4
    at_centre = kernel_value(SAMPLED**2, 1.3) / lone  # the sum over a lattice
    assert both.value[0] == pytest.approx(fading * np.mean(kernel) / at_centre, rel=0.02)
    slope = np.linalg.norm(np.mean(np.array(kernel)[:, None] * points, axis=0)) / SAMPLED
    assert both.fall[0] == pytest.approx(1.5 / SAMPLED * slope / np.mean(kernel), rel=0.05)


@pytest.mark.parametrize(
    ("normal", "first", "second"),
    [((1, 0, 0), (0.727, 0.281), (0.977, 0.027)), ((1, 1, 1), (0.630, 0.360), (0.848, 0.155))],
)
def test_packing_of_a_lattice_at_a_plane_surface(normal, first, second):
    # The values that the thresholds were laid between: rows across an axis and across a body diagonal.
    x = lattice((15, 15, 15)) - 7.5
    out = np.rint(x @ normal).astype(int)  # numbers of the rows
    found = packing_at(x[out <= 0], SPHERE)
    x, out = x[out <= 0], out[out <= 0]
    for row, (value, fall) in ((0, first), (-1, second)):
        middle = np.flatnonzero(out == row)[np.argmin(np.linalg.norm(x[out == row], axis=1))]
        assert found.value[middle] == pytest.approx(value, abs=0.002)
        assert found.fall[middle] == pytest.approx(fall, abs=0.002)
        exposed = found.value[middle] < EXPOSED_PACKING and found.fall[middle] > EXPOSED_FALL
        assert exposed == (row == 0)
        assert (found.value[middle] > INTERIOR) <= (row < 0)


@pytest.mark.parametrize("axes", [(2,), (0, 2), (0, 1, 2)])
def test_packing_is_one_over_space_where_particles_stand_in_twins(axes):
    # Rows at distances of 0.6 and 1.4 in turn: summed near the particles, they would read up to a tenth too dense.
    x = lattice((12, 12, 12))
    for axis in axes:
        x[:, axis] += np.where(x[:, axis] % 2.0 < 1.0, 0.2, -0.2)
    shape, one = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (len(x), 1)), np.ones(len(x))
    pairs = weigh_pairs(build_list(x, 2.7, 0.05), x, 1.3)
    tools = {"cavity": BoxTool(shape="box", center=(6, 6, 6), size=(12, 12, 12), inside=True)}
    found = packing(pairs, x, one, shape, 1.3, one, near_walls(x, tools, 2.6)).value.reshape(12, 12, 12)
    assert found[4:8, 4:8, 4:8].mean() == pytest.approx(1.0, abs=0.005)


def test_packing_sees_crowding_whatever_the_disorder():
    # Summed at the particles alone, disorder would count as crowding, up to 1.19: each sees itself.
    rng = np.random.default_rng(0)
    shape, inside = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (1728, 1)), np.s_[3:9, 3:9, 3:9]
    for squeeze in (1.0, 0.95):
        x = (lattice((12, 12, 12)) + rng.uniform(-0.3, 0.3, (1728, 3))) * squeeze
        pairs = weigh_pairs(build_list(x, 2.7, 0.05), x, 1.3)
        far = near_walls(x, {"far": PlaneTool(shape="plane", point=(0, 0, -9), normal=(0, 0, 1))}, 2.6)
        one = np.ones(len(x))
        found = packing(pairs, x, one, shape, 1.3, one, far).value
        assert found.reshape(12, 12, 12)[inside].mean() == pytest.approx(squeeze**-3, abs=0.03)


def test_loose_pockets_are_inside_and_free_surfaces_are_not():
    # Lattice in a mould that is open at the top, scattered by a tenth; every second particle of a pocket has lost 30 %.
    rng = np.random.default_rng(0)
    x = lattice((14, 14, 14)) + rng.uniform(-0.1, 0.1, (2744, 3))
    layer = lattice((14, 14, 14))[:, 2]
    volumes, shape = np.ones(len(x)), np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (len(x), 1))
    pocket = np.abs(lattice((14, 14, 14)) - 6.0).max(axis=1) < 2.0
    volumes[np.flatnonzero(pocket)[::2]] = 0.7
    pairs = weigh_pairs(build_list(x, 2.7, 0.05), x, 1.3)
    mould = {"mould": BoxTool(shape="box", center=(7, 7, 17), size=(14, 14, 34), inside=True)}
    found = packing(pairs, x, volumes, shape, 1.3, np.ones(len(x)), near_walls(x, mould, 2.6))
    core = np.abs(lattice((14, 14, 14)) - 6.0).max(axis=1) < 1.0
    assert found.value[core].max() < 0.93
    within = inside(pairs, found, 1.3)
    assert within[layer < 12.0].all()
    assert not within[layer > 13.0].any()


def test_lattices_keep_their_shape_in_homogeneous_flow_and_lose_it_where_neighbours_part():
    x = lattice((6, 6, 6))
    pairs = weigh_pairs(build_list(x, 2.7, 0.05), x, 1.3)
    gradient = np.tile(np.diag([0.5, 0.5, -1.0]), (len(x), 1, 1))
    affine = x @ gradient[0].T
    loose = rearrangement_rate(pairs, x, np.ones(len(x)), affine, gradient)
    np.testing.assert_allclose(loose, 0.0, atol=1e-12)
    restless = affine + np.random.default_rng(0).normal(size=x.shape)
    assert rearrangement_rate(pairs, x, np.ones(len(x)), restless, gradient).min() > 0.5
    shape, increment = np.tile(lattice_of(np.array([2.0, 1.0, 0.5])), (len(x), 1)), np.eye(3) + 0.01 * gradient
    strain = np.full(len(x), 0.012)
    kept = follow_lattice(shape, increment, loose, strain)
    exact = increment[0] @ full(shape)[0] @ increment[0].T
    np.testing.assert_allclose(full(kept)[0], exact / np.cbrt(np.linalg.det(exact)), atol=1e-12)
    squared_axes = np.linalg.eigvalsh(full(follow_lattice(shape, increment, 100.0 * strain, strain))[0])
    assert squared_axes[2] / squared_axes[0] < 1.1**2


def test_deformation_and_directions_convect():
    rng = np.random.default_rng(0)
    f, a = rng.normal(size=(20, 3, 3)), np.eye(3) + 0.1 * rng.normal(size=(20, 3, 3))
    j, p = np.linalg.det(f), rng.normal(size=(20, 3))
    new_f, new_j, new_p = f.copy(), j.copy(), p.copy()
    convect_deformation(a, new_f, new_j)
    convect_directions(a, new_p)
    np.testing.assert_allclose(new_f, a @ f, atol=1e-14)
    np.testing.assert_allclose(new_j, np.linalg.det(a @ f), atol=1e-13)
    moved = np.einsum("nab,nb->na", a, p)
    np.testing.assert_allclose(new_p, moved / np.linalg.norm(moved, axis=1, keepdims=True), atol=1e-14)


def test_jeffery_increment_is_affine_for_long_fibres():
    from scipy.linalg import expm

    gradient = np.random.default_rng(1).normal(size=(3, 3))
    np.testing.assert_allclose(jeffery_increment(gradient[None], 0.3, 1.0)[0], expm(0.3 * gradient), atol=1e-13)


def test_conjugate_gradient_meets_its_tolerance():
    rng = np.random.default_rng(3)
    basis, _ = np.linalg.qr(rng.normal(size=(90, 90)))
    matrix = basis @ np.diag(np.geomspace(1.0, 1e4, 90)) @ basis.T
    exact = rng.normal(size=(30, 3))
    right = (matrix @ exact.ravel()).reshape(-1, 3)
    solution = conjugate_gradient(
        lambda v: (matrix @ v.ravel()).reshape(-1, 3), np.copy, np.copy, right, np.zeros((30, 3)),
        tolerance=1e-3, max_iterations=500,
    )  # fmt: skip
    true = np.linalg.norm(solution.velocities - exact) / np.linalg.norm(exact)
    assert solution.converged and true < 3e-3
    np.testing.assert_allclose(
        solution.residual, right - (matrix @ solution.velocities.ravel()).reshape(-1, 3), atol=1e-6
    )


def test_block_inverse_on_the_free_directions():
    blocks = np.array([[2.3, 2.4, 2.5, 0.3, 0.4, 0.5], [2e5, 2.4, 2.5, 300.0, 0.4, 200.0]])
    drag, free = np.diag([0.0, 0.1, 0.2])[None], np.diag([1.0, 1.0, 0.0])[None]
    inverse = full(restricted_inverse(blocks, np.array([0]), drag, free))
    exact = np.pad(np.linalg.inv(full(blocks)[0, :2, :2] + drag[0, :2, :2]), (0, 1)), np.linalg.inv(full(blocks)[1])
    for found, wanted in zip(inverse, exact, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_limited_shapes_against_numpy():
    rng = np.random.default_rng(6)
    axes = np.linalg.qr(rng.normal(size=(200, 3, 3)))[0]
    values = np.exp(rng.normal(scale=2.0, size=(200, 3)))
    values[:50, 1] = values[:50, 0]  # two axes alike
    values[:20, 2] = values[:20, 0] * (1.0 + 1e-9)
    values /= np.cbrt(np.prod(values, axis=1))[:, None]
    shape = np.einsum("nab,nb,ncb->nac", axes, values, axes)
    fade = rng.uniform(size=200)
    found = full(limited(six(shape), 4.0, fade))
    exact = np.maximum(values, values.max(axis=1, keepdims=True) / 16.0) ** (1.0 - fade)[:, None]
    exact /= np.cbrt(np.prod(exact, axis=1))[:, None]
    np.testing.assert_allclose(found, np.einsum("nab,nb,ncb->nac", axes, exact, axes), atol=1e-12 * exact.max())
    increment = np.eye(3) + 0.1 * rng.normal(size=(200, 3, 3))
    carried = full(follow_lattice(six(shape), increment, np.zeros(200), np.ones(200)))
    exact = increment @ shape @ np.swapaxes(increment, 1, 2)
    exact /= np.cbrt(np.linalg.det(exact))[:, None, None]
    within = np.linalg.cond(exact) < 2000.0
    np.testing.assert_allclose(carried[within], exact[within], atol=1e-11 * abs(exact[within]).max())


def test_dot_is_the_inner_product():
    a, b = np.random.default_rng(4).normal(size=(2, 3000, 3))
    assert dot(a, b) == pytest.approx(np.sum(a * b), rel=1e-12)


def test_steps_hit_the_output_times():
    assert event_times(1.0, 0.3, (0.5, 0.3)) == pytest.approx([0.3, 0.5, 0.6, 0.9, 1.0])
    assert fit_to_times(0.0, 0.03, 0.1) == pytest.approx(0.025)
    assert fit_to_times(0.0, 5.0, 0.1) == pytest.approx(0.1)
    gradient = np.tile(np.diag([0.5, 0.5, -1.0]), (10, 1, 1))
    assert proposed_step(gradient, 0.02, 1.0, 1.0, np.inf) == pytest.approx(0.02 / np.sqrt(1.5))
    assert proposed_step(gradient, 0.02, 1.0, 1.0, 0.004) == pytest.approx(0.006)
    assert proposed_step(gradient, 0.02, 1.0, 0.001, np.inf) == 0.001


def test_increments_put_one_upon_the_other_and_their_strain():
    rng = np.random.default_rng(7)
    first, then = np.eye(3) + 0.1 * rng.normal(size=(2, 20, 3, 3))
    passed = first.copy()
    compose(then, passed)
    np.testing.assert_allclose(passed, then @ first, atol=1e-14)
    strain = 0.5 * (first + np.swapaxes(first, 1, 2)) - np.eye(3)
    np.testing.assert_allclose(small_strain(first), np.linalg.norm(strain, axis=(1, 2)), atol=1e-14)
