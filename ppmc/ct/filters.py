"""One-dimensional finite filters: Gaussian, its derivative, and the box of a coarse cell.

Every filter is a float32 array of odd length, symmetric (or antisymmetric) about its middle tap, meant for correlation:
``out[i] = sum_t taps[t] * f[i + t - radius]``. Finite support is what makes results independent of how a volume is cut
into blocks, so nothing here is recursive.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

CUT = 4.0
"""Support of the differentiating Gaussian in standard deviations (a cut at 3 costs up to 0.09 degrees of bias)."""

WINDOW_CUT = 3.0
"""Support of a window in standard deviations; its shape is free, so the longer tail would buy nothing."""

DERIVATIVE_OF_GAUSSIAN_FROM = 0.9
"""Standard deviation (voxels) from which a sampled Gaussian derivative is as good as a fitted one."""

Taps = NDArray[np.float32]


def gaussian(sigma: float, cut: float = CUT) -> Taps:
    """Return normalised Gaussian taps; ``sigma`` in voxels, 0 gives the identity filter."""
    if sigma <= 0.0:
        return np.ones(1, np.float32)
    return _sampled_gaussian(sigma, cut).astype(np.float32)


def derivative(sigma: float) -> Taps:
    """Return taps of the first derivative that goes with :func:`gaussian` of the same ``sigma`` (voxels).

    A Gaussian derivative for ``sigma`` of 0.9 and more. Below that the sampled derivative no longer matches its own
    smoothing, so the taps are fitted: the derivative's frequency response must be ``i w`` times that of the smoothing,
    up to 0.7 of the Nyquist frequency. Both give exactly 1 on a unit ramp.
    """
    smooth = _sampled_gaussian(sigma, CUT)
    radius = len(smooth) // 2
    i = np.arange(-radius, radius + 1, dtype=np.float64)
    if sigma >= DERIVATIVE_OF_GAUSSIAN_FROM:
        taps = i * smooth
    else:
        w = np.linspace(0.01, 0.7 * np.pi, 400)
        k = np.arange(1, radius + 1)
        response = smooth[radius] + 2.0 * np.cos(np.outer(w, k)) @ smooth[radius + 1 :]
        half, *_ = np.linalg.lstsq(2.0 * np.sin(np.outer(w, k)) / (w * response)[:, None], np.ones_like(w), rcond=None)
        taps = np.concatenate([-half[::-1], [0.0], half])
    return (taps / (i @ taps)).astype(np.float32)


def cell_box(width: int) -> Taps:
    """Return the average over a cell of an odd ``width`` of voxels centred on a voxel."""
    return np.full(width, 1.0 / width, np.float32)


def _sampled_gaussian(sigma: float, cut: float) -> NDArray[np.float64]:
    radius = max(1, math.ceil(cut * sigma))
    i = np.arange(-radius, radius + 1, dtype=np.float64)
    taps = np.exp(-0.5 * (i / sigma) ** 2)
    return np.asarray(taps / taps.sum())
