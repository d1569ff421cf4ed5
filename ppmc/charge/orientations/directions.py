"""Initial directions that need no data: collimated, and planar random about a normal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ppmc.orientation import normalise

Array = NDArray[np.floating]


def uniform_frames(n: int, fibre_direction: Sequence[float], platelet_normal: Sequence[float]) -> tuple[Array, Array]:
    """Return p and r, each shape (n, 3), the same for every particle; p and r must be perpendicular."""
    p = normalise(np.asarray(fibre_direction, dtype=float))
    r = np.asarray(platelet_normal, dtype=float)
    r = normalise(r - (r @ p) * p)
    return np.tile(p, (n, 1)), np.tile(r, (n, 1))


def plane_axes(normals: Array) -> tuple[Array, Array]:
    """Return two unit vectors that span the plane across each normal, right-handed with it.

    Parameters
    ----------
    normals : ndarray, shape (..., 3)
        Unit vectors.

    Returns
    -------
    a, b : ndarray, shape (..., 3)
        a x b = normal. For the normal (0, 0, 1) these are x1 and x2.
    """
    normals = np.asarray(normals, dtype=float)
    # Start from the axis that is furthest from the normal; x1 wins ties so that (0, 0, 1) gives x1, x2.
    start = np.eye(3)[np.argmin(np.round(np.abs(normals), 12), axis=-1)]
    a = normalise(start - np.sum(start * normals, axis=-1, keepdims=True) * normals)
    return a, np.cross(normals, a)


def planar_random(normals: Array, generator: np.random.Generator) -> Array:
    """Return fibre directions drawn uniformly in the plane across each normal (D, section "Simulation Model Creation").

    Parameters
    ----------
    normals : ndarray, shape (n, 3)
        Unit platelet normals r.
    generator : numpy.random.Generator
        Source of the angles; one draw a particle, in order.

    Returns
    -------
    ndarray, shape (n, 3)
        p, with expectation A = (I - r r)/2 (D4).
    """
    a, b = plane_axes(normals)
    angle = generator.uniform(0.0, np.pi, size=len(a))[:, None]
    return np.cos(angle) * a + np.sin(angle) * b
