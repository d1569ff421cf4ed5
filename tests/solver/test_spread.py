"""Neighbours that do not spread in three dimensions: refused at the start, stopped on the way, and nothing else is."""

import numpy as np
import pytest

from ppmc.errors import NumericalError, SceneError
from ppmc.solver.particles.kernel_shape import MOST_SWOLLEN, full, inverse_shape, kernel_of
from ppmc.solver.particles.neighbours import build_list, weigh_pairs
from ppmc.solver.sph.gradient import moment_inverses
from ppmc.solver.step.spread import check_layers, lies_flat

from .blocks import lattice, stretched
from .scenes import make_squeeze, squeeze


def flat(positions: np.ndarray, shape: np.ndarray | None = None) -> np.ndarray:
    metric, longest = (None, 1.0) if shape is None else inverse_shape(shape)
    pairs = weigh_pairs(build_list(positions, 2.7, 0.05, metric, longest), positions, 1.3, metric)
    return lies_flat(pairs, moment_inverses(pairs, positions, np.ones(len(positions)))[0])


def test_a_layer_and_a_row_lie_flat_and_two_layers_do_not():
    assert flat(lattice((6, 6, 1))).all()
    assert flat(lattice((1, 9, 1)))[1:-1].all()  # those at its ends have two neighbours
    assert not flat(lattice((6, 6, 2), jitter=0.2)).any()
    assert not flat(lattice((2, 2, 8))).any()


def test_layers_are_seen_in_any_position():
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    assert flat(lattice((7, 7, 1)) @ turn.T).all()
    assert not flat(lattice((6, 6, 3)) @ turn.T).any()


def test_strays_are_no_layer():
    strays = np.array([[50.0, 0.0, 0.0], [80.0, 0.0, 0.0], [81.0, 0.0, 0.0]])
    assert not flat(np.concatenate([lattice((6, 6, 3)), strays])).any()


def test_curved_sheets_count_by_their_layers():
    angle, along = np.meshgrid(np.arange(40) / 15.0, np.arange(12.0))
    for layers, expected in ((1, True), (2, False)):
        sheet = [
            np.stack([(15.0 + k) * np.cos(angle), along, (15.0 + k) * np.sin(angle)], axis=-1).reshape(-1, 3)
            for k in range(layers)
        ]
        assert flat(np.concatenate(sheet)).mean() == (1.0 if expected else 0.0)


@pytest.mark.parametrize("stretch", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("along", [1.0, 0.0])
def test_kernels_reach_along_lattices_drawn_out(stretch, along):
    """Plane strain (1) and even spreading (0) to a tenth of the height: every particle sees all its neighbours."""
    scale = np.array([stretch**along * stretch ** (0.5 * (1.0 - along)), stretch ** (0.5 * (1.0 - along)), 1 / stretch])
    positions = lattice((7, 7, 9)) * scale
    shape = np.zeros((len(positions), 6))
    shape[:, :3] = scale**2
    assert not flat(positions, kernel_of(shape, 4.0)).any()


def test_a_kernel_keeps_its_ratio_until_that_costs_neighbours():
    modest = stretched(200, 4.0, 5)
    np.testing.assert_allclose(kernel_of(modest, 4.0), modest, atol=1e-12)
    drawn_out = np.concatenate([stretched(200, 12.0, 6), stretched(200, 300.0, 7)])
    kernels = np.sqrt(np.linalg.eigvalsh(full(kernel_of(drawn_out, 4.0))))
    lattices = np.sqrt(np.linalg.eigvalsh(full(drawn_out)))
    np.testing.assert_allclose(np.prod(kernels, axis=1), 1.0, rtol=1e-9)
    assert (lattices[:, 2] / kernels[:, 2]).max() < MOST_SWOLLEN ** (1.0 / 3.0) + 1e-9
    ratio = kernels[:, 2] / kernels[:, 0]
    held = ratio < 4.0 + 1e-9
    assert held.any() and not held.all()
    # Where the limit gave way, it did no more than it had to.
    np.testing.assert_allclose(lattices[~held, 2] / kernels[~held, 2], MOST_SWOLLEN ** (1.0 / 3.0), rtol=1e-9)


def test_a_single_layer_is_refused_at_the_start():
    integrator = make_squeeze((8, 8, 1))
    with pytest.raises(SceneError, match=r"64 of 64 particles.* 1 mm thick.*spacing of 0\.25 mm"):
        check_layers(integrator.model, integrator.state, "charge.vtkhdf")
    for shape in ((8, 8, 2), (2, 2, 9)):
        integrator = make_squeeze(shape)
        check_layers(integrator.model, integrator.state, "charge.vtkhdf")


def test_a_run_stops_where_kernels_lose_the_lattice():
    with pytest.raises(NumericalError, match=r"one layer or row only, drawn out to [2-9]\.\d* and down to 0\.\d+"):
        squeeze(shape=(6, 6, 6), ratio=100.0, reduction=0.12, kernel_shape="sphere")
