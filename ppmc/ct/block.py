"""One block of a volume: which voxels it must read, and the tensors and orientations of the voxels it owns.

All axes triples here are (z, y, x), as arrays are.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.layout import laid_out, mirrored
from ppmc.ct.settings import Settings
from ppmc.ct.source import Volume
from ppmc.ct.tensor import tensor_block

Floats = NDArray[np.float32]
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
Slices = tuple[slice, slice, slice]

EDGE_VOTE = 1e-3
"""Weight of gradients so near the volume's edge that they were made with mirrored grey values."""
EMPTY = np.empty(0, np.float32)
_OWN = threading.local()
NO_COARSE = np.empty((0, 0, 6, 0), np.float32)


@dataclass(frozen=True)
class Reference:
    """Grey value taken as zero, and as one: tensors are computed in these units, so that float32 is enough."""

    middle: float
    unit: float


@dataclass(frozen=True)
class Coarse:
    """Tensors of the large window on the coarse grid.

    Attributes
    ----------
    tensors : (cz, cy, 6, cx) float32
    start, step : (3,) ints (z, y, x)
        Voxel at the centre of the first cell, and voxels per cell.
    """

    tensors: Floats
    start: tuple[int, int, int]
    step: tuple[int, int, int]


def edge_votes(n: int, margin: int, first: int, last: int) -> Floats:
    """Return the votes of voxels first..last-1 along an axis of n voxels: 0 outside, little near the edge, else 1."""
    i = np.arange(first, last)
    inside = np.minimum(i, n - 1 - i)
    margin = min(margin, (n - 1) // 2)
    return np.where(inside < 0, 0.0, np.where(inside < margin, EDGE_VOTE, 1.0)).astype(np.float32)


def read_padded(volume: Volume, box: Box, reference: Reference) -> Floats:
    """Read a box that may reach beyond the volume, mirrored there, in units of the reference."""
    inner, maps = _mirrored_box(volume, box)
    return volume.grey(inner, reference.middle, reference.unit)[np.ix_(*maps)]


def _mirrored_box(volume: Volume, box: Box) -> tuple[Slices, tuple[NDArray[np.uint64], ...]]:
    """Return the part of the volume that a box and its mirror images need, and the indices into that part."""
    maps = [mirrored(a, b, n) for (a, b), n in zip(box, volume.shape, strict=True)]
    first = [int(m.min()) for m in maps]
    z, y, x = (slice(f, int(m.max()) + 1) for f, m in zip(first, maps, strict=True))
    return (z, y, x), tuple(m - np.uint64(f) for f, m in zip(first, maps, strict=True))


def window_tensors(
    volume: Volume,
    chosen: Settings,
    reference: Reference,
    ranges: Box,
    window: tuple[Floats, Floats, Floats],
    *,
    stride: tuple[int, int, int] = (1, 1, 1),
    averaged: bool = True,
    noise: Floats | None = None,
) -> Floats:
    """Return windowed tensors at voxels first, first + stride, ... below last along each axis.

    Parameters
    ----------
    volume : Volume
        Grey values, and the mask if there is one.
    chosen : Settings
        Derivative filters.
    reference : Reference
        Unit of the grey values.
    ranges : three pairs of int (z, y, x)
        First voxel and end; may lie outside the volume.
    window : three arrays (x, y, z)
        Taps.
    stride : tuple of int (z, y, x)
        Distance of the voxels.
    averaged : bool
        Divide by the window's votes; else return the sums, and the votes as a seventh channel.
    noise : ndarray, shape (6,), optional
        Tensor to subtract from averages.

    Returns
    -------
    ndarray, shape (oz, oy, 6 or 7, ox)
        A seventh channel holds the windowed votes where there is a mask. The memory is used again by the next call
        in the same thread: fresh memory for each tile would cost as much time as a tenth of the arithmetic.
    """
    counts = tuple((b - a + s - 1) // s for (a, b), s in zip(ranges, stride, strict=True))
    reach = [len(t) // 2 for t in window[::-1]]
    spans = tuple(
        (a - r, a + (n - 1) * s + 1 + r) for (a, _), n, s, r in zip(ranges, counts, stride, reach, strict=True)
    )
    gradient = chosen.gradient_radius[::-1]
    box = tuple((a - g, b + g) for (a, b), g in zip(spans, gradient, strict=True))
    margins = tuple(-(-g // 2) for g in gradient)
    masked = volume.read_mask is not None or not averaged
    rest = (box[1][1] - box[1][0], box[2][1] - box[2][0])
    plane = np.ones([b - a for a, b in spans[1:]], np.float32)
    vote_z = np.ones(spans[0][1] - spans[0][0], np.float32)
    inverse = tuple(np.ones(n if averaged else 0, np.float32) for n in counts)[::-1]
    if volume.read_mask is not None:
        grey = read_padded(volume, box, reference)  # type: ignore[arg-type]
        votes = _in_phases(_mask_votes(volume, grey, box, gradient, margins), stride[2], rest)  # type: ignore[arg-type]
        flat = _in_phases(grey, stride[2], rest)
    else:
        flat = _read_laid_out(volume, box, reference, stride[2])  # type: ignore[arg-type]
        vote = [edge_votes(n, m, *s) for n, m, s in zip(volume.shape, margins, spans, strict=True)]
        vote_z, plane = vote[0], vote[1][:, None] * vote[2][None, :]
        votes = EMPTY
        if masked:
            votes = _in_phases(np.ones((len(vote_z), 1, 1), np.float32) * plane, stride[2], rest)
        else:
            inverse = tuple(
                _inverse(t, v, n, s) for t, v, n, s in zip(window, vote[::-1], counts[::-1], stride[::-1], strict=True)
            )
    shape = (counts[0], counts[1], 7 if masked else 6, counts[2])
    out = _reused(int(np.prod(shape)))
    tensor_block(
        flat, rest[0], chosen.smooth, chosen.slope, window, _in_phases(plane[None], stride[2], rest), vote_z, votes,
        inverse, np.zeros(6, np.float32) if noise is None else noise, stride[::-1], shape, out,
    )  # fmt: skip
    return out.reshape(shape)


def _reused(size: int) -> Floats:
    """Return an array of this thread's own whose memory the next call gets again."""
    kept: Floats | None = getattr(_OWN, "floats", None)
    if kept is None or kept.size < size:
        kept = np.empty(size, np.float32)
        _OWN.floats = kept
    return kept[:size]


def _in_phases(planes: Floats, phases: int, shape: tuple[int, int]) -> Floats:
    """Return planes (n, ny, nx) padded to ``shape`` and stored flat as (n, phase of x, y, x) (see the kernel)."""
    n, ny, nx = planes.shape
    length = -(-shape[1] // phases)
    if phases == 1 and (ny, nx) == shape:
        return planes.ravel()
    padded = np.zeros((n, shape[0], length * phases), np.float32)
    padded[:, :ny, :nx] = planes
    parts = padded.reshape(n, shape[0], length, phases)
    return np.ascontiguousarray(parts.transpose(0, 3, 1, 2)).ravel()


def _read_laid_out(volume: Volume, box: Box, reference: Reference, phases: int) -> Floats:
    """Read a box that may reach beyond the volume, mirrored there, as the kernel wants it."""
    inner, maps = _mirrored_box(volume, box)
    flat, bad = laid_out(volume.read(inner), maps, reference.middle, reference.unit, phases)
    if bad:
        volume.grey(inner)  # says which voxel is not a number
    return flat


def _inverse(taps: Floats, vote: Floats, count: int, stride: int) -> Floats:
    """Return one over the windowed votes along an axis, zero where nobody votes."""
    total = np.array([taps @ vote[i * stride : i * stride + len(taps)] for i in range(count)], np.float32)
    return np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)


def _mask_votes(
    volume: Volume, grey: Floats, box: Box, gradient: tuple[int, int, int], margins: tuple[int, int, int]
) -> Floats:
    """Return votes inside the specimen, little ones near its surface, and set the grey values outside to zero.

    Zero is the mean grey value, so that what is left of the step to the air is no larger than the texture.
    """
    from scipy.ndimage import minimum_filter1d

    inner, maps = _mirrored_box(volume, box)
    assert volume.read_mask is not None
    mask = (volume.read_mask(inner) != 0).astype(np.float32)[np.ix_(*maps)]
    grey *= mask
    for axis, ((a, b), n) in enumerate(zip(box, volume.shape, strict=True)):
        outside = np.flatnonzero((np.arange(a, b) < 0) | (np.arange(a, b) >= n))
        mask[(slice(None),) * axis + (outside,)] = 0.0
    core = mask
    for axis, margin in enumerate(margins):
        core = minimum_filter1d(core, 2 * margin + 1, axis=axis, mode="nearest")
    part = tuple(slice(g, n - g) for g, n in zip(gradient, mask.shape, strict=True))
    return np.ascontiguousarray(np.where(core[part] > 0, mask[part], np.float32(EDGE_VOTE) * mask[part]))
