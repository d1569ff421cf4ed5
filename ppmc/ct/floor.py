"""What noise that is not white does to gradients: a floor below which there is no texture.

A recorder, a reconstruction or a filter blurs noise, and second differences then see next to nothing of it. Its
gradients have no direction all the same, at any place, so the least eigenvalue of their tensor is everywhere a good
part of the trace; wherever there are fibres it is next to nothing somewhere. A low percentile of least eigenvalues is
therefore a measure of noise, whatever its spectrum.
"""

from __future__ import annotations

import itertools

import numpy as np

from ppmc.ct.block import Box, Floats, Reference, TensorStream
from ppmc.ct.filters import WINDOW_CUT, gaussian
from ppmc.ct.settings import Settings
from ppmc.ct.signal import LEAST
from ppmc.ct.source import Volume

SIDE, APART = 24, 3
"""Voxels of a block that is looked at along each axis, and the distance of those of which tensors are made."""
WINDOW = 2.0
"""Standard deviation of the window, in those of the derivative and of the blur of the noise, squares added."""
GRAIN = 1.2
"""Blur of noise over its scale: the energy of gradients of noise blurred by b falls with s^2 at s = b (2/3)^(1/2)."""
PERCENTILE = 5.0
SHARE = 0.3
"""That percentile of three least eigenvalues, over the mean squared gradient, in noise blurred by as much as the
derivative and by a fifth more; 0.49 in white noise, at most 0.1 in plies of five voxels without noise."""
LEAST_PART = 0.25
"""Part of the mean squared gradient below which the floor is no noise: platelets of a few voxels that mix in a window
leave a tenth."""
CLEARLY = 4.0
"""How much more than white noise the floor must be to count: in white noise it comes out 1.6 times as large, in fine
rods that hardly show through it 2.8 times."""


def gradient_floor(
    volume: Volume, spacing: tuple[float, float, float], chosen: Settings, reference: Reference, scale: float
) -> float:
    """Return the mean squared gradient of noise of whatever spectrum, in units of the reference (squared, per mm^2).

    ``scale`` is how coarse that is which is seen (:attr:`ppmc.ct.signal.Signal.scale`), voxels of the smallest edge:
    the window grows with it, so that it holds as many grains of coarse noise as of fine noise.
    """
    grain = (GRAIN * scale if scale > LEAST else 0.0) * min(spacing)
    x, y, z = (
        gaussian(WINDOW * float(np.hypot(s, grain)) / h, WINDOW_CUT) for s, h in zip(chosen.sigma, spacing, strict=True)
    )
    found = []
    for box in _boxes(volume.shape):
        stream = TensorStream(volume, chosen, reference, box, (x, y, z), stride=(APART,) * 3)
        planes, rows, voxels = stream.counts
        out = np.empty((planes, stream.channels, rows, stream.pitch), np.float32)
        for plane in range(planes):
            stream.planes(plane, plane + 1, out.reshape(-1), plane)
        found.append(np.moveaxis(out[:, :6, :, :voxels], 1, 0).reshape(6, -1))
    tensors = np.concatenate(found, axis=1)
    tensors = tensors[:, tensors[:3].sum(axis=0) > 0]
    if tensors.shape[1] == 0:
        return 0.0
    full = tensors[[[0, 3, 5], [3, 1, 4], [5, 4, 2]]].transpose(2, 0, 1).astype(np.float64)
    floor = 3.0 * float(np.percentile(np.linalg.eigvalsh(full)[:, 0], PERCENTILE)) / SHARE
    return floor if floor > LEAST_PART * float(tensors[:3].sum(axis=0).mean()) else 0.0


def raised(noise: Floats, floor: float) -> Floats:
    """Return the tensor of the noise, scaled up to the floor if that is clearly higher."""
    trace = float(noise[:3].sum())
    if trace <= 0.0 or floor <= CLEARLY * trace:
        return noise
    return noise * np.float32(floor / trace)


def _boxes(shape: tuple[int, int, int]) -> list[Box]:
    """Return eight boxes about the middles of a volume's octants, one along axes that have no room for two."""
    starts = []
    for n in shape:
        side = min(SIDE, n)
        starts.append(sorted({max(n // 4 - side // 2, 0), min(3 * n // 4 - side // 2, n - side)}))
    sides = [min(SIDE, n) for n in shape]
    return [((z, z + sides[0]), (y, y + sides[1]), (x, x + sides[2])) for z, y, x in itertools.product(*starts)]
