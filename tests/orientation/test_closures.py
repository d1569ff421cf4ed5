from __future__ import annotations

import numpy as np
import pytest
from scipy.special import elliprd

from ppmc.orientation.closures import (
    affine_eigenvalues,
    affine_fourth,
    affine_tensors,
    carlson_rd,
    inverse_stretches,
    natural,
    rotate_fourth,
)
from ppmc.orientation.fitted_closures import CLOSURES, symmetrise

RNG = np.random.default_rng(4)


def some_tensors(n: int = 200) -> tuple[np.ndarray, np.ndarray]:
    rotation = np.linalg.qr(RNG.normal(size=(n, 3, 3)))[0]
    return affine_tensors(rotation * np.exp(RNG.uniform(-1.5, 1.5, (n, 1, 3))))


def test_carlson_equals_scipy() -> None:
    x, y, z = np.exp(RNG.uniform(-14, 14, (3, 2000)))
    assert np.abs(carlson_rd(x, y, z) / elliprd(x, y, z) - 1).max() < 3e-15


@pytest.mark.parametrize(
    ("shear", "expected"),
    [
        (1, (0.426644, 0.264916, 0.308440, 0.161729)),
        (2, (0.576859, 0.163075, 0.260066, 0.206892)),
        (5, (0.801348, 0.042846, 0.155806, 0.151700)),
        (10, (0.899638, 0.011342, 0.089020, 0.088830)),
    ],
)
def test_simple_shear_from_isotropy(shear: float, expected: tuple[float, ...]) -> None:
    F = np.eye(3)
    F[0, 1] = shear
    A, _ = affine_tensors(F)
    assert np.allclose((A[0, 0], A[1, 1], A[2, 2], A[0, 1]), expected, atol=1e-6)


def test_affine_tensors_are_the_averages_of_pushed_directions() -> None:
    """Quadrature on the sphere: Gauss in height, equal angles around."""
    z, w = np.polynomial.legendre.leggauss(160)
    phi = (np.arange(160) + 0.5) * 2 * np.pi / 160
    s = np.sqrt(1 - z**2)
    p = np.stack([np.outer(s, np.cos(phi)), np.outer(s, np.sin(phi)), np.outer(z, np.ones(160))], -1).reshape(-1, 3)
    weight = np.repeat(w, 160) / 320
    F = np.array([[1.0, 1.2, 0.3], [0.1, 0.9, 0.0], [0.2, 0.0, 0.7]])
    q = p @ F.T
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    A, A4 = affine_tensors(F)
    assert np.abs(np.einsum("n,ni,nj->ij", weight, q, q) - A).max() < 1e-12
    assert np.abs(np.einsum("n,ni,nj,nk,nl->ijkl", weight, q, q, q, q, optimize=True) - A4).max() < 1e-12


def test_fourth_order_identity() -> None:
    """A_iijj = (x_i a_i − x_j a_j) / (2 (x_i − x_j)), rows sum to a."""
    x = np.exp(RNG.uniform(-3, 3, (300, 3)))
    a = affine_eigenvalues(x)
    fourth = affine_fourth(x, a)
    assert np.abs(fourth.sum(axis=-1) - a).max() < 1e-13
    assert np.allclose(a.sum(axis=-1), 1, atol=1e-14)
    for i, j in ((0, 1), (1, 2), (0, 2)):
        gap = x[:, i] - x[:, j]
        far = np.abs(gap) > 0.1 * x[:, i]
        formula = (x[:, i] * a[:, i] - x[:, j] * a[:, j]) / (2 * gap)
        assert np.abs(fourth[far, i, j] - formula[far]).max() < 1e-12


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-6, 5e-4, 2e-3])
def test_equal_stretches_lose_no_digits(gap: float) -> None:
    """Equal x give A_iijj = A_iiii/3; close ones approach that linearly and without jumps."""
    x = np.array([[1.0, 1.0 + gap, 4.0], [1.0, 1.0 + gap, 1.0]])
    a = affine_eigenvalues(x)
    fourth = affine_fourth(x, a)
    mean = 0.5 * (fourth[:, 0, 0] + fourth[:, 1, 1])
    assert np.abs(fourth[:, 0, 1] - mean / 3).max() < 1e-12 + gap**2
    if gap == 0:
        assert fourth[1, 0, 0] == pytest.approx(0.2, abs=1e-13)


def test_natural_closure_inverts_affine_motion() -> None:
    A, A4 = some_tensors()
    assert np.abs(natural(A) - A4).max() < 1e-12
    x = inverse_stretches(np.linalg.eigvalsh(A))
    assert np.allclose(np.prod(x, axis=1), 1)


@pytest.mark.parametrize(
    "a", [(1 / 3, 1 / 3, 1 / 3), (0.5, 0.5, 0.0), (1.0, 0.0, 0.0), (0.7, 0.3, 0.0), (0.99, 0.005, 0.005)]
)
def test_natural_closure_at_the_edges(a: tuple[float, ...]) -> None:
    fourth = natural(np.diag(a))
    assert np.isfinite(fourth).all()
    assert np.abs(np.einsum("ijkk->ij", fourth) - np.diag(a)).max() < 1e-10
    if a == (0.5, 0.5, 0.0):
        assert fourth[0, 0, 0, 0] == pytest.approx(3 / 8, abs=1e-9)


@pytest.mark.parametrize("name", CLOSURES)
def test_every_closure_contracts_and_turns_with_its_tensor(name: str) -> None:
    closure = CLOSURES[name]
    A, exact = some_tensors(60)
    fourth = closure(A)
    assert fourth.shape == (60, 3, 3, 3, 3)
    assert np.abs(np.einsum("nijkk->nij", fourth) - A).max() < 1e-12
    assert np.allclose(closure(A[0]), fourth[0], atol=1e-12)
    R = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    turned = np.einsum("ia,jb,kc,ld,nabcd->nijkl", R, R, R, R, fourth, optimize=True)
    assert np.abs(closure(R @ A @ R.T) - turned).max() < 1e-8
    limit = {"natural": 1e-12, "ibof": 2e-3, "verweyst": 2e-3, "orthotropic_fitted": 0.02}.get(name, 0.25)
    assert np.abs(fourth - exact).max() < limit
    if name not in ("quadratic", "hybrid"):
        assert np.abs(fourth - symmetrise(fourth)).max() < 1e-12


@pytest.mark.parametrize("name", ["natural", "linear", "hybrid", "ibof", "verweyst"])
def test_isotropy(name: str) -> None:
    fourth = CLOSURES[name](np.eye(3) / 3)
    assert fourth[0, 0, 0, 0] == pytest.approx(0.2, abs=2e-3)
    assert fourth[0, 0, 1, 1] == pytest.approx(1 / 15, abs=2e-3)


def test_quadratic_is_exact_for_alignment() -> None:
    p = np.array([0.6, 0.0, 0.8])
    assert np.allclose(CLOSURES["quadratic"](np.outer(p, p)), np.einsum("i,j,k,l->ijkl", p, p, p, p))


def test_rotate_fourth_turns_principal_components() -> None:
    R = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    principal = np.array([[0.3, 0.1, 0.05], [0.1, 0.2, 0.02], [0.05, 0.02, 0.1]])
    full = rotate_fourth(principal, np.eye(3))
    assert np.allclose(
        rotate_fourth(principal, R), np.einsum("ia,jb,kc,ld,abcd->ijkl", R, R, R, R, full, optimize=True), atol=1e-14
    )
