"""What a run has found, in a few numbers, gathered tile by tile."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.block import Box

EVERY = 4
"""Of large results every so many voxels along each axis are looked at: A and N change by a thousandth or so."""
LARGE = 2**20
"""Output voxels from which a result is large."""
BINS = 9000
"""Bins up to a right angle from which the median of the predicted error is taken."""


class Found:
    """Numbers that tell whether a run went well.

    Parameters
    ----------
    shape : tuple of int
        Output voxels (nz, ny, nx).
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._every = EVERY if int(np.prod(shape)) >= LARGE else 1
        self._count = self._valid = 0
        self._confidence = 0.0
        self._errors = np.zeros(BINS, np.int64)
        self._tensors = {name: np.zeros((3, 3)) for name in ("fibre_direction", "platelet_normal")}

    def add(self, fields: dict[str, NDArray[Any]], box: Box) -> None:
        """Count a tile's fields."""
        some = tuple(slice(-a % self._every, None, self._every) for a, _ in box)
        valid = fields["valid"][some] > 0
        self._count += valid.size
        self._valid += int(valid.sum())
        self._confidence += float(fields["confidence"][some][valid].sum(dtype=np.float64))
        bins = (fields["predicted_error"][some][valid] * (BINS / 90.0)).astype(np.int64)
        self._errors += np.bincount(np.minimum(bins, BINS - 1), minlength=BINS)
        for name, tensor in self._tensors.items():
            if name in fields:
                v = fields[name][some][valid].astype(np.float64)
                tensor += v.T @ v

    def join(self, other: Found) -> None:
        """Count what another has counted."""
        self._count += other._count
        self._valid += other._valid
        self._confidence += other._confidence
        self._errors += other._errors
        for name, tensor in self._tensors.items():
            tensor += other._tensors[name]

    def lines(self) -> list[str]:
        """Return what was found as text."""
        if self._valid == 0:
            return ["found: no valid voxel; compare noise level, mask and windows (ppmc ct --suggest)"]
        share = self._valid / self._count
        half = int(np.searchsorted(np.cumsum(self._errors), 0.5 * self._errors.sum()))
        out = [
            f"found: p in {100 * share:.1f} % of the voxels, mean confidence {self._confidence / self._valid:.2f}, "
            f"predicted error {(half + 0.5) * 90.0 / BINS:.2f} degrees (median)"
        ]
        for letter, tensor in zip("AN", self._tensors.values(), strict=True):
            if tensor.any():
                out.append(f"found: {letter} {_written(tensor / self._valid)}")
        return out


def _written(tensor: NDArray[np.float64]) -> str:
    """Return the six components of a tensor as text."""
    names = ("11", "22", "33", "12", "23", "13")
    return ", ".join(f"{n} {tensor[int(n[0]) - 1, int(n[1]) - 1]:.3f}" for n in names)
