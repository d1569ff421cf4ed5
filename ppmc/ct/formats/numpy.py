"""NumPy arrays: .npy, read where they lie, and .npz."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ppmc.ct.formats.array import volume_of
from ppmc.ct.formats.axes import choose, leading
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.scene.sections.ct import VolumeSource


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open an array of three or more dimensions, the last three z, y, x; of an .npz the one that the scene names."""
    try:
        if path.suffix.lower() == ".npy":
            data = np.load(path, mmap_mode="r", allow_pickle=False)
        else:
            with np.load(path, allow_pickle=False) as archive:
                names = archive.files
                name = source.dataset or (names[0] if len(names) == 1 else None)
                if name not in names:
                    raise InputFileError(
                        f"{path}: name the volume with ct: source: dataset:; it holds {', '.join(names) or 'nothing'}"
                    )
                data = archive[name]
    except (ValueError, OSError, EOFError, BadZipFile) as error:
        raise InputFileError(f"{path}: cannot be read as a NumPy array: {error}") from None
    if data.ndim < 3:
        raise InputFileError(f"{path}: has shape {data.shape}; a volume has three dimensions (z, y, x)")
    yield volume_of(path, data, choose(leading(data.shape), data.shape, source, path))
