"""Fibre streaks: a random field over a platelet's cross-section, constant along its fibres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STEPS_PER_WAVELENGTH = 20
SIZE = 512


def streak_table(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a periodic isotropic random field of unit variance and wavelengths about ``STEPS_PER_WAVELENGTH`` cells.

    Waves between 0.7 and 2 times that length have equal power, others none: streaks of bundles, neither a single
    grating nor white noise. Shape (SIZE, SIZE).
    """
    spectrum = np.fft.rfft2(rng.standard_normal((SIZE, SIZE)))
    wave = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None, :]) * STEPS_PER_WAVELENGTH
    table = np.fft.irfft2(np.where((wave > 0.5) & (wave < 1.0 / 0.7), spectrum, 0.0), (SIZE, SIZE))
    return np.asarray((table - table.mean()) / table.std(), np.float32)
