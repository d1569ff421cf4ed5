"""Tensors of a box of voxels, averaged in the planes of their platelets (see :mod:`ppmc.ct.steer`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.block import EMPTY, Box, Coarse, Floats, Reference, TensorStream
from ppmc.ct.eigen import CHUNK, scratch
from ppmc.ct.layout import reused, row_pitch
from ppmc.ct.settings import Settings
from ppmc.ct.source import Volume
from ppmc.ct.steer import BUFFERS, NOWHERE, offset_pairs, steer_planes

TURN = 8
"""Planes at a time: fewer keep less in memory, more share what their small windows have in common."""


class SteeredStream:
    """Steered tensors of a box of voxels, asked for plane by plane, as of a :class:`~ppmc.ct.block.TensorStream`.

    Attributes
    ----------
    counts : tuple of int (z, y, x)
        Number of tensors.
    channels, pitch : int
        Channels, tensor first, and the floats of a row: rows are padded.
    """

    def __init__(
        self,
        volume: Volume,
        spacing: tuple[float, float, float],
        chosen: Settings,
        reference: Reference,
        box: Box,
        coarse: Coarse,
        *,
        noise: Floats | None = None,
        halo: int = 0,
        step: int = 1,
        final: bool = True,
    ) -> None:
        """Prepare the sums that the windows are made of.

        Parameters
        ----------
        volume, spacing, chosen, reference
            Grey values, voxel size (x, y, z) in mm, filters, and unit of the grey values.
        box : three pairs of int (z, y, x)
            First voxel and end; may lie outside the volume, where there are no tensors.
        coarse : Coarse
            Tensors of the large window around the box, whose normals steer.
        noise : ndarray, shape (6,), optional
            Tensor to subtract.
        halo, step : int
            Only voxels at most ``halo`` from every ``step``-th, from the ``halo``-th on, are wanted.
        final : bool
            The wide window, averaged; else the small one that it is made of, as sums with votes as a seventh channel.
        """
        assert chosen.steering is not None
        self._steps, self._form = offset_pairs(
            chosen.steering.reaches[final], chosen.steering.across, spacing, sparse=final
        )
        self._reach = chosen.steering.voxels[final]
        (z0, z1), (y0, y1), (x0, x1) = box
        x, y, z = self._reach
        wide = ((z0 - z, z1 + z), (y0 - y, y1 + y), (x0 - x, x1 + x))
        self._stream: TensorStream | SteeredStream
        if final:
            self._stream = SteeredStream(volume, spacing, chosen, reference, wide, coarse, final=False)
        else:
            self._stream = TensorStream(volume, chosen, reference, wide, chosen.window, averaged=False, batch=TURN)
        self.channels = 6 if final else 7
        self.counts = (z1 - z0, y1 - y0, x1 - x0)
        self.pitch = row_pitch(x1 - x0, 1)
        self._box, self._coarse = box, coarse
        self._noise = np.zeros(7, np.float32)
        if noise is not None:
            self._noise[:6] = noise
        inside = [(np.arange(a, b) >= 0) & (np.arange(a, b) < n) for (a, b), n in zip(box, volume.shape, strict=True)]
        self._planes, self._rows = (
            (here & _near(len(here), halo, step)).astype(np.uint8) for here in (inside[0], inside[1])
        )
        voxels = np.flatnonzero(inside[2])
        self._voxels = (int(voxels[0]), int(voxels[-1]) + 1) if voxels.size else (0, 0)
        self._slots = TURN + 2 * z
        # Kernels read a whole chunk where a row ends.
        self._ring = reused("wide sums" if final else "sums", self._slots * self._stream.size + 2 * CHUNK + 2 * x)
        self._chosen = np.empty(len(self._steps) + 1, np.int64)
        self._buffers = scratch(*BUFFERS)
        self._unit = np.float32(1.0 / min(spacing) ** 2)
        self._pushed = 0

    @property
    def size(self) -> int:
        """Floats of a plane: channels, rows, voxels of a row."""
        return self.counts[1] * self.channels * self.pitch

    def planes(self, first: int, last: int, out: Floats, at: int = 0, scores: Floats = EMPTY) -> None:
        """Write planes first .. last - 1 into ``out`` (planes, channels, rows, pitch), from its plane ``at`` on.

        ``first`` must not be before the ``last`` of the call before. Least eigenvalues go to ``scores`` (planes, rows,
        pitch), unless that is empty.
        """
        z = self._box[0][0]
        lower, share, near = self._coarse.at(((z + first, z + last), self._box[1], self._box[2]), 1)
        out[at * self.size : (at + last - first) * self.size] = 0.0
        if scores.size:
            rows = self.counts[1] * self.pitch
            scores[at * rows : (at + last - first) * rows] = NOWHERE
        reach = self._reach[2]
        size = self._stream.size
        for begin in range(first, last, TURN):
            end = min(begin + TURN, last)
            self._fill(begin, end + 2 * reach)
            where: NDArray[np.int64] = np.arange(begin, end + 2 * reach) % self._slots * size
            steer_planes(
                self._ring, where, (self._stream.counts[1], self._stream.pitch), self._steps, self._form,
                self._reach, near.reshape(-1), (near.shape[0], near.shape[1], near.shape[3]), lower, share,
                self._planes[first:last], self._rows, self._voxels, self._noise, self._unit, out, self.channels,
                self.pitch, begin - first, end - first, at + begin - first, scores, self._chosen, self._buffers,
            )  # fmt: skip

    def _fill(self, first: int, last: int) -> None:
        """Have the sums of planes first .. last - 1 in the ring."""
        begin = max(self._pushed, first)
        while begin < last:
            slot = begin % self._slots
            end = min(last, begin + TURN, begin + self._slots - slot)
            self._stream.planes(begin, end, self._ring, slot)
            begin = end
        self._pushed = last


def _near(count: int, halo: int, step: int) -> NDArray[np.bool_]:
    """Return whether each of some voxels is at most ``halo`` from every ``step``-th, from the ``halo``-th on."""
    away = (np.arange(count) - halo) % step
    return np.minimum(away, step - away) <= halo
