"""Local axes of a shell-like part: axial, transverse, normal, from the surface normal (D6 and its general form)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.analysis.averages.paths import InspectionPath

Array = NDArray[np.float64]

COMPONENTS = ("a", "t", "n")
LEAST_PROJECTION = 1e-6


def local_frames(normals: ArrayLike, axial: ArrayLike) -> Array:
    """Return rows (a, t, n) of right-handed local axes: R of Ā = R·A·Rᵀ.

    Parameters
    ----------
    normals : array_like, shape (..., 3)
        Surface normals, any length.
    axial : array_like, shape (3,)
        The part's axial direction.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        a is the axial direction's part in the tangent plane, t = n × a. NaN where the normal is unknown, or along the
        axial direction, for then no a stands out.

    Notes
    -----
    With axial e3 and n3 = 0 the rows are (0, 0, 1), (n2, −n1, 0), (n1, n2, 0): D6, which holds in the prismatic zone
    only. The general form keeps a tangential where the surface turns towards the axis.
    """
    n = np.asarray(normals, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        n = n / np.linalg.norm(n, axis=-1, keepdims=True)
        e = np.asarray(axial, dtype=np.float64)
        e = e / np.linalg.norm(e)
        a = e - (n @ e)[..., None] * n
        length = np.linalg.norm(a, axis=-1, keepdims=True)
        a = np.where(length > LEAST_PROJECTION, a / length, np.nan)
    return np.asarray(np.stack([a, np.cross(n, a), n], axis=-2))


def localise(path: InspectionPath, normals: ArrayLike, axial: ArrayLike, origin: str) -> InspectionPath:
    """Return the same path with its components in local axes.

    Parameters
    ----------
    path : InspectionPath
    normals : array_like, shape (m, 3)
        Surface normal of each region.
    axial : array_like, shape (3,)
        The part's axial direction.
    origin : str
        Where the normals come from, for the caption.
    """
    return replace(
        path,
        name=f"{path.name}_local",
        frames=local_frames(normals, axial),
        components=COMPONENTS,
        description=f"{path.description}; local axes a (axial), t (transverse), n (surface normal, from {origin})",
    )


def material_normals(normal_tensor: ArrayLike) -> Array:
    """Return the direction N is largest in, shape (m, 3), of either sign; NaN where N is unknown.

    The platelets' own mean normal stands in where no tool is known.
    """
    N = np.asarray(normal_tensor, dtype=np.float64)
    out = np.full(N.shape[:-1], np.nan)
    known = np.isfinite(N).all(axis=(-1, -2))
    if known.any():
        out[known] = np.linalg.eigh(N[known])[1][..., -1]
    return out


def turned_to(normals: ArrayLike, up: ArrayLike) -> Array:
    """Return normals, shape (m, 3), turned to the side of `up`.

    The nearest tool may lie above here and below there; without this the shear components would change sign between.
    """
    n = np.asarray(normals, dtype=np.float64)
    return np.asarray(n * np.where(n @ np.asarray(up, dtype=np.float64) < 0, -1.0, 1.0)[..., None])


def nearest_normals(distances: Array, normals: Array) -> Array:
    """Return the outward normal of the nearest tool at each point.

    Parameters
    ----------
    distances : ndarray, shape (tools, n)
        Signed distances, mm.
    normals : ndarray, shape (tools, n, 3)
        Gradients of the distances.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    nearest = np.argmin(np.abs(distances), axis=0)
    return np.asarray(normals[nearest, np.arange(distances.shape[1])])
