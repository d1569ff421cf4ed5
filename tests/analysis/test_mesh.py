"""Structural meshes in and out: element numbers, which element a place lies in, formats."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from ppmc.analysis.mapping import map_to_elements
from ppmc.analysis.mesh import StructuralMesh, read_mesh
from ppmc.analysis.mesh_output import write_mapped
from ppmc.analysis.samples import Samples
from ppmc.analysis.structural import MappedMesh
from ppmc.errors import InputFileError
from ppmc.orientation import normalise

# A graded mesh: the nearest centre is not the element a place lies in.
EDGES = (np.array([0.0, 1, 2, 10]), np.array([0.0, 3, 4]), np.array([0.0, 2]))


def bricks() -> tuple[np.ndarray, np.ndarray]:
    points = np.stack(np.meshgrid(*EDGES, indexing="ij"), -1).reshape(-1, 3)

    def node(i: int, j: int, k: int) -> int:
        return (i * 3 + j) * 2 + k

    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    cells = [[node(i + a, j + b, k) for k in (0, 1) for a, b in corners] for i in range(3) for j in range(2)]
    return points, np.array(cells)


def write_abaqus(path: Path, extra: str = "") -> Path:
    """Write the bricks in two element blocks with numbers of their own, a truss between, nodes from 101."""
    points, cells = bricks()
    lines = ["*HEADING", "two blocks", "*NODE"]
    lines += [f"{101 + k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(points)]
    for first, block in ((1000, cells[:4]), (7, cells[4:])):
        lines += ["*ELEMENT, TYPE=C3D8R, ELSET=PART"]
        lines += [f"{first + 2 * k}, " + ", ".join(str(101 + n) for n in row) for k, row in enumerate(block)]
        lines += ["*ELEMENT, TYPE=T3D2", f"{first + 90}, 101, 102"]
    path.write_text("\n".join([*lines, "** end", "*NODE OUTPUT", "U", extra, ""]))
    return path


def cloud(n: int = 3000) -> Samples:
    rng = np.random.default_rng(3)
    x = rng.uniform([0, 0, 0], [10, 4, 2], (n, 3))
    p = normalise(rng.normal(size=(n, 3)))
    return Samples("s", x, np.full(n, 0.5), p, normalise(np.cross(p, rng.normal(size=(n, 3)))))


def mapped_of(mesh: StructuralMesh) -> MappedMesh:
    return MappedMesh(mesh, map_to_elements(mesh.centres, [cloud()], mesh.owners), True, None)


def test_abaqus_meshes_keep_their_element_numbers(tmp_path: Path) -> None:
    mesh = read_mesh(write_abaqus(tmp_path / "part.inp"))
    assert mesh.numbers.tolist() == [1000, 1002, 1004, 1006, 7, 9]
    write_mapped(mapped_of(mesh), tmp_path, "mapped", ("abaqus",))
    lines = (tmp_path / "mapped_axes.inp").read_text().splitlines()
    assert [int(line.split(",")[0]) for line in lines[4:10]] == [1000, 1002, 1004, 1006, 7, 9]
    assert not (tmp_path / "mapped.inp").exists()


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("*NODE\n900, 0., 0., 0.", "NODE keywords"),
        ("*ELEMENT, TYPE=C3D8\n1000, 101, 102, 103, 104, 105, 106, 107, 108", "numbers repeat"),
    ],
)
def test_abaqus_files_that_would_be_mixed_up_are_refused(extra: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=words):
        read_mesh(write_abaqus(tmp_path / "part.inp", extra))


def test_places_belong_to_the_element_they_lie_in(tmp_path: Path) -> None:
    points, cells = bricks()
    meshio.write(tmp_path / "part.vtu", meshio.Mesh(points, [("hexahedron", cells)]))
    mesh = read_mesh(tmp_path / "part.vtu")
    x = cloud().positions
    i, j = (np.searchsorted(EDGES[k], x[:, k], side="right") - 1 for k in (0, 1))
    assert np.array_equal(mesh.owners(x), i * 2 + j)
    nearest = np.argmin(((x[:, None] - mesh.centres[None]) ** 2).sum(-1), axis=1)
    assert (nearest != i * 2 + j).mean() > 0.1
    assert mesh.owners(np.array([[20.0, 1.0, 1.0], [-3.0, 9.0, 1.0]])).tolist() == [4, 1]


def test_shell_elements_own_what_is_closest(tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [9, 0, 0], [9, 1, 0]], dtype=float)
    meshio.write(tmp_path / "shell.vtu", meshio.Mesh(points, [("quad", np.array([[0, 1, 2, 3], [1, 4, 5, 2]]))]))
    mesh = read_mesh(tmp_path / "shell.vtu")
    assert mesh.owners(np.array([[0.9, 0.5, 0.7], [1.4, 0.5, -0.7], [8.0, 2.0, 0.0]])).tolist() == [0, 1, 1]


@pytest.mark.parametrize("ending", ["vtu", "msh", "inp"])
def test_every_format_comes_back(ending: str, tmp_path: Path) -> None:
    points, cells = bricks()
    meshio.write(tmp_path / "part.vtu", meshio.Mesh(points, [("hexahedron", cells[:4]), ("hexahedron", cells[4:])]))
    mapped = mapped_of(read_mesh(tmp_path / "part.vtu"))
    write_mapped(mapped, tmp_path, "mapped", ("vtu", "abaqus", "gmsh"))
    back = meshio.read(tmp_path / f"mapped.{ending}")
    assert np.allclose(back.points, points)
    assert np.array_equal(np.vstack([b.data for b in back.cells]), cells)
    if ending != "inp":
        tensors = np.concatenate(back.cell_data["fibre_tensor"]).reshape(-1, 3, 3)
        assert np.allclose(tensors, mapped.elements.fibre_tensor, atol=1e-14)
        assert np.concatenate(back.cell_data["particle_count"]).sum() == 3000
    else:
        assert "*ELEMENT, TYPE=C3D8, ELSET=PPMC" in (tmp_path / "mapped.inp").read_text()


def test_elements_that_abaqus_lacks_do_not_stop_the_rest(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(0, 4, (27, 3))
    meshio.write(tmp_path / "part.vtu", meshio.Mesh(points, [("hexahedron27", np.arange(27)[None])]))
    mesh = read_mesh(tmp_path / "part.vtu")
    mapped = MappedMesh(mesh, map_to_elements(mesh.centres, [cloud()]), False, None)
    write_mapped(mapped, tmp_path, "mapped", ("vtu", "abaqus"))
    assert {p.name for p in tmp_path.iterdir()} == {"part.vtu", "mapped.vtu", "mapped_axes.inp"}
