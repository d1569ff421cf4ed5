"""Advice from the volume itself: what it bears, and how thick platelets seem to be."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.block import Box
from ppmc.ct.noise import noise_level
from ppmc.ct.orientations import Job, cells_of, compute_tiles
from ppmc.ct.signal import Signal
from ppmc.ct.source import Volume
from ppmc.ct.thickness import PROVEN, Thickness, thickness_of

SIDE = 64
BLOCKS = 3
ABOVE = 2.0
"""Standard deviations by which power averaged over a shell of wave numbers must exceed the noise to be signal."""
SHELLS = 48
LOOKED_AT = 96
"""Voxels along each axis of the block in the middle of the volume in which platelets are looked for."""


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
    thickness : Thickness
        Platelets that are seen.
    known : bool
        Whether the platelet thickness was given.
    white : bool
        Whether the noise is white, or nearly: else its level says little.
    """

    wavelength: float
    signal_to_noise: float
    noise_level: float
    sigma: float
    thickness: Thickness
    known: bool
    white: bool

    def lines(self) -> list[str]:
        """Return the advice as text: what was measured, then a section for the scene.

        What is left out of the section is as good as can be told: it follows from the volume by itself.
        """
        seen = self.thickness
        proven = seen.confidence >= PROVEN
        told = "# platelets: none are seen; give platelet_thickness only where there are platelets"
        if seen.value > 0 and proven:
            told = f"# platelets: about {seen.value:.2g} mm thick (confidence {seen.confidence:.2f}, of at most 1)"
        elif seen.value > 0:
            told = (
                f"# platelets: p lasts {seen.value:.2g} mm along r, but hardly longer in the plane "
                f"(confidence {seen.confidence:.2f}): rather single fibres"
            )
        return [
            f"# texture: wavelength {self.wavelength:.3g} mm, {self.signal_to_noise:.3g} times stronger than the noise",
            told,
            *([] if self.white else ["# noise: not white; its gradients are measured, which no noise_level replaces"]),
            "ct:",
            *([f"  platelet_thickness: {seen.value:.2g} mm"] if proven and not self.known else []),
            *([] if proven or self.known else [f"  sigma: {self.sigma:.4g} mm"]),
            *([f"  noise_level: {self.noise_level:.4g}"] if self.white else []),
        ]


def texture_spectrum(volume: Volume, spacing: tuple[float, float, float]) -> tuple[float, float]:
    """Return the texture's typical wavelength (mm) and its variance (grey^2), noise taken off.

    Power is averaged over shells of wave numbers, of small blocks spread over the volume, and so is the noise floor
    reached to within a few per cent; the wavelength is that of the mean wave number, weighted by power above it. Slopes
    of whole blocks (wavelengths beyond half of them) are left out.
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
                shell = np.minimum((wave * (SHELLS / wave.max())).astype(int), SHELLS - 1).ravel()
                voxels = np.bincount(shell, minlength=SHELLS)
                mean = np.bincount(shell, power.ravel(), SHELLS) / np.maximum(voxels, 1)
                middle = np.bincount(shell, wave.ravel(), SHELLS) / np.maximum(voxels, 1)
                # power of noise in one wave scatters by as much as its mean; half of the waves are the others' mirror
                least = level**2 * (1.0 + ABOVE * np.sqrt(2.0 / np.maximum(voxels, 1)))
                above = np.where((middle > 1.0 / edge) & (mean > least), voxels * (mean - level**2), 0.0)
                weight += float(above.sum())
                moment += float((above * middle).sum())
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


def advise(job: Job, signal: Signal, level: float, *, known: bool, white: bool) -> Advice:
    """Return advice for a volume.

    Parameters
    ----------
    job : Job
        What a run would do by itself: advice is never other than that, but for platelets that are proven.
    signal : Signal
        What the volume bears.
    level : float
        Standard deviation of the noise, grey values.
    known : bool
        Whether the platelet thickness was given.
    white : bool
        Whether the noise is white.
    """
    wavelength, variance = texture_spectrum(job.volume, job.spacing)
    ratio = float(np.sqrt(variance) / level) if level > 0 else float("inf")
    sigma = job.chosen.sigma[0]
    return Advice(wavelength, ratio, level, sigma, _platelets(job), known, white)


def _platelets(job: Job) -> Thickness:
    """Return the platelet thickness that a block in the middle of the volume shows."""
    job = replace(job, stride=1)
    if job.chosen.normal_window is None:
        return Thickness()
    sides = [min(n, LOOKED_AT) for n in job.shape]
    z, y, x = (((n - m) // 2, (n - m) // 2 + m) for n, m in zip(job.shape, sides, strict=True))
    box: Box = (z, y, x)
    with ThreadPoolExecutor(1) as pool:
        block = next(compute_tiles(job, cells_of(job), [box], pool, 1))
        return thickness_of(block.fields, job.spacing)
