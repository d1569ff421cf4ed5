"""Orientation tensors of second and fourth order, of fibres (A) and of platelet normals (N).

Order of components wherever six numbers stand for a symmetric tensor: XX, YY, ZZ, XY, YZ, XZ, as VTK has it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

SIX = ("XX", "YY", "ZZ", "XY", "YZ", "XZ")
_ROW = np.array([0, 1, 2, 0, 1, 0])
_COLUMN = np.array([0, 1, 2, 1, 2, 2])


def orientation_tensor(directions: Array, weights: Array | None = None) -> Array:
    """Return the second-order orientation tensor <v v>.

    Parameters
    ----------
    directions : ndarray, shape (n, 3)
        Unit vectors; their sign does not matter.
    weights : ndarray, shape (n,), optional
        Volumes to average with; equal if left out.

    Returns
    -------
    ndarray, shape (3, 3)
        Symmetric, trace one (J, section II.A; Advani and Tucker, J. Rheol. 31 (1987) 751). NaN if n = 0.
    """
    v, w = _weighted(directions, weights)
    return (v * w[:, None]).T @ v if len(v) else np.full((3, 3), np.nan)


def orientation_tensor4(directions: Array, weights: Array | None = None) -> Array:
    """Return the fourth-order orientation tensor <v v v v>, shape (3, 3, 3, 3); arguments as `orientation_tensor`."""
    v, w = _weighted(directions, weights)
    if not len(v):
        return np.full((3, 3, 3, 3), np.nan)
    dyads = v[:, :, None] * v[:, None, :]
    flat = dyads.reshape(-1, 9)
    return ((flat * w[:, None]).T @ flat).reshape(3, 3, 3, 3)


def _weighted(directions: Array, weights: Array | None) -> tuple[Array, Array]:
    """Return directions as float64 and weights that sum to one."""
    v = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
    w = np.ones(len(v)) if weights is None else np.asarray(weights, dtype=np.float64).reshape(-1)
    return v, w / w.sum() if len(w) else w


def to_six(tensor: Array) -> Array:
    """Return the components XX, YY, ZZ, XY, YZ, XZ, shape (..., 6), of symmetric tensors, shape (..., 3, 3)."""
    return np.asarray(tensor)[..., _ROW, _COLUMN]


def from_six(components: Array) -> Array:
    """Return symmetric tensors, shape (..., 3, 3), from components XX, YY, ZZ, XY, YZ, XZ, shape (..., 6)."""
    c = np.asarray(components)
    full = np.empty((*c.shape[:-1], 3, 3), dtype=c.dtype)
    full[..., _ROW, _COLUMN] = c
    full[..., _COLUMN, _ROW] = c
    return full


def to_six_by_six(tensor: Array) -> Array:
    """Return a fourth-order tensor with minor symmetries as a (..., 6, 6) matrix.

    Rows and columns in the order XX, YY, ZZ, XY, YZ, XZ, entries the tensor's own components, without factors.
    """
    t = np.asarray(tensor)
    return t[..., _ROW[:, None], _COLUMN[:, None], _ROW[None, :], _COLUMN[None, :]]
