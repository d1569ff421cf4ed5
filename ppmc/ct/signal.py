"""How much of the grey values' gradients is noise, and how fine a derivative the signal therefore bears.

The power spectrum of small blocks gives the mean squared gradient after any smoothing, and white noise of a known level
its part of it; what is left is signal. Smoothing takes noise out faster than signal (with the fifth power of its
width), so there is a finest derivative that still sees more signal than noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.noise import blocks_of
from ppmc.ct.source import Volume

MOST_NOISE = 0.5
"""Noise's share of the gradients' energy, over the signal's, up to which a derivative is fine enough: with more, the
directions of rods seen through noise are worse than after more smoothing, whatever the rods' diameter."""
SCALE_SLOPE = 2.0
"""The energy of gradients falls with this power of the smoothing once it is as coarse as what it smooths: about half of
the radius of rods; with the first power before, as long as edges lie apart."""
COARSEST = 1.3
"""Coarsest derivative, in that scale, however strong the noise: beyond it neighbours mix."""
LEAST, MOST, STEPS = 1.0, 3.0, 21
"""Standard deviations of the derivatives that are considered, voxels, and their number."""
BINS = 2048
"""Bins of squared wave numbers."""


@dataclass(frozen=True)
class Signal:
    """What a volume bears.

    Attributes
    ----------
    sigma : float
        Finest standard deviation of the derivative that sees enough signal, voxels of the smallest edge.
    odds : float
        Energy of noise in its gradients over that of the signal.
    scale : float
        Smoothing that is as coarse as what is seen, voxels of the smallest edge: about half of a rod's radius.
    """

    sigma: float = LEAST
    odds: float = 0.0
    scale: float = LEAST


def signal_of(volume: Volume, spacing: tuple[float, float, float], level: float) -> Signal:
    """Return the scale of what a volume shows, and the finest derivative in which noise is weak enough.

    Parameters
    ----------
    volume : Volume
        Grey values.
    spacing : tuple of float
        Voxel size (x, y, z), mm.
    level : float
        Standard deviation of the noise, grey values.
    """
    sigmas = np.linspace(LEAST, MOST, STEPS)
    total = noise = np.zeros(STEPS)
    for values in blocks_of(volume):
        energy, white = gradient_energy(values, spacing, sigmas * min(spacing))
        total, noise = total + energy, noise + white * level**2
    return choose(sigmas, total, noise)


def choose(sigmas: NDArray[np.float64], total: NDArray[np.float64], noise: NDArray[np.float64]) -> Signal:
    """Return the finest of some derivatives in which noise is weak enough, or the last that is not too coarse."""
    if total[0] <= 0.0:
        return Signal()
    signal = np.maximum(total - noise, 1e-3 * total)
    odds = noise / signal
    slope = -np.gradient(np.log(signal), np.log(sigmas))
    steep = np.flatnonzero(slope >= SCALE_SLOPE)
    scale = float(sigmas[steep[0]] if steep.size else sigmas[-1])
    allowed = sigmas <= max(COARSEST * scale, sigmas[0])
    good = np.flatnonzero(allowed & (odds <= MOST_NOISE))
    k = int(good[0]) if good.size else int(np.flatnonzero(allowed)[-1])
    return Signal(float(sigmas[k]), float(odds[k]), scale)


def gradient_energy(
    values: NDArray[np.float64], spacing: tuple[float, float, float], sigmas: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean squared gradient of a block, smoothed with some ``sigmas`` (mm), and that of unit white noise."""
    taper: NDArray[np.float64] = np.ones(())
    for n in values.shape:
        taper = taper[..., None] * np.hanning(n + 2)[1:-1]
    mean = float((values * taper).sum() / taper.sum())
    power = np.abs(np.fft.rfftn((values - mean) * taper)) ** 2 / np.sum(taper**2)
    axes = [np.fft.fftfreq(n, h) for n, h in zip(values.shape[:2], spacing[:0:-1], strict=True)]
    z, y, x = np.meshgrid(*axes, np.fft.rfftfreq(values.shape[2], spacing[0]), indexing="ij", sparse=True)
    wave = (2.0 * np.pi) ** 2 * (z * z + y * y + x * x)
    # of waves in x only those of one sign are there
    weight = wave * np.where((x > 0) & (2 * x * spacing[0] < 1.0), 2.0, 1.0)
    bins = (wave * ((BINS - 1) / wave.max())).astype(np.int64).ravel()
    count = np.maximum(np.bincount(bins, minlength=BINS), 1)
    passed = np.exp(-np.outer(np.square(sigmas), np.bincount(bins, wave.ravel(), BINS) / count))
    energy, white = (np.bincount(bins, part.ravel(), BINS) for part in (weight * power, weight))
    return np.asarray(passed @ energy), np.asarray(passed @ white)
