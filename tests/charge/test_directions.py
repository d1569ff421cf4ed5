"""Directions that need no data."""

import numpy as np
import pytest

from ppmc.charge.orientations.directions import planar_random, plane_axes, uniform_frames
from ppmc.charge.orientations.frames import Frames
from ppmc.orientation import orientation_tensor, orientation_tensor4


def test_plane_axes_are_right_handed_with_any_normal():
    normals = np.random.default_rng(3).normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    a, b = plane_axes(normals)
    np.testing.assert_allclose(np.cross(a, b), normals, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(a, axis=1), 1, atol=1e-12)
    x, y = plane_axes(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose([x, y], np.eye(3)[:2])


def test_planar_random_has_the_tensors_of_the_planar_uniform_state():
    # D4 and D5: A = (I - nn)/2, A4 = (PP + two permutations)/8 with P = I - nn.
    n = np.array([1.0, 2.0, 2.0]) / 3
    p = planar_random(np.tile(n, (200_000, 1)), np.random.default_rng(5))
    P = np.eye(3) - np.outer(n, n)
    assert np.abs(p @ n).max() < 1e-12
    np.testing.assert_allclose(orientation_tensor(p), P / 2, atol=4e-3)
    A4 = (np.einsum("ij,kl->ijkl", P, P) + np.einsum("ik,jl->ijkl", P, P) + np.einsum("il,jk->ijkl", P, P)) / 8
    np.testing.assert_allclose(orientation_tensor4(p), A4, atol=4e-3)


def test_one_seed_repeats_and_two_differ():
    normals = np.tile([0.0, 0.0, 1.0], (100, 1))
    one, again, other = (planar_random(normals, np.random.default_rng([s, 3])) for s in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)


def test_uniform_frames_and_q_hat():
    p, r = uniform_frames(4, (0, 2, 0), (0, 0, 3))
    frames = Frames.of(p, r, 0)
    assert frames.in_plane_direction == pytest.approx(np.tile([-1.0, 0, 0], (4, 1)))
    assert np.cross(p, frames.in_plane_direction) == pytest.approx(r)
