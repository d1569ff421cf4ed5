"""Orientation tensors: closed forms, symmetry, rotation, storage order."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ppmc.orientation import from_six, normalise, orientation_tensor, orientation_tensor4, to_six, to_six_by_six

RNG = np.random.default_rng(8)


def test_planar_fibres_have_the_closed_form() -> None:
    """Equally spaced planar fibres: A = diag(1/2, 1/2, 0), A_1111 = 3/8, A_1122 = 1/8."""
    angle = np.linspace(0, np.pi, 36, endpoint=False)
    p = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    assert np.allclose(orientation_tensor(p), np.diag([0.5, 0.5, 0]), atol=1e-15)
    A4 = orientation_tensor4(p)
    assert np.isclose(A4[0, 0, 0, 0], 3 / 8) and np.isclose(A4[0, 0, 1, 1], 1 / 8) and np.isclose(A4[0, 1, 1, 0], 1 / 8)


def test_isotropic_limit_of_many() -> None:
    p = normalise(RNG.normal(size=(200_000, 3)))
    assert np.allclose(orientation_tensor(p), np.eye(3) / 3, atol=4e-3)
    assert np.isclose(orientation_tensor4(p)[2, 2, 2, 2], 1 / 5, atol=4e-3)


@given(st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_invariants(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = normalise(rng.normal(size=(n, 3)))
    w = rng.uniform(0.1, 2.0, n)
    A, A4 = orientation_tensor(p, w), orientation_tensor4(p, w)
    assert np.isclose(np.trace(A), 1.0) and np.allclose(A, A.T)
    assert np.allclose(np.einsum("ijkk->ij", A4), A, atol=1e-14)
    for axes in ((1, 0, 2, 3), (2, 3, 0, 1), (0, 2, 1, 3), (3, 1, 2, 0)):
        assert np.allclose(A4, A4.transpose(axes), atol=1e-14)
    assert np.linalg.eigvalsh(A).min() > -1e-12
    assert np.allclose(orientation_tensor(-p, 3 * w), A)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    assert np.allclose(orientation_tensor(p @ Q.T, w), Q @ A @ Q.T, atol=1e-13)


def test_weights_equal_repetition() -> None:
    p = normalise(RNG.normal(size=(3, 3)))
    assert np.allclose(orientation_tensor(p, np.array([1, 2, 3])), orientation_tensor(p[[0, 1, 1, 2, 2, 2]]))


def test_nothing_averages_to_nan() -> None:
    assert np.isnan(orientation_tensor(np.zeros((0, 3)))).all()
    assert np.isnan(orientation_tensor4(np.zeros((0, 3)))).all()


def test_storage_order() -> None:
    T = np.arange(9.0).reshape(3, 3)
    T = T + T.T
    assert np.array_equal(to_six(T), [T[0, 0], T[1, 1], T[2, 2], T[0, 1], T[1, 2], T[0, 2]])
    assert np.array_equal(from_six(to_six(T)), T)
    A4 = orientation_tensor4(normalise(RNG.normal(size=(5, 3))))
    six = to_six_by_six(A4)
    assert six.shape == (6, 6) and np.allclose(six, six.T)
    assert six[0, 4] == A4[0, 0, 1, 2] and six[3, 5] == A4[0, 1, 0, 2]
