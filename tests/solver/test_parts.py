"""Neighbours, packing, transport, contact, time steps and kernel shape, each against a plain reference."""

import numpy as np
import pytest

from ppmc.errors import NumericalError
from ppmc.solver.block_jacobi import restricted_inverse
from ppmc.solver.conjugate_gradient import conjugate_gradient
from ppmc.solver.contact import Contacts, half_widths, starting_half_widths
from ppmc.solver.kernel_shape import convect_shape, full, inverse_shape
from ppmc.solver.neighbours import build_list, cell_order, list_is_stale, weigh_pairs
from ppmc.solver.packing import kernel_behind, packing
from ppmc.solver.reductions import dot
from ppmc.solver.time_step import event_times, fit_to_times, proposed_step
from ppmc.solver.transport import convect_deformation, convect_directions, jeffery_increment

from .blocks import lattice, wendland_weight


def test_neighbours_equal_brute_force_and_are_symmetric():
    x = lattice((6, 5, 4), jitter=0.3)
    x = x[cell_order(x, 2.86)]
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
    order = cell_order(x, 2.86)
    assert sorted(order) == list(range(len(x)))
    counts = weigh_pairs(build_list(x[order], 2.86, 0.1), x[order], 1.3).count
    plain = weigh_pairs(build_list(x, 2.86, 0.1), x, 1.3).count
    np.testing.assert_array_equal(counts, plain[order])


def test_list_goes_stale_when_the_skin_is_used_up():
    x = lattice((4, 4, 4))
    neighbours = build_list(x, 2.86, 0.13)
    moved = x.copy()
    moved[7, 1] += 0.12
    assert not list_is_stale(neighbours, moved)
    moved[7, 1] += 0.02
    assert list_is_stale(neighbours, moved)


def test_a_lost_particle_is_named_as_such():
    x = lattice((4, 4, 4))
    x[0] = 1e9
    with pytest.raises(NumericalError, match="lost"):
        cell_order(x, 2.6)


def test_affine_support_keeps_the_neighbours_of_a_stretched_lattice():
    stretch = np.diag([1.0, 3.0, 1.0 / 3.0])
    start = lattice((7, 7, 7))
    sphere = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (len(start), 1))
    shape = convect_shape(sphere, np.broadcast_to(stretch, (len(start), 3, 3)), 100.0)
    np.testing.assert_allclose(full(shape)[0], stretch @ stretch.T, atol=1e-12)
    metric, longest = inverse_shape(shape)
    assert longest == pytest.approx(3.0)
    x = start @ stretch
    pairs = weigh_pairs(build_list(x, 2.7, 0.05, metric, longest), x, 1.3, metric)
    plain = weigh_pairs(build_list(start, 2.7, 0.05), start, 1.3)
    np.testing.assert_array_equal(pairs.count, plain.count)
    limited = full(convect_shape(sphere, np.broadcast_to(stretch, (len(start), 3, 3)), 4.0))[0]
    axes = np.sqrt(np.linalg.eigvalsh(limited))
    assert axes[2] / axes[0] == pytest.approx(4.0)
    assert np.prod(axes) == pytest.approx(1.0)


def test_packing_is_one_inside_and_against_walls():
    x = lattice((8, 8, 8))
    pairs = weigh_pairs(build_list(x, 2.7, 0.05), x, 1.3)
    wall = np.full((len(x), 1), np.inf)
    wall[:, 0] = np.where(x[:, 2] < 2.6, x[:, 2], np.inf)
    found = packing(pairs, x, np.ones(len(x)), 1.3, wall).reshape(8, 8, 8)
    np.testing.assert_allclose(found[3:5, 3:5, 2:5], 1.0, atol=0.01)
    np.testing.assert_allclose(found[3:5, 3:5, :2], 1.0, atol=0.04)
    assert found[0, 4, 4] < 0.85
    np.testing.assert_allclose(kernel_behind(np.array([0.0, 2.6, 5.0, -2.6, -5.0]), 1.3), [0.5, 0, 0, 1, 1], atol=1e-6)


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


def one_particle(normals, gaps, velocities=None, sticks=None) -> Contacts:
    m = len(normals)
    shape = (1, 3)
    contacts = Contacts(
        tool=np.full(shape, -1, np.int32), normal=np.zeros((1, 3, 3)), half_width=np.zeros(shape),
        gap=np.full(shape, np.inf), wall_velocity=np.zeros((1, 3, 3)), sticks=np.zeros(shape, bool),
        active=np.zeros(shape, bool),
    )  # fmt: skip
    contacts.tool[0, :m] = np.arange(m)
    contacts.normal[0, :m] = normals
    contacts.gap[0, :m] = gaps
    contacts.active[0, :m] = True
    contacts.half_width[0, :m] = 0.5
    if velocities is not None:
        contacts.wall_velocity[0, :m] = velocities
    if sticks is not None:
        contacts.sticks[0, :m] = sticks
    return contacts


def test_constraints_of_oblique_walls_are_all_met():
    rng = np.random.default_rng(2)
    for m in (1, 2, 3):
        normals = rng.normal(size=(m, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        wall, gaps = rng.normal(size=(m, 3)), rng.normal(size=m)
        contacts = one_particle(normals, gaps, wall)
        free, held = contacts.constrain(0.1)
        v = free[0] @ rng.normal(size=3) + held[0]
        np.testing.assert_allclose(normals @ v, np.einsum("ka,ka->k", normals, wall) - gaps / 0.1, atol=1e-9)
        np.testing.assert_allclose(free[0] @ free[0], free[0], atol=1e-12)
        assert np.trace(free[0]) == pytest.approx(3 - m)
        # Reactions add up to the constrained part of a force.
        force = rng.normal(size=3)
        pressing, forces = contacts.reactions(((np.eye(3) - free[0]) @ force)[None])
        np.testing.assert_allclose(forces[0].sum(axis=0), (np.eye(3) - free[0]) @ force, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(forces[0, :m], axis=1), np.abs(pressing[0, :m]))


def test_sticking_walls_hold_all_directions():
    contacts = one_particle([[0.0, 0.0, 1.0]], [0.0], [[1.0, 2.0, 3.0]], [True])
    free, held = contacts.constrain(0.1)
    np.testing.assert_array_equal(free[0], 0.0)
    np.testing.assert_allclose(held[0], [1.0, 2.0, 3.0])


def test_half_widths():
    f = np.diag([2.0, 1.0, 0.5])[None].repeat(3, axis=0)
    np.testing.assert_allclose(half_widths(np.full(3, 0.5), f, np.eye(3)), [0.65, 0.5, 0.25])  # 2.0 is cut at 1.3
    # A scattered layer on the tool keeps its own distances, a layer with clearance does not.
    on = np.array([0.4, 0.5, 0.6, 1.5, 2.4])
    np.testing.assert_allclose(starting_half_widths(on, 1.0), [0.4, 0.5, 0.6, 0.5, 0.5])
    clear = np.array([0.70, 0.71, 0.72, 1.7])
    np.testing.assert_allclose(starting_half_widths(clear, 1.0), 0.5)


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
    blocks = np.eye(3)[None] * 2.0 + 0.3
    free = np.diag([1.0, 1.0, 0.0])[None]
    inverse = restricted_inverse(blocks, free)[0]
    np.testing.assert_allclose(inverse[:2, :2], np.linalg.inv(blocks[0, :2, :2]), atol=1e-12)
    np.testing.assert_allclose(inverse[2], 0.0, atol=1e-15)


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
