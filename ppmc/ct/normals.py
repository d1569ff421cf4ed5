"""Tensors of the large window, from which the platelet normal r is taken.

Gradient products are averaged over cells of a few voxels and smoothed on that coarse grid: the same window at a small
part of the cost. Every voxel counts once, so nothing is lost by the coarseness but the finest detail of a window that
is several cells wide.
"""

from __future__ import annotations

import numpy as np

from ppmc.ct.block import Coarse, Floats
from ppmc.ct.filters import cell_box, gaussian
from ppmc.ct.settings import Settings, coarse_sigma


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


def cell_windows(chosen: Settings) -> tuple[Floats, Floats, Floats]:
    """Return the cell averages along x, y, z."""
    cx, cy, cz = chosen.cell
    return cell_box(cx), cell_box(cy), cell_box(cz)


def smooth_cells(sums: Floats, chosen: Settings, spacing: tuple[float, float, float]) -> Floats:
    """Turn sums over cells (cz, cy, 7, cx), the votes last, into tensors of the large window (cz, cy, 6, cx)."""
    from scipy.ndimage import correlate1d

    assert chosen.normal_window is not None
    for axis, direction in ((0, 2), (1, 1), (3, 0)):
        width = coarse_sigma(chosen.normal_window[direction], spacing[direction], chosen.cell[direction])
        sums = correlate1d(sums, gaussian(width).astype(np.float64), axis=axis, mode="constant")
    votes = sums[:, :, 6:]
    return np.divide(sums[:, :, :6], votes, out=np.zeros_like(sums[:, :, :6]), where=votes > 1e-6)


def coarse_grid(tensors: Floats, chosen: Settings, shape: tuple[int, int, int]) -> Coarse:
    """Attach the place of the cells."""
    cells = chosen.cell[::-1]
    start = tuple(cell_axis(n, c)[0] for n, c in zip(shape, cells, strict=True))
    return Coarse(tensors, start, cells)  # type: ignore[arg-type]
