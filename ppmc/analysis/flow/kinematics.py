"""How far the material deformed and how well it kept its volume: statistics of F and J of one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Kinematics:
    """Volume-weighted statistics of one frame; NaN where the field is missing.

    Attributes
    ----------
    time : float
        s.
    mean_deformation_gradient, deformation_gradient_spread : ndarray, shape (3, 3)
        Mean and standard deviation of each component of F.
    volume_ratio_mean, volume_ratio_spread, volume_ratio_min, volume_ratio_max : float
        Of J.
    volume_ratio_low, volume_ratio_high : float
        1st and 99th percentile of J.
    extent : ndarray, shape (3,)
        Extent of the particle centres, mm.
    """

    time: float
    particle_count: int
    mean_deformation_gradient: np.ndarray
    deformation_gradient_spread: np.ndarray
    volume_ratio_mean: float
    volume_ratio_spread: float
    volume_ratio_min: float
    volume_ratio_max: float
    volume_ratio_low: float
    volume_ratio_high: float
    extent: np.ndarray


def kinematics(
    time: float,
    volume: np.ndarray,
    positions: np.ndarray,
    deformation_gradient: np.ndarray | None,
    volume_ratio: np.ndarray | None,
) -> Kinematics:
    """Return the statistics of one frame.

    Parameters
    ----------
    time : float
        s.
    volume : ndarray, shape (n,)
        Weights, mm³.
    positions : ndarray, shape (n, 3)
        mm.
    deformation_gradient : ndarray, shape (n, 9) or (n, 3, 3), optional
        F, row by row.
    volume_ratio : ndarray, shape (n,), optional
        J.
    """
    unknown = np.full((3, 3), np.nan)
    n = len(volume)
    mean, spread = unknown, unknown.copy()
    if deformation_gradient is not None and n:
        F = np.asarray(deformation_gradient, dtype=float).reshape(n, 3, 3)
        mean = np.average(F, axis=0, weights=volume)
        spread = np.sqrt(np.average((F - mean) ** 2, axis=0, weights=volume))
    average = sd = least = largest = low = high = float("nan")
    if volume_ratio is not None and n:
        J = np.asarray(volume_ratio, dtype=float)
        average = float(np.average(J, weights=volume))
        sd = float(np.sqrt(np.average((J - average) ** 2, weights=volume)))
        least, largest = float(J.min()), float(J.max())
        low, high = (float(q) for q in np.percentile(J, [1.0, 99.0], weights=volume, method="inverted_cdf"))
    extent = positions.max(axis=0) - positions.min(axis=0) if n else np.full(3, np.nan)
    return Kinematics(float(time), n, mean, spread, average, sd, least, largest, low, high, extent)


def principal_stretches(deformation_gradient: np.ndarray) -> np.ndarray:
    """Return the principal stretches, ascending, shape (n, 3), of F, shape (n, 9) or (n, 3, 3).

    Roots of the eigenvalues of FᵀF.
    """
    F = np.asarray(deformation_gradient, dtype=float).reshape(-1, 3, 3)
    return np.asarray(np.linalg.svd(F, compute_uv=False)[:, ::-1])
