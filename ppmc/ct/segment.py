"""Find the specimen, and voids in it, by grey value."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.block import Slices
from ppmc.ct.source import Volume

FINEST = 256
"""Most voxels along an axis of the grid on which the specimen is found; larger volumes are averaged down to it."""
APART = 4.0
"""Otsu's two classes are air and specimen only if their means are this many of their own deviations apart."""
VOID_DEPTH = 4.0
"""Voids are darker than the specimen's median by this many robust standard deviations."""


def specimen_mask(volume: Volume, *, exclude_voids: bool = False) -> tuple[NDArray[np.uint8], int]:
    """Return a mask of the specimen on a grid coarser by a whole number, and that number.

    Grey values averaged over cells are split by Otsu's threshold into air and specimen, the largest connected part
    kept and its holes filled. Where grey values do not fall into two well separated classes there is no air, and
    everything is specimen.

    Parameters
    ----------
    volume : Volume
        Grey values.
    exclude_voids : bool
        Leave dark voids inside the specimen out of the mask.
    """
    from scipy.ndimage import binary_fill_holes, binary_opening, gaussian_filter
    from skimage.filters import threshold_otsu
    from skimage.measure import label

    cell = -(-max(volume.shape) // FINEST)
    grey = gaussian_filter(_averaged(volume, cell), 1.0)
    threshold = float(threshold_otsu(grey))
    bright, dark = grey[grey > threshold], grey[grey <= threshold]
    spread = np.sqrt(0.5 * (bright.var() + dark.var())) if bright.size and dark.size else np.inf
    mask = np.ones(grey.shape, bool)
    if np.isfinite(spread) and bright.mean() - dark.mean() > APART * spread:
        parts = label(binary_opening(grey > threshold), connectivity=1)
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0
        mask = binary_fill_holes(parts == sizes.argmax())
    if exclude_voids:
        inside = grey[mask]
        middle = np.median(inside)
        robust = 1.4826 * np.median(np.abs(inside - middle))
        mask &= grey > middle - VOID_DEPTH * robust
    return mask.astype(np.uint8), cell


def mask_reader(mask: NDArray[np.uint8], cell: int) -> Callable[[Slices], NDArray[np.uint8]]:
    """Return a function that reads boxes of a coarse mask as if it had every voxel."""

    def read(box: Slices) -> NDArray[np.uint8]:
        index = [np.arange(s.start, s.stop) // cell for s in box]
        return np.asarray(mask[np.ix_(*index)])

    return read


def _averaged(volume: Volume, cell: int) -> NDArray[np.float32]:
    """Return grey values averaged over cells, read a few planes at a time."""
    nz, ny, nx = volume.shape
    out = np.empty(tuple(-(-n // cell) for n in volume.shape), np.float32)
    edges_y, edges_x = np.arange(0, ny, cell), np.arange(0, nx, cell)
    counts = np.diff([*edges_y, ny])[:, None] * np.diff([*edges_x, nx])[None, :]
    for k, z in enumerate(range(0, nz, cell)):
        planes = volume.grey((slice(z, min(z + cell, nz)), slice(0, ny), slice(0, nx))).mean(axis=0)
        out[k] = np.add.reduceat(np.add.reduceat(planes, edges_y, axis=0), edges_x, axis=1) / counts
    return out
