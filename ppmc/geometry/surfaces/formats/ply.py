"""PLY through meshio, its header put into the one form that meshio knows."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.geometry.surfaces.formats.text import MARKS
from ppmc.geometry.surfaces.formats.vtu import through_meshio

END = re.compile(rb"end_header[ \t]*\r?\n?", re.IGNORECASE)
LONGEST_HEADER = 65536


def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices and triangles.

    Raises
    ------
    InputFileError
        If the header does not end (meshio would wait for its end for ever) or meshio cannot read the file.
    """
    data = path.read_bytes().removeprefix(MARKS[0][0])
    end = END.search(data[:LONGEST_HEADER])
    if data[:3].lower() != b"ply" or end is None:
        raise InputFileError(f"{path}: not a PLY file with a complete header; export the surface again")
    head = data[: end.end()].replace(b"\r\n", b"\n").lower()
    # Both names are in use for the same list; meshio knows the second.
    head = re.sub(rb"(property +list +\w+ +\w+ +)vertex_index\b", rb"\1vertex_indices", head)
    return through_meshio(io.BytesIO(head + data[end.end() :]), "ply", path)
