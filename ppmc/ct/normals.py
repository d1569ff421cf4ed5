"""Tensors of the large window, from which the platelet normal r is taken.

Gradient products are summed over cells of a few voxels and smoothed on that coarse grid: the same window at a small
part of the cost. Every voxel counts once, so nothing is lost by the coarseness but the finest detail of a window that
is several cells wide.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ppmc.ct.block import Box, Coarse, Floats, Reference, TensorStream
from ppmc.ct.filters import cell_box, gaussian
from ppmc.ct.settings import Settings, coarse_sigma
from ppmc.ct.source import Volume

CHANNELS = 7
SLAB_BYTES = 48 * 2**20
VOXEL_BYTES = 8


def cell_axis(n: int, cell: int) -> tuple[int, int]:
    """Return the first cell's middle voxel and the number of cells that cover an axis of n voxels.

    The cells lie evenly about the middle of the axis, so that a volume turned or mirrored has the same ones; to that
    end cells have an odd width, and one more of them may reach beyond both ends.
    """
    count = (n - 1) // cell + 1
    left = n - 1 - (count - 1) * cell
    if left % 2:
        count, left = count + 1, left - cell
    return left // 2, count


@dataclass
class Cells:
    """Sums of gradient products over the cells of a volume, computed once (see :meth:`fill`) or when asked for.

    Attributes
    ----------
    volume, spacing, chosen, reference
        What to compute from.
    sums : ndarray, shape (cz, cy, 7, cx), or None
        The sums of all cells, the votes last; None to compute each region anew.
    """

    volume: Volume
    spacing: tuple[float, float, float]
    chosen: Settings
    reference: Reference
    sums: Floats | None = None

    def __post_init__(self) -> None:
        self.step = self.chosen.cell[::-1]
        axes = [cell_axis(n, c) for n, c in zip(self.volume.shape, self.step, strict=True)]
        self.start = (axes[0][0], axes[1][0], axes[2][0])
        self.shape = (axes[0][1], axes[1][1], axes[2][1])
        assert self.chosen.normal_window is not None
        self._taps = [
            gaussian(coarse_sigma(w, h, c)).astype(np.float64)
            for w, h, c in zip(self.chosen.normal_window[::-1], self.spacing[::-1], self.step, strict=True)
        ]

    @property
    def nbytes(self) -> int:
        """Memory of all sums."""
        return int(np.prod(self.shape)) * CHANNELS * 4

    def fill(self, pool: Executor, scratch: Path | None) -> None:
        """Compute the sums of all cells, in a file if ``scratch`` names one, else in memory."""
        whole = (self.shape[0], self.shape[1], CHANNELS, self.shape[2])
        if scratch is None:
            self.sums = np.empty(whole, np.float32)
        else:
            # Room is taken first: a disk that fills up under mapped memory ends the process with a signal.
            with scratch.open("wb") as file:
                os.posix_fallocate(file.fileno(), 0, 4 * int(np.prod(whole)))
            self.sums = np.memmap(scratch, np.float32, "r+", shape=whole)
        sums = self.sums

        def work(box: Box) -> None:
            part = tuple(slice(a, b) for a, b in box)
            sums[part[0], part[1], :, part[2]] = self._compute(box)

        for _ in pool.map(work, self._slabs()):
            pass

    def _slabs(self) -> Iterable[Box]:
        """Yield boxes of cells whose voxels take a few tens of MB."""
        cz, cy, cx = self.shape
        wide = cx * self.step[2] * VOXEL_BYTES
        rows = max(1, min(cy, SLAB_BYTES // (wide * self.step[1] * 40)))
        planes = max(1, min(cz, SLAB_BYTES // (wide * self.step[0] * (rows * self.step[1] + 8))))
        for z in range(0, cz, planes):
            for y in range(0, cy, rows):
                yield (z, min(z + planes, cz)), (y, min(y + rows, cy)), (0, cx)

    def _compute(self, box: Box) -> Floats:
        """Return the sums of a box of cells."""
        z, y, x = ((s + a * c, s + (b - 1) * c + 1) for (a, b), s, c in zip(box, self.start, self.step, strict=True))
        windows = (cell_box(self.step[2]), cell_box(self.step[1]), cell_box(self.step[0]))
        stream = TensorStream(
            self.volume, self.chosen, self.reference, (z, y, x), windows, stride=self.step, averaged=False
        )
        planes, rows, cells = stream.counts
        out = np.empty((planes, CHANNELS, rows, stream.pitch), np.float32)
        for plane in range(planes):
            stream.planes(plane, plane + 1, out.reshape(-1), plane)
        return out[..., :cells].transpose(0, 2, 1, 3)

    def around(self, voxels: Box) -> Coarse:
        """Return smoothed tensors on the cells around a box of voxels, enough to interpolate in it."""
        from scipy.ndimage import correlate1d

        inner = []
        outer = []
        for (a, b), s, c, n, taps in zip(voxels, self.start, self.step, self.shape, self._taps, strict=True):
            lower = min(max((a - s) // c, 0), n - 1)
            upper = min(max(-((s - b + 1) // c), 0), n - 1) + 1
            reach = len(taps) // 2
            inner.append((lower, upper))
            outer.append((max(lower - reach, 0), min(upper + reach, n)))
        box: Box = (outer[0], outer[1], outer[2])
        if self.sums is None:
            sums = self._compute(box)
        else:
            sums = np.array(
                self.sums[outer[0][0] : outer[0][1], outer[1][0] : outer[1][1], :, outer[2][0] : outer[2][1]]
            )
        for axis, taps, (a, b), (first, _) in zip((0, 1, 3), self._taps, inner, outer, strict=True):
            # Filtered first and cut after: what lies beyond the cut is complete only within the volume.
            sums = correlate1d(sums, taps, axis=axis, mode="constant")
            sums = np.take(sums, range(a - first, b - first), axis=axis)
        votes = sums[:, :, 6:]
        tensors = np.divide(sums[:, :, :6], votes, out=np.zeros_like(sums[:, :, :6]), where=votes > 1e-6)
        start = tuple(s + a * c for s, (a, _), c in zip(self.start, inner, self.step, strict=True))
        return Coarse(np.ascontiguousarray(tensors), start, self.step)  # type: ignore[arg-type]
