"""Wavefront OBJ: vertices and faces; texture, normals, colours, groups and materials have no say."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.geometry.surfaces.formats.text import as_ascii, numbers

NOT_TRIANGLES = {"curv", "curv2", "surf", "cstype"}


def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices and triangles; polygons are split into fans.

    Vertex numbers count from 1, or backwards from the last vertex above the face if negative.

    Raises
    ------
    InputFileError
        If a line cannot be understood, or the file holds free-form surfaces.
    """
    words: list[bytes] = []
    triangles: list[tuple[int, int, int]] = []
    lines = as_ascii(path.read_bytes()).replace(b"\\\n", b" ").split(b"\n")
    for line, text in enumerate(lines, 1):
        parts = text.partition(b"#")[0].split()
        keyword = parts[0].lower() if parts else b""
        if keyword == b"v":
            # More than three numbers are a weight or a colour.
            if len(parts) < 4:
                raise InputFileError(f"{path}:{line}: a vertex has {len(parts) - 1} coordinates, a surface needs three")
            words += parts[1:4]
        elif keyword == b"f":
            face = [_vertex(word, len(words) // 3, f"{path}:{line}") for word in parts[1:]]
            if len(face) < 3:
                raise InputFileError(f"{path}:{line}: a face has {len(face)} vertices, it needs three at least")
            triangles += [(face[0], b, c) for b, c in pairwise(face[1:])]
        elif keyword.decode("ascii", "replace") in NOT_TRIANGLES:
            raise InputFileError(
                f"{path}:{line}: holds free-form geometry ('{parts[0].decode()}'); export it as triangles"
            )
    if not words:
        raise InputFileError(f"{path}: holds no vertices and no triangles; export the surface again as a triangle mesh")
    return numbers(words, path, "a vertex").reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _vertex(word: bytes, above: int, where: str) -> int:
    """Return the vertex, from 0, that a word of a face such as ``3/1/2`` names."""
    try:
        number = int(word.partition(b"/")[0])
    except ValueError:
        number = 0
    if number == 0:
        raise InputFileError(f"{where}: '{word.decode('ascii', 'replace')}' in a face is no vertex number")
    return number - 1 if number > 0 else above + number
