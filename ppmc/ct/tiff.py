"""Stacks of TIFF slices: many pages in one file, or a folder of files; checked before and while they are read."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

Box = tuple[slice, slice, slice]
Stack = tuple[tuple[int, int, int], np.dtype[Any], Callable[[Box], NDArray[Any]]]
"""Shape (nz, ny, nx), number type, and a function that reads a box."""
TIFF = {".tif", ".tiff"}


@contextmanager
def tiff_file(path: Path) -> Iterator[Stack]:
    """Open one file of many pages, or of one three-dimensional page."""
    import tifffile

    try:
        file = tifffile.TiffFile(path)
        pages = list(file.pages)
    except (tifffile.TiffFileError, OSError, ValueError, IndexError) as error:
        raise InputFileError(f"{path}: cannot be read as TIFF: {error}") from None
    with file:
        if not pages:
            raise InputFileError(f"{path}: is a TIFF file without images")
        first = pages[0]
        if first.ndim == 3 and len(pages) == 1:
            data = _page(first, path)
            yield data.shape, data.dtype, lambda box: data[box]
            return
        if first.ndim != 2:
            raise InputFileError(f"{path}: its images have shape {first.shape}; grey-value slices (y, x) are needed")
        for number, page in enumerate(pages):
            _same_slice(page, first, f"{path}: page {number}")
        shape = (len(pages), *first.shape)
        # All threads read through one file handle, and a page is a seek followed by a read.
        turn = threading.Lock()

        def read(box: Box) -> NDArray[Any]:
            with turn:
                return np.stack([_page(pages[z], path)[box[1:]] for z in range(*box[0].indices(len(pages)))])

        yield shape, first.dtype, read  # type: ignore[misc]


def _page(page: Any, path: Path) -> NDArray[Any]:
    """Return the image of a page; tifffile fills what a truncated file lacks with zeros, so that is checked here."""
    size = path.stat().st_size
    if any(a + n > size for a, n in zip(page.dataoffsets, page.databytecounts, strict=True)):
        raise InputFileError(f"{path}: page {page.index} ends beyond the file's {size:,} bytes; the file is truncated")
    try:
        return np.asarray(page.asarray())
    except Exception as error:  # tifffile's decoders raise whatever they meet
        raise InputFileError(f"{path}: page {page.index} is damaged: {error}") from None


def _same_slice(page: Any, first: Any, where: str) -> None:
    if page.shape != first.shape or page.dtype != first.dtype:
        raise InputFileError(
            f"{where} is {page.shape} {page.dtype}, but the first slice is {first.shape} {first.dtype}; "
            "all slices of a stack must be alike"
        )


def _no_gaps(files: list[Path]) -> None:
    """Refuse a folder of slices whose numbers, the last in each name, do not follow one another evenly."""
    found = [re.findall(r"\d+", file.stem) for file in files]
    if len(files) < 3 or not all(found):
        return
    numbers = [int(parts[-1]) for parts in found]
    steps = [b - a for a, b in pairwise(numbers)]
    usual = sorted(steps)[len(steps) // 2]
    for file, step in zip(files[1:], steps, strict=True):
        if step != usual:
            raise InputFileError(
                f"{file}: its number is {step} above that of the slice before, elsewhere in the folder it is {usual}; "
                "slices are missing or do not belong together"
            )


def tiff_folder(path: Path) -> Stack:
    """Open a folder of slices, in the order of the numbers in their names."""
    import tifffile

    def natural(file: Path) -> list[Any]:
        return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)]

    files = sorted((f for f in path.iterdir() if f.suffix.lower() in TIFF), key=natural)
    if not files:
        raise InputFileError(f"{path}: folder without .tif slices")
    _no_gaps(files)

    def slice_of(file: Path) -> NDArray[Any]:
        try:
            with tifffile.TiffFile(file) as tiff:
                return _page(tiff.pages[0], file)
        except (tifffile.TiffFileError, OSError, IndexError) as error:
            raise InputFileError(f"{file}: cannot be read as TIFF: {error}") from None

    def header_of(file: Path) -> tuple[tuple[int, ...], Any]:
        try:
            with tifffile.TiffFile(file) as tiff:
                page = tiff.pages[0]
                return page.shape, page.dtype
        except (tifffile.TiffFileError, OSError, IndexError) as error:
            raise InputFileError(f"{file}: cannot be read as TIFF: {error}") from None

    shape, dtype = header_of(files[0])
    if len(shape) != 2:
        raise InputFileError(f"{files[0]}: has shape {shape}; grey-value slices (y, x) are needed")
    for file in files[1:]:
        other = header_of(file)
        if other != (shape, dtype):
            raise InputFileError(
                f"{file}: is {other[0]} {other[1]}, but {files[0].name} is {shape} {dtype}; "
                "all slices of a stack must be alike"
            )

    def read(box: Box) -> NDArray[Any]:
        return np.stack([slice_of(files[z])[box[1:]] for z in range(*box[0].indices(len(files)))])

    return (len(files), shape[0], shape[1]), np.dtype(dtype), read
