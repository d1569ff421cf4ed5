"""A grey-value volume that is read in boxes, and what of it is no grey value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

Box = tuple[slice, slice, slice]
Read = Callable[[Box], NDArray[Any]]

LARGEST_GREY = 1e15
"""Floating-point values above this size are marks for missing data (1e20, 9.97e36, 3.4e38), no grey values: the squares
of their gradients would leave the range of single precision, which ends at 3.4e38."""


def _holds(dtype: np.dtype[Any], value: float) -> bool:
    """Return whether a number type has a value at all."""
    if dtype.kind == "f":
        return True
    return value == int(value) and np.iinfo(dtype).min <= value <= np.iinfo(dtype).max


@dataclass(frozen=True)
class Volume:
    """A volume that is read in boxes.

    Attributes
    ----------
    path : Path
        File or folder.
    shape : tuple of int
        Number of voxels (nz, ny, nx).
    dtype : numpy.dtype
        Number type.
    read : callable
        Returns the voxels of a box of slices (z, y, x).
    spacing : tuple of float or None
        Voxel size (x, y, z) in mm, if the file states it.
    origin, direction
        Place of the grid, if the file states it.
    read_mask : callable or None
        Returns the mask of the specimen: the file's own, the scene's, or what holds data.
    leave_out : bool
        Voxels without data are left out by `read_mask` instead of being refused.
    fill_value : float or None
        A grey value that stands for no data.
    """

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    read: Read
    spacing: tuple[float, float, float] | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    read_mask: Read | None = None
    leave_out: bool = False
    fill_value: float | None = None

    def without_data(self, values: NDArray[Any]) -> NDArray[np.bool_] | None:
        """Return where values are none: NaN, infinite, of impossible size or the fill value; None for nowhere."""
        bad: NDArray[np.bool_] | None = None
        if values.dtype.kind == "f" and values.size and not abs(values.min()) + abs(values.max()) <= LARGEST_GREY:
            bad = ~(np.abs(values) <= LARGEST_GREY)
        if self.fill_value is not None and _holds(values.dtype, self.fill_value):
            filled = values == values.dtype.type(self.fill_value)
            bad = filled if bad is None else bad | filled
        return bad if bad is not None and bad.any() else None

    def within(self, read_mask: Read | None) -> Volume:
        """Return the volume with a mask; voxels without data stay left out if they were."""
        if not self.leave_out:
            return replace(self, read_mask=read_mask)

        def read(box: Box) -> NDArray[Any]:
            bad = self.without_data(self.read(box))
            mask = np.ones([s.stop - s.start for s in box], np.uint8) if read_mask is None else read_mask(box) != 0
            return np.asarray(mask if bad is None else mask & ~bad, np.uint8)

        return replace(self, read_mask=read)

    def checked(self, box: Box) -> NDArray[Any]:
        """Return the voxels of a box as the file has them.

        Raises
        ------
        InputFileError
            If one of the specimen is no grey value, naming the voxel and the remedy.
        """
        values = self.read(box)
        self._refuse(values, self.without_data(values), box)
        return values

    def _refuse(self, values: NDArray[Any], bad: NDArray[np.bool_] | None, box: Box) -> None:
        if bad is None:
            return
        refused = bad if self.read_mask is None else bad & (self.read_mask(box) != 0)
        if refused.any():
            at = np.argwhere(refused)[0]
            where = [int(i + s.start) for i, s in zip(at, box, strict=True)]
            raise InputFileError(
                f"{self.path}: voxel [z, y, x] = {where} is {values[tuple(at)]:.4g}, which is no grey value "
                f"({int(refused.sum()):,} of {refused.size:,} voxels looked at); leave such voxels out with "
                "ct: source: {no_data: mask}, or keep them outside of ct: mask:"
            )

    def grey(self, box: Box, middle: float = 0.0, unit: float = 1.0) -> NDArray[np.float32]:
        """Return ``(grey - middle) / unit`` of a box as float32, never the file's own memory.

        What lies outside of the mask and is no grey value becomes zero.

        Raises
        ------
        InputFileError
            If a voxel of the specimen is no grey value, naming the voxel and the remedy.
        """
        values = self.read(box)
        bad = self.without_data(values)
        self._refuse(values, bad, box)
        if bad is not None:
            values = np.where(bad, values.dtype.type(middle), values)
        # Numbers that float32 does not hold exactly lose their offset first.
        exact = values.dtype.itemsize <= 2 or values.dtype == np.float32
        out: NDArray[Any] = values.astype(np.float32 if exact else np.float64, order="C")
        np.subtract(out, out.dtype.type(middle), out=out)
        np.multiply(out, out.dtype.type(1.0 / unit), out=out)
        return out.astype(np.float32, copy=False)
