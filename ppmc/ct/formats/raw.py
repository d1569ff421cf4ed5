"""Raw files: shape, number type and byte order come from the scene."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError, SceneError
from ppmc.scene.sections.ct import VolumeSource


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a raw file; x varies fastest."""
    if source.shape is None or source.dtype is None:
        raise SceneError(
            f"{path}: a raw file needs ct: source: shape: [nz, ny, nx] and dtype: in the scene; "
            f"given are shape {source.shape} and dtype {source.dtype}"
        )
    dtype = np.dtype(source.dtype).newbyteorder("<" if source.byte_order == "little" else ">")
    need = int(np.prod(source.shape, dtype=np.int64)) * dtype.itemsize + source.header_bytes
    have = path.stat().st_size
    if need != have:
        raise InputFileError(
            f"{path}: has {have:,} bytes, but shape {list(source.shape)} of {source.dtype} with "
            f"{source.header_bytes} header bytes needs {need:,}; correct ct: source:"
        )
    data = np.memmap(path, dtype, "r", source.header_bytes, source.shape)
    yield Volume(path, source.shape, dtype, lambda box: np.asarray(data[box]))
