"""STL, binary and text, as programs really write it.

Of a binary file nothing but the count of its triangles is trusted: headers may begin with "solid", and bytes may follow
the last triangle. Text may be in capitals, begin with a byte-order mark and name its solid in any encoding.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.geometry.surfaces.formats.text import MARKS, as_ascii, numbers

HEAD = 84
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
NAME_LINE = re.compile(rb"^\s*(?:end\s*)?solid\b.*$", re.IGNORECASE | re.MULTILINE)
LOOP_END = re.compile(rb"\bend\s*loop\b", re.IGNORECASE)


def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices, three a triangle, and triangles.

    Raises
    ------
    InputFileError
        If the file is truncated or no STL file.
    """
    data = path.read_bytes()
    corners = _text(data, path) if _is_text(data) else _binary(data, path)
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int64).reshape(-1, 3)


def _is_text(data: bytes) -> bool:
    """Return whether the file is text; a binary file whose length fits its count never is."""
    if len(data) >= HEAD and HEAD + RECORD.itemsize * struct.unpack_from("<I", data, 80)[0] == len(data):
        return False
    if data.startswith(tuple(mark for mark, _ in MARKS)):
        return True
    return data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:HEAD] and _has_facets(data)


def _has_facets(data: bytes) -> bool:
    """Return whether text's keywords stand in a file; a binary header may hold one, its numbers hold none."""
    return re.search(rb"\bvertex\s|\bendsolid\b|\bouter\s+loop", data, re.IGNORECASE) is not None


def _binary(data: bytes, path: Path) -> NDArray[np.float64]:
    """Return the corners of a binary file, shape (triangles, 3, 3)."""
    if len(data) < HEAD:
        raise InputFileError(
            f"{path}: {len(data)} bytes are no STL file (a binary one has at least {HEAD}); export it again"
        )
    count = struct.unpack_from("<I", data, 80)[0]
    need = HEAD + RECORD.itemsize * count
    rest = data[need:]
    if need > len(data) or (count == 0 and rest) or len(rest.strip(b"\0\r\n\t \x1a")) >= RECORD.itemsize:
        raise InputFileError(
            f"{path}: the header announces {count:,} triangles ({need:,} bytes) but the file has {len(data):,} "
            "bytes; it is truncated, holds more than one solid, or is no STL file: export it again"
        )
    return np.frombuffer(data, RECORD, count, HEAD)["corners"].astype(np.float64)


def _text(data: bytes, path: Path) -> NDArray[np.float64]:
    """Return the corners of a text file, shape (triangles, 3, 3)."""
    text = NAME_LINE.sub(b"", as_ascii(data))
    facets = LOOP_END.split(text)
    for k, facet in enumerate(facets):
        corners = len(re.findall(rb"\bvertex\b", facet, re.IGNORECASE))
        if corners != (3 if k < len(facets) - 1 else 0) or len(VERTEX.findall(facet)) != corners:
            why = "the file is truncated" if k == len(facets) - 1 else "each needs three vertices of three numbers"
            raise InputFileError(
                f"{path}: not a readable STL file (facet {k + 1} has {corners} vertices: {why}); "
                "export the surface again as triangles"
            )
    words = [word for found in VERTEX.findall(text) for word in found]
    return numbers(words, path, "a vertex").reshape(-1, 3, 3)
