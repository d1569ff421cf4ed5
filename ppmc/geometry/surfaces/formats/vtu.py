"""VTU through meshio, and what meshio reads as triangles."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def read(path: Path) -> tuple[FloatArray, IntArray]:
    """Return vertices and triangles.

    Raises
    ------
    InputFileError
        If meshio cannot read the file, or it holds cells that are no surface.
    """
    return through_meshio(path, "vtu", path)


def through_meshio(file: Any, file_format: str, path: Path) -> tuple[FloatArray, IntArray]:
    """Return vertices and triangles of a file, or of an open one, that meshio reads; `path` names it in messages."""
    import meshio

    said = io.StringIO()
    try:
        # meshio prints and leaves the process on some damaged files.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            mesh = meshio.read(file, file_format=file_format)
    except (Exception, SystemExit) as error:
        reason = str(error) if str(error) not in ("", "1") else " ".join(said.getvalue().split())
        raise InputFileError(
            f"{path}: not a readable {file_format.upper()} file ({reason or type(error).__name__}); "
            "export the surface again as triangles"
        ) from None
    return _triangles_of(mesh, path)


def _triangles_of(mesh: Any, path: Path) -> tuple[FloatArray, IntArray]:
    """Return the vertices and triangles of a meshio mesh; quadrilaterals are split."""
    found: list[IntArray] = []
    for block in mesh.cells:
        cells = np.asarray(block.data) if block.type in ("triangle", "quad") else None
        if block.type == "triangle":
            found.append(np.asarray(cells, dtype=np.int64))
        elif block.type == "quad":
            quads = np.asarray(cells, dtype=np.int64)
            found += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
        elif block.type not in ("vertex", "line"):
            raise InputFileError(
                f"{path}: holds {len(block.data)} cells of type '{block.type}'; "
                "a surface needs triangles: extract the outer surface and export that"
            )
    points = np.asarray(mesh.points, dtype=float)
    if points.size == 0:
        raise InputFileError(f"{path}: holds no vertices and no triangles; export the surface again as a triangle mesh")
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputFileError(f"{path}: vertices have {points.shape[-1]} coordinates; a surface in space needs three")
    triangles = np.concatenate(found) if found else np.zeros((0, 3), dtype=np.int64)
    return points, triangles
