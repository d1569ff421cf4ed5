"""Frames and their transport against the papers' identities."""

from __future__ import annotations

import numpy as np
import pytest

from ppmc.orientation import (
    angle_between_axes,
    in_plane_from_normal,
    normalise,
    orthonormal_frame,
    push_affine,
    push_normal,
    shear_angle,
)

RNG = np.random.default_rng(3)


def platelets(n: int = 200) -> tuple[np.ndarray, np.ndarray]:
    return normalise(RNG.normal(size=(n, 3))), normalise(RNG.normal(size=(n, 3)))


def deformations(n: int = 200) -> np.ndarray:
    F = np.eye(3) + 0.4 * RNG.normal(size=(n, 3, 3))
    return F[np.linalg.det(F) > 0.05]


def test_frame_is_orthonormal_and_right_handed() -> None:
    p, q, r = orthonormal_frame(*platelets())
    Q = np.stack([p, q, r], axis=-1)
    assert np.allclose(np.swapaxes(Q, -1, -2) @ Q, np.eye(3), atol=1e-14)
    assert np.allclose(np.linalg.det(Q), 1.0)


def test_normal_transport_equals_p_cross_q() -> None:
    """r = p x q after transport of p and q-hat is F^-T r0 normalised."""
    F = deformations()
    p0, q0, r0 = orthonormal_frame(*platelets(len(F)))
    p, q_hat = push_affine(p0, F), push_affine(q0, F)
    _, _, r = orthonormal_frame(p, q_hat)
    assert np.allclose(r, push_normal(r0, F), atol=1e-12)
    assert np.allclose(push_normal(r0, F), normalise(np.einsum("nji,nj->ni", np.linalg.inv(F), r0)), atol=1e-12)


def test_transport_composes() -> None:
    F, G = deformations()[:50], deformations()[:50]
    p, r = platelets(50)
    assert np.allclose(push_affine(push_affine(p, F), G), push_affine(p, G @ F), atol=1e-12)
    assert np.allclose(push_normal(push_normal(r, F), G), push_normal(r, G @ F), atol=1e-12)


@pytest.mark.parametrize("gamma", [-2.0, 0.0, 0.3, 1.0])
def test_shear_angle_of_simple_shear(gamma: float) -> None:
    """Shear gamma of q-hat along p turns q-hat by atan(gamma) out of q."""
    p, q = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    F = np.array([[1, gamma, 0], [0, 1, 0], [0, 0, 1]])
    assert shear_angle(push_affine(p, F), push_affine(q, F)) == pytest.approx(np.degrees(np.arctan(gamma)), abs=1e-12)


def test_in_plane_from_normal_gives_the_same_frame() -> None:
    p, q, r = orthonormal_frame(*platelets())
    assert np.allclose(in_plane_from_normal(p, r), q, atol=1e-14)


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e300])
def test_normalise_any_scale(scale: float) -> None:
    v = RNG.normal(size=(10, 3))
    assert np.allclose(normalise(v * scale), v / np.linalg.norm(v, axis=1, keepdims=True), rtol=1e-14)


def test_small_angles_are_exact() -> None:
    a = np.array([1.0, 0, 0])
    for angle in (1e-9, 1e-4, 1.0, 1.5):
        b = -np.array([np.cos(angle), np.sin(angle), 0])
        assert angle_between_axes(a, b) == pytest.approx(np.degrees(angle), rel=1e-9)
