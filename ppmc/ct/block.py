"""One block of a volume: which voxels it must read, and the tensors and orientations of the voxels it owns.

All axes triples here are (z, y, x), as arrays are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.layout import laid_out, mirrored, reused, row_pitch
from ppmc.ct.passes import pairs_of, stretches, weights
from ppmc.ct.settings import Settings
from ppmc.ct.source import Volume
from ppmc.ct.tensor import band_rows, pull_planes, push_planes, slot_size, sweeps, work_sizes

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
Slices = tuple[slice, slice, slice]

EDGE_VOTE = 1e-3
"""Weight of gradients so near the volume's edge that they were made with mirrored grey values."""
EMPTY = np.empty(0, np.float32)


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

    def at(self, box: Box, stride: int) -> tuple[tuple[Ints, Ints], tuple[Floats, Floats], Floats]:
        """Return what output voxels of a box (indices z, y, x; every ``stride``-th voxel) interpolate between.

        Returns
        -------
        lower, share : arrays (z, y)
            The coarse plane and row below each output voxel, and the share of the one above.
        tensors : ndarray, shape (planes, cy, 6, ox)
            Those coarse planes, interpolated along x.
        """
        places = [
            _between(np.arange(a, b) * stride, start, cell, count)
            for (a, b), start, cell, count in zip(
                box, self.start, self.step, (self.tensors.shape[i] for i in (0, 1, 3)), strict=True
            )
        ]
        (z, share_z), (y, share_y), (x, share_x) = places
        planes = self.tensors[z[0] : z[-1] + 2]
        low = planes[..., x]
        high = planes[..., np.minimum(x + 1, planes.shape[3] - 1)]
        return (z - z[0], y), (share_z, share_y), (1 - share_x) * low + share_x * high


def _between(voxels: Ints, start: int, cell: int, cells: int) -> tuple[Ints, Floats]:
    """Return the cell below each voxel, and the share of the one above.

    All from integers, so that a position does not depend on where a block begins.
    """
    beyond = np.maximum(voxels - start, 0)
    inside = beyond // cell < cells - 1
    lower = np.where(inside, beyond // cell, max(cells - 2, 0))
    share = np.where(inside, (beyond % cell).astype(np.float32) / np.float32(cell), np.float32(cells > 1))
    return lower.astype(np.int64), share.astype(np.float32)


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


class TensorStream:
    """Windowed tensors of a box of voxels, asked for plane by plane.

    Attributes
    ----------
    counts : tuple of int (z, y, x)
        Number of tensors.
    channels : int
        6; a seventh holds the windowed votes where there is a mask or sums are wanted.
    pitch : int
        Floats of a row: rows are padded.
    """

    def __init__(
        self,
        volume: Volume,
        chosen: Settings,
        reference: Reference,
        ranges: Box,
        window: tuple[Floats, Floats, Floats],
        *,
        stride: tuple[int, int, int] = (1, 1, 1),
        averaged: bool = True,
        noise: Floats | None = None,
        batch: int = 1,
    ) -> None:
        """Read the grey values of a box and prepare its filters.

        Parameters
        ----------
        volume : Volume
            Grey values, and the mask if there is one.
        chosen : Settings
            Derivative filters.
        reference : Reference
            Unit of the grey values.
        ranges : three pairs of int (z, y, x)
            First voxel and end; may lie outside the volume. Tensors are at first, first + stride, ... below the end.
        window : three arrays (x, y, z)
            Taps.
        stride : tuple of int (z, y, x)
            Distance of the voxels.
        averaged : bool
            Divide by the window's votes; else return the sums, and the votes as a seventh channel.
        noise : ndarray, shape (6,), optional
            Tensor to subtract from averages.
        batch : int
            Most planes that will be asked for at once.
        """
        counts = tuple((b - a + s - 1) // s for (a, b), s in zip(ranges, stride, strict=True))
        self.counts = (counts[0], counts[1], counts[2])
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
        self._vote_z = np.ones(spans[0][1] - spans[0][0], np.float32)
        self._votes = EMPTY
        self.pitch = row_pitch(rest[1], stride[2])
        inverse = [np.ones(n, np.float32) for n in counts]
        if volume.read_mask is not None:
            grey = read_padded(volume, box, reference)  # type: ignore[arg-type]
            votes = _mask_votes(volume, grey, box, gradient, margins)  # type: ignore[arg-type]
            self._votes = _in_phases(votes, stride[2], rest)
            self._grey = _in_phases(grey, stride[2], rest)
        else:
            self._grey = _read_laid_out(volume, box, reference, stride[2])  # type: ignore[arg-type]
            vote = [edge_votes(n, m, *s) for n, m, s in zip(volume.shape, margins, spans, strict=True)]
            self._vote_z, plane = vote[0], vote[1][:, None] * vote[2][None, :]
            if masked:
                self._votes = _in_phases(np.ones((len(vote[0]), 1, 1), np.float32) * plane, stride[2], rest)
            else:
                inverse = [_inverse(t, v, n, s) for t, v, n, s in zip(window[::-1], vote, counts, stride, strict=True)]
        self._vote = _in_phases(plane[None], stride[2], rest)
        self._inverse_z = inverse[0]
        self.channels = 7 if masked else 6
        self._window, self._stride, self._averaged = window, stride, averaged
        self._noise = np.zeros(6, np.float32) if noise is None else noise
        self._inverse = np.zeros((self.channels, counts[1], self.pitch), np.float32)
        self._inverse[:, :, : counts[2]] = inverse[1][:, None] * inverse[2]
        self._shape = (rest[0], self.pitch, counts[1], self.channels, stride[2], stride[1])
        self._taps, self._places = sweeps(chosen.smooth, chosen.slope, window, self._shape)
        half = len(window[2]) // 2
        self._mean_z = weights(window[2], pairs_of(half))
        self._planes_z = stretches(half, pairs_of(half), 1)
        self._slots = (len(window[2]) + (batch - 1) * stride[0], slot_size(self.size))
        self._ring = reused("ring", self._slots[0] * self._slots[1])
        work, band = work_sizes(self._shape, window[0])
        self._work = reused("work", work)
        self._band = reused("band", band)
        self._pushed = 0

    @property
    def size(self) -> int:
        """Floats of a plane: channels, rows, voxels of a row."""
        return self.counts[1] * self.channels * self.pitch

    def planes(self, first: int, last: int, out: Floats, at: int = 0) -> None:
        """Write planes first .. last - 1 into ``out`` (planes, channels, rows, pitch), from its plane ``at`` on.

        ``first`` must not be before the ``last`` of the call before.
        """
        stride_z = self._stride[0]
        begin = max(self._pushed, first * stride_z)
        end = (last - 1) * stride_z + len(self._window[2])
        push_planes(
            begin, end, self._grey, self._shape, len(self._window[1]), band_rows(self._shape[4], self.pitch),
            self._taps, self._places, self._vote, self._vote_z, self._votes, self._ring, self._slots, self._work,
            self._band,
        )  # fmt: skip
        self._pushed = end
        pull_planes(
            first, last, self._ring, self._slots, (self.counts[1], self.channels, self.pitch), stride_z,
            self._mean_z, self._planes_z, np.empty_like(self._planes_z), self._inverse.reshape(-1), self._inverse_z,
            self._averaged, self._noise, out, at,
        )  # fmt: skip


def _in_phases(planes: Floats, phases: int, shape: tuple[int, int]) -> Floats:
    """Return planes (n, ny, nx) padded to ``shape`` and stored flat as (n, phase of x, y, x) (see the kernel)."""
    n, ny, nx = planes.shape
    length = row_pitch(shape[1], phases)
    padded = np.zeros((n, shape[0], length * phases), np.float32)
    padded[:, :ny, :nx] = planes
    parts = padded.reshape(n, shape[0], length, phases)
    return np.ascontiguousarray(parts.transpose(0, 3, 1, 2)).ravel()


def _read_laid_out(volume: Volume, box: Box, reference: Reference, phases: int) -> Floats:
    """Read a box that may reach beyond the volume, mirrored there, as the kernel wants it."""
    inner, maps = _mirrored_box(volume, box)
    flat, _ = laid_out(volume.checked(inner), maps, reference.middle, reference.unit, phases)
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
