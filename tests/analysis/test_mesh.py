"""Structural meshes in and out: element numbers, which element a place lies in, formats."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from ppmc.analysis.mesh.formats import write_mapped
from ppmc.analysis.mesh.mapping import map_to_elements
from ppmc.analysis.mesh.mesh import StructuralMesh, read_mesh
from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.errors import InputFileError, SceneError
from ppmc.orientation import normalise
from ppmc.particles import Particles

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


def cloud(n: int = 3000) -> Particles:
    rng = np.random.default_rng(3)
    x = rng.uniform([0, 0, 0], [10, 4, 2], (n, 3))
    p = normalise(rng.normal(size=(n, 3)))
    return Particles("s", x, np.full(n, 0.5), p, normalise(np.cross(p, rng.normal(size=(n, 3)))))


def mapped_of(mesh: StructuralMesh) -> MappedMesh:
    return MappedMesh(mesh, map_to_elements(mesh.centres, [cloud()], mesh.owners), True, None)


def test_abaqus_meshes_keep_their_element_numbers(tmp_path: Path) -> None:
    mesh = read_mesh(write_abaqus(tmp_path / "part.inp"))
    assert mesh.numbers.tolist() == [1000, 1002, 1004, 1006, 7, 9]
    write_mapped(mapped_of(mesh), tmp_path, "mapped", ("abaqus",))
    lines = (tmp_path / "mapped_axes.inp").read_text().splitlines()
    assert [int(line.split(",")[0]) for line in lines[4:10]] == [1000, 1002, 1004, 1006, 7, 9]
    assert not (tmp_path / "mapped.inp").exists()


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


BAR = [(x, y, z) for x in range(0, 12, 2) for y, z in ((0, 0), (2, 0), (2, 2), (0, 2))]
BAR_NODES = "*NODE\n" + "".join(f"{k}, {x}., {y}., {z}.\n" for k, (x, y, z) in enumerate(BAR, 1))
BAR_CELLS = "*ELEMENT, TYPE=C3D8R, ELSET=ALL\n" + "".join(
    f"{k + 1}, " + ", ".join(str(4 * k + n) for n in range(1, 9)) + "\n" for k in range(5)
)
IN_PART = (
    f"*PART, NAME=Bar\n{BAR_NODES}{BAR_CELLS}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=Bar-1, PART=Bar\n"
    "{place}*END INSTANCE\n{more}*END ASSEMBLY\n"
)


def fan() -> Particles:
    """Particles in the bar, p turned by 9 degrees per mm of x1 in the plane of x1 and x2."""
    x = np.stack(np.meshgrid(np.arange(0.25, 10, 0.5), *[np.arange(0.25, 2, 0.5)] * 2, indexing="ij"), -1).reshape(
        -1, 3
    )
    a = np.radians(9.0 * x[:, 0])
    p = np.column_stack([np.cos(a), np.sin(a), 0 * a])
    return Particles("s", x, np.full(len(x), 0.125), p, np.tile([0.0, 0, 1], (len(x), 1)))


def axes_of(path: Path) -> dict[int, list[float]]:
    rows = [line.split(",") for line in path.read_text().splitlines() if line[:1].isdigit() and line.count(",") == 6]
    return {int(row[0]): [float(v) for v in row[1:]] for row in rows}


def mapped_bar(tmp_path: Path, text: str, formats: tuple[str, ...] = ("abaqus",)) -> MappedMesh:
    (tmp_path / "bar.inp").write_text(text)
    mesh = read_mesh(tmp_path / "bar.inp")
    mapped = MappedMesh(mesh, map_to_elements(mesh.centres, [fan()], within=1.0), False, None)
    write_mapped(mapped, tmp_path, "mapped", formats)
    return mapped


FIRST, LAST = ([np.cos(a), np.sin(a), 0] for a in np.radians([6.75, 78.75]))


@pytest.mark.parametrize(
    ("text", "turned"),
    [
        (BAR_NODES + BAR_CELLS, False),
        (IN_PART.format(place="", more=""), False),
        (IN_PART.format(place="5., 0., 0.\n", more="").replace("*NODE", "*SYSTEM\n-5.,0.,0.\n*NODE"), False),
        ("", None),
        (IN_PART.format(place="0.,0.,0.\n5.,1.,0., 5.,1.,1., 180.\n", more=""), True),
        (IN_PART.format(place="", more="*NODE\n1, 50., 0., 0.\n"), False),
    ],
)  # fmt: skip
def test_directions_go_to_where_instances_stand(text: str, turned: bool | None, tmp_path: Path) -> None:
    if turned is None:
        text = "*SYSTEM\n5.,0.,0., 6.,0.,0., 5.,1.,0.\n*NODE\n" + "".join(
            f"{k}, {x - 5}., {y}., {z}.\n" for k, (x, y, z) in enumerate(BAR, 1)
        )
        text += "*SYSTEM\n" + BAR_CELLS
    mapped_bar(tmp_path, text)
    axes = axes_of(tmp_path / "mapped_axes.inp")
    assert len(axes) == 5
    one, five = (axes[5], axes[1]) if turned else (axes[1], axes[5])
    assert np.allclose(one[:3], FIRST, atol=1e-6) and np.allclose(five[:3], LAST, atol=1e-6)
    assert np.allclose(one[3:], [-FIRST[1], FIRST[0], 0], atol=1e-6)


def test_axes_in_a_turned_part_are_the_parts_own(tmp_path: Path) -> None:
    """A quarter turn about x1 takes x2 to x3: what points along x2 in the model points along -x3 in the part."""
    text = IN_PART.format(place="0.,0.,0.\n0.,1.,1., 1.,1.,1., 90.\n", more="")
    mapped = mapped_bar(tmp_path, text, ("abaqus", "vtu"))
    assert np.allclose(mapped.elements.fibre_direction[0], FIRST)
    axes = axes_of(tmp_path / "mapped_axes.inp")
    assert np.allclose(axes[1][:3], [FIRST[0], 0, -FIRST[1]], atol=1e-6)
    assert "*PART, NAME=BAR" in (tmp_path / "mapped_axes.inp").read_text()
    assert np.allclose(meshio.read(tmp_path / "mapped.vtu").cell_data["fibre_direction"][0][0], FIRST)


def test_one_part_in_two_instances_is_refused_and_two_parts_are_kept_apart(tmp_path: Path) -> None:
    more = "*INSTANCE, NAME=Bar-2, PART=Bar\n0., 5., 0.\n*END INSTANCE\n"
    with pytest.raises(InputFileError, match="INSTANCE, NAME=BAR-2: its part BAR stands in another instance too"):
        mapped_bar(tmp_path, IN_PART.format(place="", more=more))
    other = f"*PART, NAME=Rib\n{BAR_NODES}{BAR_CELLS}*END PART\n" + IN_PART.format(place="", more=more)
    mapped = mapped_bar(
        tmp_path, other.replace("NAME=Bar-2, PART=Bar", "NAME=Rib-1, PART=Rib").replace("5., 0.", "40., 0.")
    )
    assert mapped.mesh.numbers.tolist() == [1, 2, 3, 4, 5] * 2
    assert len(axes_of(tmp_path / "mapped_axes_bar.inp")) == 5
    # Nothing lies within reach of the second: no lines, one set that says so.
    assert not axes_of(tmp_path / "mapped_axes_rib.inp")
    assert "*ELSET, ELSET=ppmc_empty\n1, 2, 3, 4, 5\n" in (tmp_path / "mapped_axes_rib.inp").read_text()


def test_calculix_and_lsdyna_cards_give_p_q_r(tmp_path: Path) -> None:
    mapped = mapped_bar(tmp_path, BAR_NODES + BAR_CELLS.replace("\n5, ", "\n50, "), ("calculix", "lsdyna"))
    text = (tmp_path / "mapped_axes_ccx.inp").read_text()
    assert text.startswith("*DISTRIBUTION, NAME=PPMC_AXES\n, 1., 0., 0., 0., 1., 0.\n1, ") and "TABLE" not in text
    assert text.endswith("*ORIENTATION, NAME=PPMC, SYSTEM=RECTANGULAR\nPPMC_AXES\n")
    assert np.allclose(axes_of(tmp_path / "mapped_axes_ccx.inp")[50][:3], LAST, atol=1e-6)
    lines = (tmp_path / "mapped_axes.k").read_text().splitlines()
    at = lines.index("*ELEMENT_SOLID_ORTHO") + 1
    cards = [lines[k : k + 3] for k in range(at, len(lines) - 1, 3)]
    assert [int(card[0][:8]) for card in cards] == [1, 2, 3, 4, 50]
    for k, card in enumerate(cards):
        nodes = [int(card[0][8 * j : 8 * j + 8]) for j in range(2, 10)]
        assert nodes == list(range(4 * k + 1, 4 * k + 9))
        a, d = (np.array([float(line[16 * j : 16 * j + 16]) for j in range(3)]) for line in card[1:])
        c = np.cross(a, d)
        e = mapped.elements
        expected = [e.fibre_direction[k], e.in_plane_direction[k], e.platelet_normal[k]]
        assert np.allclose([a, np.cross(c, a), c], expected, atol=1e-7)
    start = lines.index("*NODE") + 1
    points = [[float(line[8 + 16 * j : 24 + 16 * j]) for j in range(3)] for line in lines[start : start + 24]]
    assert np.allclose(points, BAR)


def test_lsdyna_bricks_of_fewer_nodes_are_right_handed(tmp_path: Path) -> None:
    from ppmc.analysis.mesh.formats.lsdyna import CARDS

    corners = np.array(
        [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
    )
    gradients = corners / 8.0  # of the trilinear shape functions in the middle
    wedge = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], dtype=float)
    pyramid = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]])
    for kind, points in (("wedge", wedge), ("tetra", wedge[[0, 1, 2, 3]]), ("pyramid", pyramid)):
        jacobian = gradients.T @ points[list(CARDS[kind])]
        assert np.linalg.det(jacobian) > 0


def test_shell_cards_turn_from_the_first_edge(tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    meshio.write(tmp_path / "shell.vtu", meshio.Mesh(points, [("quad", np.array([[0, 1, 2, 3], [1, 2, 3, 0]]))]))
    mesh = read_mesh(tmp_path / "shell.vtu")
    p = np.tile([np.cos(0.5), np.sin(0.5), 0], (1, 1))
    s = Particles("s", np.array([[0.5, 0.5, 0]]), np.ones(1), p, np.array([[0.0, 0, 1]]))
    write_mapped(MappedMesh(mesh, map_to_elements(mesh.centres, [s]), False, None), tmp_path, "mapped", ("lsdyna",))
    lines = (tmp_path / "mapped_axes.k").read_text().splitlines()
    at = lines.index("*ELEMENT_SHELL_BETA")
    angles = [float(lines[at + k][64:80]) for k in (2, 4)]
    assert angles == pytest.approx([np.degrees(0.5), np.degrees(0.5) - 90], abs=1e-5)


@pytest.mark.parametrize(("version", "binary"), [("2.2", False), ("2.2", True), ("4.1", False), ("4.1", True)])
def test_gmsh_meshes_keep_numbers_and_groups(version: str, binary: bool, tmp_path: Path) -> None:
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        boxes = [gmsh.model.occ.addBox(x, 0, 0, 5, 2, 2) for x in (0, 5)]
        gmsh.model.occ.fragment([(3, boxes[0])], [(3, boxes[1])])
        gmsh.model.occ.synchronize()
        for tag, name in ((11, "left"), (7, "right")):
            gmsh.model.addPhysicalGroup(3, [boxes[0 if name == "left" else 1]], tag, name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 2.0)
        gmsh.option.setNumber("Mesh.MshFileVersion", float(version))
        gmsh.option.setNumber("Mesh.Binary", int(binary))
        gmsh.model.mesh.generate(3)
        gmsh.write(str(tmp_path / "boxes.msh"))
        numbers = {tag: set(np.concatenate(gmsh.model.mesh.getElements(3, b)[1]).tolist())
                   for tag, b in ((11, boxes[0]), (7, boxes[1]))}  # fmt: skip
    finally:
        gmsh.finalize()
    mesh = read_mesh(tmp_path / "boxes.msh")
    for name, tag, low in (("left", 11, 0), ("right", 7, 5)):
        index = mesh.groups[name]
        assert set(mesh.numbers[index].tolist()) == numbers[tag]
        assert ((mesh.centres[index, 0] > low) & (mesh.centres[index, 0] < low + 5)).all()
    mapped = MappedMesh(mesh, map_to_elements(mesh.centres, [fan()]), False, None)
    write_mapped(mapped, tmp_path, "mapped", ("gmsh",))
    back = read_mesh(tmp_path / "mapped.msh")
    assert np.array_equal(back.numbers, mesh.numbers) and np.array_equal(back.node_numbers, mesh.node_numbers)
    assert {name: found.tolist() for name, found in back.groups.items()} == {
        name: found.tolist() for name, found in mesh.groups.items()
    }
    assert np.allclose(back.centres, mesh.centres)


def test_sets_of_an_abaqus_mesh_are_groups_in_gmsh(tmp_path: Path) -> None:
    text = (
        BAR_NODES
        + BAR_CELLS.replace(", ELSET=ALL", "")
        + "*ELSET, ELSET=ENDS\n1, 5\n*ELSET, ELSET=MIDDLE, GENERATE\n2, 4\n"
    )
    mapped_bar(tmp_path, text, ("gmsh",))
    back = read_mesh(tmp_path / "mapped.msh")
    assert back.groups["ENDS"].tolist() == [0, 4] and back.groups["MIDDLE"].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("formats", "text", "words"),
    [
        (("calculix",), IN_PART.format(place="0,0,0\n0,0,0, 0,0,1, 20.\n", more=""), "neither parts nor instances"),
        (
            ("lsdyna",),
            BAR_NODES + "*ELEMENT, TYPE=C3D20\n1, " + ", ".join(map(str, range(1, 21))),
            "cards are written for",
        ),
    ],
)
def test_formats_that_cannot_hold_the_mesh_say_so(
    formats: tuple[str, ...], text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=words):
        mapped_bar(tmp_path, text, formats)
