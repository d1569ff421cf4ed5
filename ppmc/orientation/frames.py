"""Frames of a platelet: fibre direction p, in-plane q-hat, orthogonal q, normal r.

Shapes: every function works on arrays of shape (..., 3), vectors in the last axis, and (..., 3, 3) for tensors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def normalise(vectors: Array) -> Array:
    """Return vectors scaled to unit length.

    Parameters
    ----------
    vectors : ndarray, shape (..., 3)
        Vectors; a zero vector gives NaN, for there is no right answer.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    vectors = np.asarray(vectors, dtype=np.result_type(vectors, np.float32))
    # Scaling by the largest component first keeps tiny and huge vectors clear of under- and overflow.
    largest = np.max(np.abs(vectors), axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = vectors / largest
        return scaled / np.sqrt(np.sum(scaled * scaled, axis=-1, keepdims=True))


def orthonormal_frame(fibre_direction: Array, in_plane_direction: Array) -> tuple[Array, Array, Array]:
    """Return the orthonormal frame p, q, r of platelets.

    Parameters
    ----------
    fibre_direction : ndarray, shape (..., 3)
        p, need not have unit length.
    in_plane_direction : ndarray, shape (..., 3)
        q-hat, any direction in the platelet's plane that is not parallel to p.

    Returns
    -------
    p, q, r : ndarray, shape (..., 3)
        q is q-hat made orthogonal to p by Gram-Schmidt, r = p x q (J, section II.A).
    """
    p = normalise(fibre_direction)
    q_hat = normalise(in_plane_direction)
    q = normalise(q_hat - np.sum(q_hat * p, axis=-1, keepdims=True) * p)
    return p, q, np.cross(p, q)


def in_plane_from_normal(fibre_direction: Array, platelet_normal: Array) -> Array:
    """Return q = r x p, the in-plane direction of an undeformed platelet; shape (..., 3)."""
    return normalise(np.cross(platelet_normal, fibre_direction))


def shear_angle(fibre_direction: Array, in_plane_direction: Array) -> Array:
    """Return the platelet's shear angle in degrees, shape (...): between q-hat and q, signed by p . q-hat.

    Zero for a platelet that has not sheared in its plane (J, section II.A).
    """
    p, q, _ = orthonormal_frame(fibre_direction, in_plane_direction)
    q_hat = normalise(in_plane_direction)
    return np.degrees(np.arctan2(np.sum(q_hat * p, axis=-1), np.sum(q_hat * q, axis=-1)))


def push_affine(direction: Array, deformation_gradient: Array) -> Array:
    """Return F.p/|F.p|: a material line after the deformation F, shapes (..., 3) and (..., 3, 3); J1."""
    return normalise(np.einsum("...ij,...j->...i", deformation_gradient, direction))


def push_normal(normal: Array, deformation_gradient: Array) -> Array:
    """Return F^-T.r/|F^-T.r|: a material plane's normal after the deformation F; J2.

    The cofactor of F stands for det(F) F^-T, so that no inverse is taken and a flat F is no special case.
    """
    F = np.asarray(deformation_gradient)
    cofactor = np.stack(
        [
            np.cross(F[..., 1, :], F[..., 2, :]),
            np.cross(F[..., 2, :], F[..., 0, :]),
            np.cross(F[..., 0, :], F[..., 1, :]),
        ],
        axis=-2,
    )
    return normalise(np.einsum("...ij,...j->...i", cofactor, normal))


def angle_between_axes(a: Array, b: Array) -> Array:
    """Return the angle in degrees, 0 to 90, between axes (directions without a sign); shape (...).

    By arctan2 of cross and dot product, exact for small angles where arccos loses half the digits.
    """
    a, b = normalise(a), normalise(b)
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, np.abs(np.sum(a * b, axis=-1))))
