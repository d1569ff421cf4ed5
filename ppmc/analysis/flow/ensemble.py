"""Several runs: mean and spread between seeds, and the difference of two runs of the same particles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ppmc.analysis.averages.averages import RegionAverages
from ppmc.orientation import angle_between_axes


@dataclass(frozen=True)
class Ensemble:
    """Statistics over k runs that differ in their seed; m regions.

    Attributes
    ----------
    runs : int
        How many.
    fibre_mean, fibre_spread, normal_mean, normal_spread : ndarray, shape (m, 3, 3)
        Mean and standard deviation (k − 1 in the denominator) of A and N over the runs that have material there.
    filled : ndarray, shape (m,)
        Runs with material in the region.
    """

    runs: int
    fibre_mean: np.ndarray
    fibre_spread: np.ndarray
    normal_mean: np.ndarray
    normal_spread: np.ndarray
    filled: np.ndarray


def ensemble(runs: Sequence[RegionAverages]) -> Ensemble:
    """Return mean and spread over runs of the same regions; spread is NaN with fewer than two runs in a region."""
    fibre = np.array([r.fibre_tensor for r in runs])
    normal = np.array([r.normal_tensor for r in runs])
    filled = np.isfinite(fibre[:, :, 0, 0]).sum(axis=0)
    return Ensemble(len(runs), *_mean_and_spread(fibre), *_mean_and_spread(normal), filled)


def _mean_and_spread(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    known = np.isfinite(values)
    count = known.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known, values, 0.0).sum(axis=0) / count
        square = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0) / (count - 1)
    return np.where(count > 0, mean, np.nan), np.sqrt(np.where(count > 1, square, np.nan))


@dataclass(frozen=True)
class RunDifference:
    """How far two runs of the same particles are apart at one time.

    Attributes
    ----------
    distance_mean, distance_p99 : float
        Between the places of each particle, mm.
    angle_mean, angle_p99 : float
        Between its fibre directions, degrees.
    overlap : float
        Intersection over union of the space they fill.
    """

    distance_mean: float
    distance_p99: float
    angle_mean: float
    angle_p99: float
    overlap: float


def particle_difference(
    positions: tuple[np.ndarray, np.ndarray], directions: tuple[np.ndarray, np.ndarray], overlap: float
) -> RunDifference:
    """Compare the same particles in two runs, rows (n, 3) of either; NaN if their numbers differ."""
    (x, y), (p, q) = positions, directions
    if x.shape != y.shape:
        nan = float("nan")
        return RunDifference(nan, nan, nan, nan, overlap)
    distance = np.linalg.norm(x - y, axis=1)
    angle = angle_between_axes(p, q)
    return RunDifference(
        float(distance.mean()),
        float(np.percentile(distance, 99)),
        float(angle.mean()),
        float(np.percentile(angle, 99)),
        overlap,
    )
