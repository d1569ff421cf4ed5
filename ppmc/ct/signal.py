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
LEAST_SIGNAL = 0.4
"""Share of the signal's energy at the finest derivative that must be left: beyond that details as fine as the rods
themselves are smoothed away, and neighbours mix."""
LEAST, MOST, STEPS = 1.0, 2.5, 13
"""Standard deviations of the derivatives that are considered, voxels, and their number."""


@dataclass(frozen=True)
class Signal:
    """What a volume bears.

    Attributes
    ----------
    sigma : float
        Finest standard deviation of the derivative that sees enough signal, voxels of the smallest edge.
    odds : float
        Energy of noise in its gradients over that of the signal.
    """

    sigma: float = LEAST
    odds: float = 0.0


def signal_of(volume: Volume, spacing: tuple[float, float, float], level: float) -> Signal:
    """Return the finest derivative in whose gradients noise of a standard deviation ``level`` is weak enough.

    Parameters
    ----------
    volume : Volume
        Grey values.
    spacing : tuple of float
        Voxel size (x, y, z), mm.
    level : float
        Standard deviation of the noise, grey values.
    """
    if level <= 0.0:
        return Signal()
    sigmas = np.linspace(LEAST, MOST, STEPS)
    total = noise = np.zeros(STEPS)
    for values in blocks_of(volume):
        energy, white = gradient_energy(values, spacing, sigmas * min(spacing))
        total, noise = total + energy, noise + white * level**2
    return choose(sigmas, total, noise)


def choose(sigmas: NDArray[np.float64], total: NDArray[np.float64], noise: NDArray[np.float64]) -> Signal:
    """Return the finest of some derivatives in which noise is weak enough, or the last that leaves enough signal."""
    signal = np.maximum(total - noise, 1e-3 * noise + 1e-30)
    odds = noise / signal
    enough = (odds <= MOST_NOISE) | (np.append(signal[1:], 0.0) < LEAST_SIGNAL * signal[0])
    k = int(np.argmax(enough))
    return Signal(float(sigmas[k]), float(odds[k]))


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
    passed = [weight * np.exp(-(s**2) * wave) for s in sigmas]
    return np.array([(p * power).sum() for p in passed]), np.array([p.sum() for p in passed])
