from __future__ import annotations

import numpy as np
import pytest

from ppmc.errors import NumericalError
from ppmc.orientation.closures import affine_tensors
from ppmc.orientation.fitted_closures import CLOSURES
from ppmc.orientation.tensor_ode import (
    FolgarTucker,
    ImprovedArd,
    PhelpsTucker,
    PrincipalArd,
    RotaryDiffusion,
    TensorModel,
    integrate,
)

SHEAR = np.array([[0.0, 1, 0], [0, 0, 0], [0, 0, 0]])
ISOTROPIC = np.eye(3) / 3
A = affine_tensors(np.array([[1.0, 1.2, 0.3], [0.1, 0.9, 0.0], [0.2, 0.0, 0.7]]))[0]
L = np.array([[0.3, 1.0, -0.2], [0.1, -0.5, 0.4], [0.0, 0.2, 0.2]])


def test_exact_closure_reproduces_simple_shear() -> None:
    """With the natural closure A1 is exact for affine motion from isotropy, A2 too."""
    at_one = integrate(TensorModel().rate, ISOTROPIC, lambda t: SHEAR, [0, 1, 2])
    assert np.abs(at_one[1] - affine_tensors(np.eye(3) + SHEAR)[0]).max() < 1e-7
    normal = integrate(TensorModel().normal_rate, ISOTROPIC, lambda t: SHEAR, [0, 1])
    assert np.abs(normal[-1] - affine_tensors(np.linalg.inv(np.eye(3) + SHEAR).T)[0]).max() < 1e-7


def test_rates_keep_trace_and_symmetry() -> None:
    for model in (
        TensorModel(),
        TensorModel("hybrid", 0.98),
        TensorModel("ibof", diffusion=FolgarTucker(0.01)),
        TensorModel("verweyst", diffusion=PhelpsTucker(1e-3, 2e-3, 1e-3, 3e-4, 1e-4), strain_reduction=0.2),
        TensorModel("ibof", diffusion=ImprovedArd(0.01, 0.5)),
        TensorModel("natural", diffusion=PrincipalArd(0.01, 0.7), strain_reduction=0.3),
    ):
        for rate in (model.rate(A, L), model.normal_rate(A, L)):
            assert abs(np.trace(rate)) < 1e-12
            assert np.abs(rate - rate.T).max() < 1e-12


def test_rigid_rotation_turns_the_tensor() -> None:
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    end = integrate(TensorModel("hybrid").rate, A, lambda t: W, [0, np.pi / 2])[-1]
    Q = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert np.abs(end - Q @ A @ Q.T).max() < 1e-8


def test_anisotropic_diffusion_contains_the_isotropic_one() -> None:
    isotropic = TensorModel(diffusion=FolgarTucker(0.02)).rate(A, L)
    assert np.allclose(TensorModel(diffusion=PhelpsTucker(0.02)).rate(A, L), isotropic, atol=1e-13)
    assert np.allclose(TensorModel(diffusion=ImprovedArd(0.02, 0.0)).rate(A, L), isotropic, atol=1e-13)
    D = 0.5 * (L + L.T)
    textbook = TensorModel().rate(A, L) + 2 * 0.02 * np.sqrt(2 * np.sum(D * D)) * (np.eye(3) - 3 * A)
    assert np.allclose(isotropic, textbook, atol=1e-13)


DIFFUSIONS = (FolgarTucker(0.01), PhelpsTucker(1e-3, 2e-2, 1e-2, 3e-3, 1e-3), ImprovedArd(0.02, 0.6), None)


@pytest.mark.parametrize("diffusion", DIFFUSIONS, ids=lambda d: type(d).__name__)
def test_reduced_strain_slows_eigenvalues_only(diffusion: RotaryDiffusion | None) -> None:
    """Wang, O'Gara and Tucker's definition: eigenvalue rates times κ, eigenvectors turn as before."""
    full = TensorModel(diffusion=diffusion)
    slow = TensorModel(diffusion=diffusion, strain_reduction=0.1)
    axes = np.linalg.eigh(A)[1]
    a, b = (axes.T @ m.rate(A, L) @ axes for m in (full, slow))
    assert np.allclose(np.diag(b), 0.1 * np.diag(a), atol=1e-13)
    off = ~np.eye(3, dtype=bool)
    assert np.allclose(b[off], a[off], atol=1e-13)


def test_ard_with_reduced_strain_is_the_published_equation() -> None:
    """Phelps and Tucker (2009), ARD-RSC with 𝕃, 𝕄 and C written out."""
    kappa, diffusion = 0.2, PhelpsTucker(1e-3, 2e-2, 1e-2, 3e-3, 1e-3)
    D, W = 0.5 * (L + L.T), 0.5 * (L - L.T)
    shear_rate = np.sqrt(2 * np.sum(D * D))
    C, A4 = diffusion.tensor(A, D, shear_rate), CLOSURES["ibof"](A)
    values, axes = np.linalg.eigh(A)
    e = axes.T
    L4 = np.einsum("k,ki,kj,km,kn->ijmn", values, e, e, e, e)
    M4 = np.einsum("ki,kj,km,kn->ijmn", e, e, e, e)
    reduced = A4 + (1 - kappa) * (L4 - np.einsum("ijkl,klmn->ijmn", M4, A4))

    def dot(fourth: np.ndarray, second: np.ndarray) -> np.ndarray:
        return np.asarray(np.einsum("ijkl,kl->ij", fourth, second))

    published = W @ A - A @ W + D @ A + A @ D - 2 * dot(reduced, D)
    published += shear_rate * (
        2 * (C - (1 - kappa) * dot(M4, C)) - 2 * kappa * np.trace(C) * A - 5 * (C @ A + A @ C) + 10 * dot(reduced, C)
    )
    model = TensorModel("ibof", diffusion=diffusion, strain_reduction=kappa)
    assert np.abs(model.rate(A, L) - published).max() < 1e-13


def test_diffusion_alone_ends_in_isotropy_under_no_flow_gradient_of_shape() -> None:
    strong = integrate(TensorModel("ibof", diffusion=FolgarTucker(10.0)).rate, A, lambda t: SHEAR, [0, 1], 1e-7)[-1]
    assert np.abs(strong - ISOTROPIC).max() < 0.02


def test_leading_axes_go_together() -> None:
    many = np.stack([A, ISOTROPIC])
    gradients = np.stack([L, SHEAR])
    rate = TensorModel().rate(many, gradients)
    assert np.allclose(rate[1], TensorModel().rate(ISOTROPIC, SHEAR), atol=1e-13)
    assert np.allclose(rate[0], TensorModel().rate(A, L), atol=1e-13)


def test_a_closure_that_runs_away_says_so() -> None:
    """The linear closure is known to fail where fibres align without diffusion."""
    stretch = np.diag([1.0, -0.5, -0.5])
    with pytest.raises(NumericalError, match="closure does not serve"):
        integrate(TensorModel("linear").rate, ISOTROPIC, lambda t: stretch, [0, 40.0], 1e-6)


def test_a_fast_start_needs_no_luck() -> None:
    """A shear rate of 1e4 that dies away within a fraction of the span: γ = 2 in the end, and no overflow before."""
    F = np.array([[1.0, 2.0, 0], [0, 1, 0], [0, 0, 1]])
    end = integrate(TensorModel("verweyst").rate, ISOTROPIC, lambda t: SHEAR * 1e4 * np.exp(-t / 2e-4), [0, 1.0], 1e-8)
    assert np.abs(end[-1] - affine_tensors(F)[0]).max() < 2e-3


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_blow_up_is_an_error_not_a_hang() -> None:
    with pytest.raises(NumericalError):
        integrate(lambda a, g: a * a * 1e6, ISOTROPIC, lambda t: SHEAR, [0, 1.0])
