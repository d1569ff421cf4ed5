"""Neighbour lists and pair weights against brute force, on charges of awkward shapes."""

import numba
import numpy as np
import pytest
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from ppmc.solver.particles.cells import sort_into_cells
from ppmc.solver.particles.kernel_shape import full, inverse_shape
from ppmc.solver.particles.neighbours import NeighbourList, Pairs, build_list, weigh_pairs
from ppmc.solver.particles.smoothing import SUPPORT
from ppmc.solver.step.implicit import SKIN, ImplicitIntegrator

from .blocks import lattice, stretched, wendland_weight
from .scenes import make_squeeze

CUTOFF, H = 2.86, 1.3


def random_cloud(n: int, size: tuple[float, float, float], seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 1.0, (n, 3)) * np.array(size) - 3.0


CLOUDS = {
    "random box": random_cloud(700, (9.0, 7.0, 11.0)),
    "thin layer": random_cloud(300, (30.0, 25.0, 0.0)),
    "line": random_cloud(60, (0.0, 50.0, 0.0)),
    "two": np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0]]),
    "single": np.array([[3.0, -2.0, 1.0]]),
    "all apart": lattice((4, 4, 4)) * 10.0,
    "far outlier": np.vstack([random_cloud(200, (6.0, 6.0, 6.0)), [[400.0, -300.0, 5.0]]]),
    "crowded": random_cloud(400, (1.5, 1.5, 1.5)),
    "duplicates": np.repeat(random_cloud(150, (6.0, 6.0, 6.0)), 2, axis=0),
    "lattice on the cells' edges": lattice((9, 6, 5)) * CUTOFF / 2.0,
    "far from the origin": random_cloud(300, (6.0, 6.0, 6.0)) + 1e5,
}


def row(holder: NeighbourList | Pairs, i: int) -> slice:
    end = holder.start[i] + holder.count[i] if isinstance(holder, Pairs) else holder.start[i + 1]
    return slice(holder.start[i], end)


@pytest.mark.parametrize("ordered", [True, False])
@pytest.mark.parametrize("name", CLOUDS)
def test_rows_equal_brute_force(name, ordered):
    x = CLOUDS[name]
    x = x[sort_into_cells(x, CUTOFF).order] if ordered else np.random.default_rng(3).permutation(x)
    neighbours = build_list(x, CUTOFF, 0.13)
    pairs = weigh_pairs(neighbours, x, H)
    distance = np.linalg.norm(x[:, None] - x[None], axis=2)
    for i in range(len(x)):
        listed = neighbours.index[row(neighbours, i)]
        others = np.delete(np.arange(len(x)), i)
        # A pair that lies at the cutoff to the last bit may be listed or not.
        certain = others[distance[i, others] < CUTOFF * (1.0 - 1e-12)]
        possible = others[distance[i, others] < CUTOFF * (1.0 + 1e-12)]
        assert len(set(listed)) == len(listed)
        assert set(certain) <= set(listed) <= set(possible)
        weighed = pairs.index[row(pairs, i)]
        near = others[(distance[i, others] > 0.0) & (distance[i, others] < 2.0 * H)]
        assert sorted(weighed) == sorted(near)
        np.testing.assert_allclose(pairs.weight[row(pairs, i)], wendland_weight(distance[i, weighed], H), atol=1e-7)


def as_matrix(pairs: Pairs) -> np.ndarray:
    n = len(pairs.count)
    matrix = np.zeros((n, n))
    for i in range(n):
        matrix[i, pairs.index[row(pairs, i)]] = pairs.weight[row(pairs, i)]
    return matrix


@pytest.mark.parametrize("name", ["random box", "thin layer", "duplicates", "far from the origin"])
def test_weights_are_symmetric_to_the_last_bit(name):
    x = CLOUDS[name]
    matrix = as_matrix(weigh_pairs(build_list(x, CUTOFF, 0.13), x, H))
    np.testing.assert_array_equal(matrix, matrix.T)


@pytest.mark.parametrize("longest", [0, 1, 2])
def test_rows_in_a_metric_equal_brute_force(longest):
    # Extents differ, so that the cells count the axes in another order than the tensors do.
    size = np.roll([14.0, 9.0, 6.0], longest)
    x = random_cloud(500, tuple(size))
    metric, reach = inverse_shape(stretched(500, 4.0, 5))
    neighbours = build_list(x, CUTOFF, 0.13, metric, reach)
    pairs = weigh_pairs(neighbours, x, H, metric)
    matrix = as_matrix(pairs)
    d = x[None] - x[:, None]
    squared = np.einsum("ija,iab,ijb->ij", d, full(metric), d)
    np.fill_diagonal(squared, np.inf)
    for i in range(len(x)):
        assert sorted(neighbours.index[row(neighbours, i)]) == sorted(np.flatnonzero(squared[i] < CUTOFF**2))
    expected = np.where(squared < (2.0 * H) ** 2, wendland_weight(np.sqrt(squared), H), 0.0)
    np.testing.assert_allclose(matrix, expected, atol=1e-7)


@pytest.mark.parametrize("aspect", [None, 1.04, 10.0])
@pytest.mark.parametrize("closeness", [1e-5, 1e-7, 1e-9, 1e-11])
def test_pairs_next_to_the_cutoff_are_told_in_double_precision(aspect, closeness):
    # Sites far apart, a few particles a site: the first sees every other one at the cutoff, give or take `closeness`.
    rng = np.random.default_rng(11)
    sites, others = 60, 20
    shape = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (sites * (others + 1), 1))
    if aspect is not None:
        shape = stretched(len(shape), aspect, 12)
    inverse, reach = inverse_shape(shape)
    metric = full(inverse).reshape(sites, others + 1, 3, 3)
    away = rng.normal(size=(sites, others, 3))
    away *= (CUTOFF / np.sqrt(np.einsum("sma,sab,smb->sm", away, metric[:, 0], away)))[..., None]
    within = rng.uniform(size=(sites, others)) < 0.5
    away *= np.where(within, 1.0 - closeness, 1.0 + closeness)[..., None]
    centre = 60.0 * np.stack(np.unravel_index(np.arange(sites), (5, 4, 3)), axis=1) + rng.uniform(0.0, 9.0, (sites, 3))
    x = np.concatenate([centre[:, None], centre[:, None] + away], axis=1).reshape(-1, 3)
    neighbours = build_list(x, CUTOFF, 0.13, None if aspect is None else inverse, reach)
    for first in range(0, len(x), others + 1):
        listed = neighbours.index[row(neighbours, first)]
        assert sorted(listed) == sorted(first + 1 + np.flatnonzero(within[first // (others + 1)]))
        for other in range(first + 1, first + others + 1) if aspect is None else ():
            assert (other in listed) == (first in neighbours.index[row(neighbours, other)])


@pytest.mark.parametrize("metric", [False, True])
def test_rows_do_not_remember_where_they_were_weighed_before(metric):
    # What is within reach changes back and forth; a run that is resumed has a new list and must get the same sums.
    rng = np.random.default_rng(8)
    x = CLOUDS["random box"]
    x = x[sort_into_cells(x, CUTOFF).order]
    shape = np.tile([1.1, 1.0, 1.0 / 1.1, 0.0, 0.0, 0.0], (len(x), 1))
    inverse, reach = inverse_shape(shape) if metric else (None, 1.0)
    neighbours, divided = build_list(x, CUTOFF, 0.13, inverse, reach), set()
    for size in (0.0, 0.13, 0.01, 0.0, 0.1):
        moved = x + size / np.sqrt(3.0) * rng.uniform(-1.0, 1.0, x.shape)
        found = weigh_pairs(neighbours, moved, H, inverse)
        fresh = weigh_pairs(build_list(x, CUTOFF, 0.13, inverse, reach), moved, H, inverse)
        np.testing.assert_array_equal(found.count, fresh.count)
        np.testing.assert_array_equal(found.index, fresh.index)
        for i in range(len(x)):
            np.testing.assert_array_equal(found.weight[row(found, i)], fresh.weight[row(fresh, i)])
        divided.add(tuple(found.count))
    assert len(divided) == 4  # size 0.0 twice


def test_a_list_takes_the_room_of_the_last_one():
    x = CLOUDS["random box"]
    last = build_list(x, CUTOFF, 0.13)
    weigh_pairs(last, x, H)
    squeezed = x * (1.0 + 1e-3)
    fresh = build_list(squeezed, CUTOFF, 0.13)
    again = build_list(squeezed, CUTOFF, 0.13, last=last)
    assert np.shares_memory(again.index, last.index) and np.shares_memory(again.weight, last.weight)
    np.testing.assert_array_equal(again.index, fresh.index)
    longer = build_list(0.8 * x, CUTOFF, 0.13, last=again)
    assert not np.shares_memory(longer.index, again.index)
    np.testing.assert_array_equal(longer.index, build_list(0.8 * x, CUTOFF, 0.13).index)


def test_rows_of_many_particles_equal_those_of_a_tree():
    # More than are listed at a time, surfaces first; then closer together, in room that is too short.
    x = lattice((70, 18, 18), jitter=0.3)
    last = None
    for scale in (1.0, 0.93):
        points = scale * x
        points = points[sort_into_cells(points, CUTOFF).order]
        last = build_list(points, CUTOFF, 0.13, last=last)
        near = cKDTree(points).query_pairs(CUTOFF, output_type="ndarray")
        expected = coo_array((np.ones(len(near)), near.T), shape=(len(x), len(x)))
        expected = (expected + expected.T).tocsr()
        found = csr_array((np.ones(len(last.index)), last.index, last.start), shape=expected.shape)
        assert abs(found - expected).sum() == 0.0


def test_order_keeps_neighbours_close_along_the_longest_extent():
    x = random_cloud(4000, (40.0, 10.0, 10.0))
    for axis in range(3):
        turned = np.ascontiguousarray(np.roll(x, axis, axis=1))
        turned = turned[sort_into_cells(turned, CUTOFF).order]
        neighbours = build_list(turned, CUTOFF, 0.13)
        owner = np.repeat(np.arange(len(x)), np.diff(neighbours.start))
        # Two layers of cells of a charge 40 long.
        assert np.abs(owner - neighbours.index).max() < 4000 * 2.0 * CUTOFF / 40.0 * 1.2


def test_sorting_again_changes_nothing():
    x = CLOUDS["random box"]
    x = x[sort_into_cells(x, CUTOFF).order]
    np.testing.assert_array_equal(sort_into_cells(x, CUTOFF).order, np.arange(len(x)))


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
@pytest.mark.parametrize("metric", [False, True])
def test_lists_are_the_same_to_the_last_bit_with_one_and_two_threads(metric):
    x = lattice((14, 12, 12), jitter=0.3)
    inverse, reach = inverse_shape(stretched(len(x), 1.5, 3)) if metric else (None, 1.0)
    before, found = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            neighbours = build_list(x, CUTOFF, 0.13, inverse, reach)
            found.append((neighbours, weigh_pairs(neighbours, x, H, inverse)))
    finally:
        numba.set_num_threads(before)
    (one, weighed_one), (two, weighed_two) = found
    np.testing.assert_array_equal(one.start, two.start)
    np.testing.assert_array_equal(one.index, two.index)
    np.testing.assert_array_equal(one.blocks.offset, two.blocks.offset)
    for i in range(len(x)):
        assert weighed_one.count[i] == weighed_two.count[i]
        np.testing.assert_array_equal(weighed_one.index[row(weighed_one, i)], weighed_two.index[row(weighed_two, i)])
        np.testing.assert_array_equal(weighed_one.weight[row(weighed_one, i)], weighed_two.weight[row(weighed_two, i)])


def test_blocks_cover_all_rows_and_their_windows_all_neighbours():
    x = lattice((30, 10, 10), jitter=0.3)
    neighbours = build_list(x[sort_into_cells(x, CUTOFF).order], CUTOFF, 0.13)
    blocks = neighbours.blocks
    assert len(blocks.low) > 2
    assert blocks.rows[0] == 0
    assert blocks.rows[-1] == len(x)
    for b in range(len(blocks.low)):
        reached = neighbours.index[neighbours.start[blocks.rows[b]] : neighbours.start[blocks.rows[b + 1]]]
        assert reached.min() >= blocks.low[b]
        assert reached.max() < blocks.low[b] + blocks.offset[b + 1] - blocks.offset[b]


@pytest.mark.parametrize("aspect", [1.0, 1.3])
def test_list_is_the_same_whether_its_particles_had_to_be_sorted_or_not(aspect):
    implicit = make_squeeze(shape=(8, 7, 6), jitter=0.2)
    integrator, state = ImplicitIntegrator(implicit.model, implicit.state), implicit.state
    state.kernel_shape = np.tile([aspect**2, aspect**-2, 1.0, 0.0, 0.0, 0.0], (len(state), 1))
    integrator.refresh_neighbours(force=True)
    sorted_positions, listed = state.position, integrator.neighbours.index.copy()
    integrator.refresh_neighbours(force=True)
    assert state.position is sorted_positions
    np.testing.assert_array_equal(integrator.neighbours.index, listed)
    for order in ([1, 0, *range(2, len(state))], np.random.default_rng(3).permutation(len(state))):
        state.reorder(np.array(order, dtype=np.int32))
        integrator.refresh_neighbours(force=True)
        cutoff = SUPPORT * integrator.model.smoothing_length * (1.0 + SKIN)
        plain = build_list(state.position, cutoff, 0.13, *integrator.metric(state.kernel_shape))
        np.testing.assert_array_equal(integrator.neighbours.start, plain.start)
        np.testing.assert_array_equal(integrator.neighbours.index, plain.index)
        np.testing.assert_array_equal(np.sort(state.original), np.arange(len(state)))
