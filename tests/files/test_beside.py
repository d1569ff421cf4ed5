"""Files beside products: only what bears ppmc's mark is replaced, and readers of the format do not mind the mark."""

from __future__ import annotations

import io
from pathlib import Path

import meshio
import numpy as np
import pytest
from PIL import Image

from ppmc.errors import SceneError
from ppmc.files.beside import MARKED, is_marked, marked_file

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FORMATS = {".inp": "abaqus", ".msh": "gmsh22", ".vtu": "vtu"}


def image(kind: str) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (40, 30), (200, 30, 90)).save(stream, kind)
    return stream.getvalue()


def write(path: Path, kind: str) -> None:
    if kind in FORMATS:
        meshio.Mesh(POINTS, [("tetra", [[0, 1, 2, 3]])]).write(path, file_format=FORMATS[kind])
    elif kind == ".npz":
        with path.open("wb") as file:
            np.savez(file, x=POINTS)
    else:
        path.write_bytes(image(kind.removeprefix(".")))


def assert_readable(path: Path) -> None:
    kind = path.suffix
    if kind in FORMATS:
        assert np.allclose(meshio.read(path, file_format="gmsh" if kind == ".msh" else None).points, POINTS)
    elif kind == ".npz":
        assert np.array_equal(np.load(path)["x"], POINTS)
    else:
        with Image.open(path) as found:
            found.load()
            assert found.size == (40, 30)
            assert found.convert("RGB").getpixel((3, 4)) == (200, 30, 90)
    if kind == ".vtu":
        import pyvista

        assert pyvista.read(path).n_points == len(POINTS)


@pytest.mark.parametrize("kind", MARKED)
def test_only_marked_files_are_replaced(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"x{kind}"
    for _ in range(2):
        with marked_file(path) as temporary:
            write(temporary, kind)
        assert_readable(path)
        assert is_marked(path) == ""
    first = path.read_bytes()
    write(path, kind)  # the same from another program
    other = path.read_bytes()
    with pytest.raises(SceneError, match="was not written by ppmc"), marked_file(path):
        pass
    assert path.read_bytes() == other
    with marked_file(path, force=True) as temporary:
        write(temporary, kind)
    assert is_marked(path) == "" and (path.read_bytes() == first or kind == ".npz")
    with pytest.raises(SceneError, match="are the same file"), marked_file(path, [path], force=True):
        pass
