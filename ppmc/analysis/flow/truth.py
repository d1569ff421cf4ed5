"""CT-recovered orientations beside the phantom's truth: differences of A and N, and angles voxel by voxel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ppmc.analysis.averages.averages import RegionAverages
from ppmc.orientation import angle_between_axes

BINS_A_DEGREE = 10


@dataclass(frozen=True)
class TruthRow:
    """A and N of one source in the interior, and how far they are from the truth.

    Attributes
    ----------
    label, note : str
        Source and what exactly was averaged.
    averages : RegionAverages
        One region.
    fibre_difference, normal_difference : ndarray, shape (3, 3)
        A - A_true and N - N_true.
    """

    label: str
    note: str
    averages: RegionAverages
    fibre_difference: np.ndarray
    normal_difference: np.ndarray

    @property
    def largest_difference(self) -> float:
        """Largest |difference| of any component of A or N; NaN if neither is known."""
        both = np.abs(np.concatenate([self.fibre_difference.ravel(), self.normal_difference.ravel()]))
        return float(np.nan if np.isnan(both).all() else np.nanmax(both))


def truth_rows(entries: Sequence[tuple[str, str, RegionAverages]]) -> list[TruthRow]:
    """Subtract the first entry, the truth, from all.

    Parameters
    ----------
    entries : sequence of (str, str, RegionAverages)
        Label, note, and averages over one region: the interior.
    """
    truth = entries[0][2]
    return [
        TruthRow(label, note, a, a.fibre_tensor[0] - truth.fibre_tensor[0], a.normal_tensor[0] - truth.normal_tensor[0])
        for label, note, a in entries
    ]


@dataclass
class AngleErrors:
    """Angles between measured and true axes, gathered in a histogram so that any number of voxels fits.

    Attributes
    ----------
    counts : ndarray, shape (900,)
        Voxels in each tenth of a degree.
    total : float
        Sum of the angles, degrees.
    """

    counts: np.ndarray = field(default_factory=lambda: np.zeros(90 * BINS_A_DEGREE, dtype=np.int64))
    total: float = 0.0

    def add(self, measured: np.ndarray, true: np.ndarray) -> None:
        """Add axes, rows (n, 3) of either; rows that are zero in one of them are left out."""
        known = (np.abs(measured).sum(axis=1) > 0) & (np.abs(true).sum(axis=1) > 0)
        angles = angle_between_axes(measured[known], true[known])
        bins = np.minimum((angles * BINS_A_DEGREE).astype(np.int64), len(self.counts) - 1)
        self.counts += np.bincount(bins, minlength=len(self.counts))
        self.total += float(angles.sum())

    @property
    def count(self) -> int:
        """Voxels compared."""
        return int(self.counts.sum())

    @property
    def mean(self) -> float:
        """Mean angle, degrees."""
        return self.total / self.count if self.count else float("nan")

    def percentile(self, share: float) -> float:
        """Return the angle (degrees, to 0.05) below which `share` percent lie."""
        if not self.count:
            return float("nan")
        k = int(np.searchsorted(np.cumsum(self.counts), share / 100.0 * self.count))
        return (k + 0.5) / BINS_A_DEGREE
