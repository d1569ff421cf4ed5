"""Advice on sigma and windows from the volume itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.noise import noise_level
from ppmc.ct.source import Volume

SIDE = 64
BLOCKS = 3
SIGMA_PER_WAVELENGTH = 0.2
"""Best standard deviation of the derivative, in wavelengths of the texture."""
LEAST_SIGMA = 0.7


@dataclass(frozen=True)
class Advice:
    """What the volume suggests; lengths in mm.

    Attributes
    ----------
    wavelength : float
        Typical wavelength of the texture.
    signal_to_noise : float
        Standard deviation of the texture over that of the noise.
    noise_level : float
        Standard deviation of the noise, grey values.
    sigma : float
        Standard deviation of the derivative.
    fibre_window
        Window for p (x, y, z); None where the platelet thickness is known, for it then follows the platelets' plane.
    normal_window
        Window for r.
    """

    wavelength: float
    signal_to_noise: float
    noise_level: float
    sigma: float
    fibre_window: tuple[float, float, float] | None
    normal_window: float

    def lines(self) -> list[str]:
        """Return the advice as text: what was measured, then a section for the scene."""
        window = []
        if self.fibre_window is not None:
            window = [f"  fibre_window: [{', '.join(f'{w:.4g} mm' for w in self.fibre_window)}]"]
        return [
            f"# texture: wavelength {self.wavelength:.3g} mm, {self.signal_to_noise:.3g} times stronger than the noise",
            "ct:",
            f"  sigma: {self.sigma:.4g} mm",
            *window,
            f"  normal_window: {self.normal_window:.4g} mm",
            f"  noise_level: {self.noise_level:.4g}",
        ]


def texture_spectrum(volume: Volume, spacing: tuple[float, float, float]) -> tuple[float, float]:
    """Return the texture's typical wavelength (mm) and its variance (grey^2), noise taken off.

    The wavelength is that of the mean wave number, weighted by power above the white noise floor, of small blocks
    spread over the volume; slopes of the whole block (wavelengths beyond half of it) are left out.
    """
    level = noise_level(volume)
    starts = [np.unique(np.linspace(0, max(n - SIDE, 0), BLOCKS).astype(int)) for n in volume.shape]
    weight = moment = variance = 0.0
    count = 0
    for z in starts[0]:
        for y in starts[1]:
            for x in starts[2]:
                box = tuple(slice(int(a), min(int(a) + SIDE, n)) for a, n in zip((z, y, x), volume.shape, strict=True))
                power, wave = _power(volume.grey(box), spacing)  # type: ignore[arg-type]
                edge = 2.0 * min(h * n for h, n in zip(spacing[::-1], power.shape, strict=True)) / 4.0
                above = np.where((wave > 1.0 / edge) & (power > 3.0 * level**2), power - level**2, 0.0)
                weight += float(above.sum())
                moment += float((above * wave).sum())
                variance += float(above.sum()) / power.size
                count += 1
    if weight == 0.0:
        return 5.0 * max(spacing), 0.0
    return weight / moment, variance / count


def _power(grey: NDArray[np.float32], spacing: tuple[float, float, float]) -> tuple[NDArray, NDArray]:
    """Return power and wave number (1/mm) of a block, scaled so that white noise has its variance everywhere."""
    taper: NDArray[np.float64] = np.ones(())
    for n in grey.shape:
        taper = taper[..., None] * np.hanning(n + 2)[1:-1]
    values = (grey - grey.mean()) * taper
    power = np.abs(np.fft.fftn(values)) ** 2 / np.sum(taper**2)
    parts = np.meshgrid(
        *(np.fft.fftfreq(n, h) for n, h in zip(grey.shape, spacing[::-1], strict=True)), indexing="ij", sparse=True
    )
    return power, np.sqrt(sum(f * f for f in parts))


def advise(volume: Volume, spacing: tuple[float, float, float], thickness: float | None) -> Advice:
    """Return advice for a volume.

    Parameters
    ----------
    volume : Volume
        Grey values.
    spacing : tuple of float
        Voxel size (x, y, z), mm.
    thickness : float or None
        Platelet thickness, mm, if known.
    """
    wavelength, variance = texture_spectrum(volume, spacing)
    level = noise_level(volume)
    sigma = max(SIGMA_PER_WAVELENGTH * wavelength, LEAST_SIGMA * max(spacing))
    fibre = None
    if thickness is None:
        fibre = (2.0 * sigma,) * 3
        normal = 8.0 * sigma
    else:
        sigma = min(sigma, max(thickness / 4.0, LEAST_SIGMA * max(spacing)))
        normal = max(8.0 * min(spacing), 1.3 * thickness)
    extent = min(h * n for h, n in zip(spacing, volume.shape[::-1], strict=True))
    ratio = float(np.sqrt(variance) / level) if level > 0 else float("inf")
    return Advice(wavelength, ratio, level, sigma, fibre, min(normal, extent / 4.0))
