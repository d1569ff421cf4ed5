"""MetaImage: .mhd with a data file beside it, .mha with the data inside; ITK's own format.

The header is lines of ``key = value``; reading it here keeps ITK out and lets data that are not
compressed be read where they lie.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ppmc.ct.formats.array import volume_of
from ppmc.ct.formats.axes import choose, leading
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.notices import notice
from ppmc.scene.sections.ct import VolumeSource

TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip
LONGEST_HEADER = 65536


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a MetaImage; its spacing is taken for mm, as ITK's is."""
    header, end = _header(path)
    try:
        size = [int(n) for n in header["DIMSIZE"].split()]
        dtype = np.dtype(TYPES[header["ELEMENTTYPE"].upper()])
        channels = int(header.get("ELEMENTNUMBEROFCHANNELS", "1"))
        where = header["ELEMENTDATAFILE"]
    except (KeyError, ValueError) as error:
        raise InputFileError(f"{path}: its MetaImage header lacks or garbles {error}") from None
    big = header.get("BINARYDATABYTEORDERMSB", header.get("ELEMENTBYTEORDERMSB", "False")).lower() == "true"
    dtype = dtype.newbyteorder(">" if big else "<")
    if where.upper() == "LIST" or "%" in where:
        raise InputFileError(
            f"{path}: keeps each slice in a file of its own ({where}); give the folder, or write one file"
        )
    data_path, skip = (path, end) if where.upper() == "LOCAL" else (path.parent / where, 0)
    if not data_path.is_file():
        raise InputFileError(f"{path}: its data file {data_path} is missing; keep both in one folder")
    shape = (*size[::-1], *([channels] if channels > 1 else []))
    data = _data(path, data_path, header, skip, dtype, shape)
    axes = leading(size[::-1]) + ("C" if channels > 1 else "")
    yield volume_of(path, data, choose(axes, shape, source, path), _spacing(header), **_place(path, header))


def _header(path: Path) -> tuple[dict[str, str], int]:
    """Return the header's keys in capitals, and where it ends."""
    with path.open("rb") as opened:
        head = opened.read(LONGEST_HEADER)
    out: dict[str, str] = {}
    at = 0
    for line in head.split(b"\n"):
        at += len(line) + 1
        key, equals, value = line.decode("latin-1").partition("=")
        if not equals:
            break
        out[key.strip().upper()] = value.strip()
        if key.strip().upper() == "ELEMENTDATAFILE":
            return out, at
    raise InputFileError(f"{path}: has no MetaImage header that ends with ElementDataFile")


def _data(
    path: Path, data_path: Path, header: dict[str, str], skip: int, dtype: np.dtype, shape: tuple[int, ...]
) -> np.ndarray:
    """Return the array, read where it lies unless it is compressed."""
    need = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    if header.get("COMPRESSEDDATA", "False").lower() == "true":
        try:
            values = zlib.decompress(data_path.read_bytes()[skip:])
        except zlib.error as error:
            raise InputFileError(f"{data_path}: its compressed data are damaged: {error}") from None
        if len(values) != need:
            raise InputFileError(f"{path}: holds {len(values):,} bytes of data, its header needs {need:,}")
        return np.frombuffer(values, dtype).reshape(shape)
    given = int(header.get("HEADERSIZE", "0"))
    have = data_path.stat().st_size
    skip = have - need if given < 0 else skip + given
    if skip < 0 or have - skip < need:
        raise InputFileError(f"{data_path}: has {have:,} bytes, the header of {path.name} needs {skip + need:,}")
    return np.memmap(data_path, dtype, "r", skip, shape)


def _spacing(header: dict[str, str]) -> tuple[float, float, float] | None:
    words = header.get("ELEMENTSPACING", header.get("ELEMENTSIZE", "")).split()
    return (float(words[0]), float(words[1]), float(words[2])) if len(words) >= 3 else None


def _place(path: Path, header: dict[str, str]) -> dict[str, tuple[float, ...]]:
    """Return the origin; turned grids are told, not followed."""
    turn = header.get("TRANSFORMMATRIX", header.get("ROTATION", header.get("ORIENTATION", ""))).split()
    if turn and not np.allclose([float(v) for v in turn], np.eye(round(len(turn) ** 0.5)).ravel()):
        notice(f"{path}: its grid is turned in space, which is not followed: x, y, z are those of the voxels")
        return {}
    words = header.get("OFFSET", header.get("POSITION", header.get("ORIGIN", ""))).split()
    return {"origin": (float(words[0]), float(words[1]), float(words[2]))} if len(words) >= 3 else {}
