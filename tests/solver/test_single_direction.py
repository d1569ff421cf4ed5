"""The vectorised product against the general sweeps, over several blocks of rows, sorted and not."""

import numba
import numpy as np
import pytest

from ppmc.solver.particles.cells import sort_into_cells
from ppmc.solver.particles.neighbours import build_list, weigh_pairs
from ppmc.solver.sph.operator import assemble

from .blocks import lattice, unit_vectors


def make(positions: np.ndarray, directions: np.ndarray, fibre: np.ndarray):
    n = len(positions)
    rng = np.random.default_rng(7)
    volumes, shear, bulk = rng.uniform(0.8, 1.2, n), rng.uniform(1.0, 3.0, n), rng.uniform(40.0, 60.0, n)
    pairs = weigh_pairs(build_list(positions, 2.7, 0.05), positions, 1.3)
    return assemble(pairs, positions, volumes, shear, bulk, fibre, directions)


@pytest.mark.parametrize("order", ["sorted", "shuffled"])
def test_product_equals_the_general_sweeps_over_many_blocks(order):
    x = lattice((16, 12, 12), jitter=0.2)
    x = x[sort_into_cells(x, 2.7).order] if order == "sorted" else np.random.default_rng(1).permutation(x)
    p = unit_vectors(len(x))
    fibre = np.full((len(x), 1), 400.0)
    fast = make(x, p, fibre)
    assert len(fast.pairs.blocks.low) > 1
    # A second direction without stiffness changes nothing but the way the sums are taken.
    general = make(x, np.repeat(p, 2, axis=1), np.hstack([fibre, 0.0 * fibre]))
    velocities = np.random.default_rng(2).normal(size=x.shape)
    expected = general.apply(velocities)
    np.testing.assert_allclose(fast.apply(velocities), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
def test_product_is_the_same_to_the_last_bit_with_one_and_two_threads():
    x = lattice((16, 12, 12), jitter=0.2)
    operator = make(x, unit_vectors(len(x)), np.full((len(x), 1), 400.0))
    velocities = np.random.default_rng(2).normal(size=x.shape)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = operator.apply(velocities)
        numba.set_num_threads(2)
        two = operator.apply(velocities)
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(one, two)
