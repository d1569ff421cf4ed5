"""Triangles as they stand in STL, OBJ, PLY and VTU files; one file a format, chosen by the ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.geometry.surfaces.formats import obj, ply, stl, vtu

Triangles = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices, shape (n, 3), in the file's unit, and vertex numbers, shape (m, 3)."""

READERS: dict[str, Callable[[Path], Triangles]] = {
    ".stl": stl.read,
    ".obj": obj.read,
    ".ply": ply.read,
    ".vtu": vtu.read,
}


def read_triangles(path: Path) -> Triangles:
    """Return vertices and triangles of a surface file; quadrilaterals and polygons are split.

    Raises
    ------
    InputFileError
        If the file is missing, empty, of no known kind, damaged, or holds anything but surfaces.
    """
    if not path.is_file():
        raise InputFileError(f"{path}: no such surface file; the path is taken from the scene's folder")
    if path.suffix.lower() not in READERS:
        raise InputFileError(f"{path}: surfaces are read from {', '.join(READERS)}, not '{path.suffix}'; convert it")
    if path.stat().st_size == 0:
        raise InputFileError(f"{path}: the file is empty; export the surface again")
    return READERS[path.suffix.lower()](path)
