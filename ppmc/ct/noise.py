"""What noise alone does to the structure tensor, and how far it can turn p.

White noise of variance s^2 adds to the tensor a diagonal whose entries follow from the filters' taps. On cubic voxels
they are equal and turn nothing; where voxels are longer along one axis they differ and tilt p, so their difference is
taken off. The expected error of p follows from the eigenvalues by first-order perturbation: the part of each gradient
along p, of variance l1, meets parts l2 and l3 across it, averaged over as many independent samples as the window holds.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.source import Volume

if TYPE_CHECKING:
    from ppmc.ct.settings import Settings

Floats = NDArray[np.float32]

SIDE = 32
BLOCKS = 3
SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0]) / np.sqrt(6.0)
LEFT_OUT = 1.25
"""Errors of p over those of the first order: windows that count most because they see little disturbance have less of
it than they should by chance, and neighbours' gradients are no independent samples."""
MEDIAN_OF_NORMAL = 0.67449


def noise_level(volume: Volume) -> float:
    """Return the standard deviation of the grey values' white noise, from small blocks spread over the volume.

    Second differences along all three axes leave white noise its variance and take out whatever is smooth along any
    one of them, as fibres are; the median of their size ignores the few voxels at edges of voids.
    """
    found = []
    for block in blocks_of(volume):
        values = block
        for axis in range(3):
            n = values.shape[axis]
            if n < 3:
                return 0.0
            low, mid, high = (np.take(values, range(k, n - 2 + k), axis=axis) for k in range(3))
            values = SECOND_DIFFERENCE[0] * (low + high) + SECOND_DIFFERENCE[1] * mid
        found.append(np.median(np.abs(values)) / MEDIAN_OF_NORMAL)
    return float(np.median(found)) if found else 0.0


def blocks_of(volume: Volume) -> Iterator[NDArray[np.float64]]:
    """Yield small blocks of grey values spread over the volume, those with voxels without data left out."""
    starts = [np.unique(np.linspace(0, max(n - SIDE, 0), BLOCKS).astype(int)) for n in volume.shape]
    for z, y, x in itertools.product(*starts):
        box = tuple(slice(int(a), min(int(a) + SIDE, n)) for a, n in zip((z, y, x), volume.shape, strict=True))
        if volume.leave_out and volume.without_data(volume.read(box)) is not None:  # type: ignore[arg-type]
            continue
        yield volume.grey(box).astype(np.float64)  # type: ignore[arg-type]


def noise_tensor(chosen: Settings, level: float) -> Floats:
    """Return the tensor (6,) that white noise of standard deviation ``level`` gives on average."""
    smooth = [float(np.sum(np.square(t, dtype=np.float64))) for t in chosen.smooth]
    slope = [float(np.sum(np.square(t, dtype=np.float64))) for t in chosen.slope]
    diagonal = [
        slope[0] * smooth[1] * smooth[2],
        smooth[0] * slope[1] * smooth[2],
        smooth[0] * smooth[1] * slope[2],
    ]
    return (level**2 * np.array([*diagonal, 0.0, 0.0, 0.0])).astype(np.float32)


def tilting_part(tensor: Floats) -> Floats:
    """Return a diagonal tensor less its smallest entry: the part that turns eigenvectors."""
    out = tensor.copy()
    out[:3] -= out[:3].min()
    return out


def independent_samples(chosen: Settings) -> Floats:
    """Return how many independent products of gradients the window for p averages.

    For p along x the number is ``n[0] * (1 + n[1])``, likewise y and z; in between ``n[0] * (1 + sum n[i + 1] p_i^2)``.
    Across p both factors decorrelate like noise smoothed by sigma; along p the texture stays the same, while the
    slope of noise alternates and its mean over a window rho falls with (1 + rho^2 / sigma^2)^(3/2). In a window that
    follows the platelet p is always along it.
    """
    ratio = np.square(np.array(chosen.fibre_window) / chosen.sigma)
    across = np.sqrt(1.0 + 2.0 * ratio)
    gain = (1.0 + ratio) ** 1.5 / across - 1.0
    if chosen.steering is not None or chosen.follow:
        gain[:] = gain[0]
    return np.array([np.prod(across) / LEFT_OUT**2, *gain], np.float32)
