"""Folders of PNG, JPEG or BMP slices."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.formats.slices import in_order
from ppmc.ct.volume import Box, Volume
from ppmc.errors import InputFileError
from ppmc.notices import notice
from ppmc.scene.sections.ct import VolumeSource

ENDINGS = {".png", ".jpg", ".jpeg", ".bmp"}
LOSSY = {".jpg", ".jpeg"}


@contextmanager
def folder(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a folder of slices, in the order of the numbers in their names."""
    files = in_order(path, ENDINGS)
    if any(f.suffix.lower() in LOSSY for f in files):
        notice(f"{path}: JPEG alters noise and fine texture; slices without loss (PNG, TIFF) give better directions")
    first = _slice(files[0], source)
    for f in files[1:]:
        _alike(f, _head(f), _head(files[0]))
    ny, nx = first.shape

    def read(box: Box) -> NDArray[Any]:
        planes = []
        for z in range(*box[0].indices(len(files))):
            plane = _slice(files[z], source)
            _alike(files[z], (plane.shape, plane.dtype), (first.shape, first.dtype))
            planes.append(plane[box[1:]])
        return np.stack(planes)

    yield Volume(path, (len(files), ny, nx), first.dtype, read)


def _head(path: Path) -> tuple[Any, Any]:
    """Return size and mode without reading pixels."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            return picture.size, picture.mode
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read as a picture: {error}") from None


def _alike(path: Path, found: tuple[Any, Any], first: tuple[Any, Any]) -> None:
    if found != first:
        raise InputFileError(
            f"{path}: is {found[0]} {found[1]}, but the first slice is {first[0]} {first[1]}; all slices must be alike"
        )


def _slice(path: Path, source: VolumeSource) -> NDArray[Any]:
    """Return one slice; of coloured ones the channel that the scene chooses."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            values = np.asarray(picture.convert("L") if picture.mode in ("P", "1") else picture)
    except (OSError, SyntaxError, ValueError) as error:
        raise InputFileError(f"{path}: cannot be read as a picture: {error}") from None
    if values.ndim == 2:
        return values
    if not isinstance(source.channel, int) or not 0 <= source.channel < values.shape[2]:
        raise InputFileError(
            f"{path}: has {values.shape[2]} channels; choose one with ct: source: channel: 0, counted from 0"
        )
    return values[..., source.channel]
