"""Abaqus input files: every way to write the same bar, placements and axes against closed forms, refusals by line."""

from __future__ import annotations

import contextlib
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ppmc.errors import InputFileError
from ppmc.geometry.abaqus import files_of, material_axes, read_deck, vtk_nodes
from ppmc.geometry.abaqus.elements import shape_of

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
NODES = "*NODE\n" + "".join(f"{k}, {x}., {y}., {z}.\n" for k, (x, y, z) in enumerate(CORNERS, 1))
BRICK = "*ELEMENT, TYPE=C3D8R, ELSET=ALL\n7, 1, 2, 3, 4, 5, 6, 7, 8\n"
AXES = "*DISTRIBUTION, NAME=D, LOCATION=ELEMENT, TABLE=T\n, 1.,0.,0., 0.,1.,0.\n7, 0.,1.,0., -1.,0.,0.\n"
ORIENTATION = "*ORIENTATION, NAME=O\nD\n3, 0.\n"


def bodies(tmp_path: Path, text: str | bytes):
    path = tmp_path / "a.inp"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_deck(path).bodies


def placed(tmp_path: Path, text: str | bytes) -> np.ndarray:
    """Return the nodes of the only element of the only body where they stand."""
    (body,) = bodies(tmp_path, text)
    (element,) = body.scope.elements.values()
    return body.placement.apply(body.scope.points(element))


def axes(tmp_path: Path, text: str) -> np.ndarray:
    (body,) = bodies(tmp_path, text)
    elements = list(body.scope.elements.values())
    centres = np.array([body.scope.points(e)[: e.shape.corners].mean(axis=0) for e in elements])
    return material_axes(body, elements, centres)[0]


@pytest.mark.parametrize(
    "text",
    [
        NODES + BRICK,
        NODES.lower() + BRICK.lower(),
        NODES.replace("*NODE", "* NODE , NSET = N") + BRICK.replace("*ELEMENT,", "* ELEMENT ,\n"),
        NODES.replace("\n3,", "\n** comment\n\n3,") + BRICK.replace("\n7,", "\n   ** another\n7,"),
        ("** M\xfcller \x85 \u0391\n" + NODES + BRICK).encode("utf-8"),
        b"** M\xfcller \x85 x\n" + (NODES + BRICK).encode(),
        b"\xef\xbb\xbf" + (NODES + BRICK).encode(),
        (NODES + BRICK).replace("\n", "\r\n"),
        NODES.replace("1.", "1.D+00") + BRICK,
        NODES.replace("1.", "10.-1") + BRICK,
        NODES + "*ELEMENT, TYPE=C3D8T\n7, 1, 2, 3,\n4, 5,\n6, 7, 8\n",
        NODES + BRICK.replace("\n7, 1", "\n7., 1"),
        NODES.replace("*NODE\n1, 0., 0., 0.\n", "*NODE\n1\n*NODE\n") + BRICK,
        "*HEADING\n1, 2, no data\n*PARAMETER\nx = 3\n" + NODES + BRICK + "*STEP\n*NODE\nnonsense\n",
        "*SYSTEM\n1.,0.,0.\n*NODE\n" + NODES[6:].replace("0., 0.\n", "0., 0.\n") + "*SYSTEM\n" + BRICK,
    ],
)  # fmt: skip
def test_every_way_to_write_a_brick_is_the_same_brick(text: str | bytes, tmp_path: Path) -> None:
    shift = [1.0, 0, 0] if isinstance(text, str) and text.startswith("*SYSTEM") else [0, 0, 0]
    assert np.allclose(placed(tmp_path, text), np.array(CORNERS) + shift, atol=1e-15)


def test_included_files_are_followed_and_named(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "nodes.inc").write_text(NODES)
    (tmp_path / "rows.txt").write_text(BRICK.splitlines()[1] + "\n")
    text = '*Include, input="sub/nodes.inc"\n*ELEMENT, TYPE=C3D8, INPUT=rows.txt\n'
    assert np.allclose(placed(tmp_path, text), CORNERS)
    names = [path.name for path in files_of(tmp_path / "a.inp")]
    assert names == ["a.inp", "nodes.inc", "rows.txt"] == [p.name for p in read_deck(tmp_path / "a.inp").files]
    (tmp_path / "sub" / "nodes.inc").write_text("*INCLUDE, INPUT=a.inp\n")
    with pytest.raises(InputFileError, match="included by itself"):
        read_deck(tmp_path / "a.inp")
    with pytest.raises(InputFileError, match=r"a.inp:1: 'gone.inc' is not found"):
        bodies(tmp_path, "*INCLUDE, INPUT=gone.inc\n")


def test_cylindrical_nodes_and_systems(tmp_path: Path) -> None:
    rows = [(k, np.hypot(x, y), np.degrees(np.arctan2(y, x)), z) for k, (x, y, z) in enumerate(CORNERS, 1)]
    text = "*NODE, SYSTEM=C\n" + "".join(f"{k}, {r:.12f}, {a:.12f}, {z}\n" for k, r, a, z in rows) + BRICK
    assert np.allclose(placed(tmp_path, text), CORNERS, atol=1e-11)
    # Origin (5, 0, 0), axis 1 along y, third point in the plane of 1 and 2 towards -x: a quarter turn about z.
    turned = np.array([[5 - y, x, z] for x, y, z in CORNERS], dtype=float)
    for system in ("5,0,0, 5,1,0\n4,0,0", "5,0,0, 5,1,0, 4,0,0", "5,0,0, 5,1,0", "5,0,0, 5,1,9"):
        assert np.allclose(placed(tmp_path, f"*SYSTEM\n{system}\n" + NODES + "*SYSTEM\n" + BRICK), turned, atol=1e-14)


PART = "*PART, NAME=P\n{inside}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n{place}*END INSTANCE\n{more}"


def assembly(inside: str, place: str = "", more: str = "") -> str:
    return PART.format(inside=inside, place=place, more=more) + "*END ASSEMBLY\n"


def test_instances_are_shifted_then_turned(tmp_path: Path) -> None:
    text = assembly(NODES + BRICK, "1., 2., 3.\n1., 1., 0., 1., 1., 5., 90.\n")
    expected = np.array([[1 - (y + 2 - 1), 1 + (x + 1 - 1), z + 3] for x, y, z in CORNERS], dtype=float)
    assert np.allclose(placed(tmp_path, text), expected, atol=1e-14)
    # What stands in the assembly has numbers of its own.
    point = assembly(NODES + BRICK, more="*NODE\n1, 9., 9., 9.\n*NSET, NSET=RP\n1\n")
    assert np.allclose(placed(tmp_path, point), CORNERS)
    # Parts without an assembly stand as they are.
    assert np.allclose(placed(tmp_path, f"*PART, NAME=P\n{NODES}{BRICK}*END PART\n"), CORNERS)
    both = bodies(tmp_path, assembly(NODES + BRICK, more="*INSTANCE, NAME=P-2, PART=P\n0,0,5\n*END INSTANCE\n"))
    assert [body.name for body in both] == ["P-1", "P-2"] and both[1].placement.shift[2] == 5.0


def test_axes_turn_with_the_instance_and_by_extra_rotations(tmp_path: Path) -> None:
    p2 = axes(tmp_path, NODES + BRICK + AXES + ORIENTATION)
    assert np.allclose(p2, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    about_3 = axes(tmp_path, NODES + BRICK + AXES + ORIENTATION.replace("3, 0.", "3, 90."))
    assert np.allclose(about_3, [[-1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-15)
    about_1 = axes(tmp_path, NODES + BRICK + AXES + ORIENTATION.replace("3, 0.", "1, 90."))
    assert np.allclose(about_1, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    turned = axes(tmp_path, assembly(NODES + BRICK + AXES + ORIENTATION, "0,0,0\n0,0,0, 0,0,1, 90.\n"))
    assert np.allclose(turned, [[-1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-15)
    angles = "*DISTRIBUTION, NAME=W, LOCATION=ELEMENT, TABLE=T2\n, 0.\nALL, 90.\n"
    spread = axes(tmp_path, NODES + BRICK + AXES + angles + ORIENTATION.replace("3, 0.", "3, W"))
    assert np.allclose(spread, about_3, atol=1e-15)


@pytest.mark.parametrize(
    ("lines", "first", "third"),
    [
        ("*ORIENTATION, NAME=O\n0,2,0, -1,1,0", (0, 1, 0), (0, 0, 1)),
        ("*ORIENTATION, NAME=O\n5,6,5, 4,5,5, 5,5,5", (0, 1, 0), (0, 0, 1)),
        ("*ORIENTATION, NAME=O, SYSTEM=Z RECTANGULAR\n0,0,3, 0,1,1", (0, 1, 0), (0, 0, 1)),
        # The brick's centre is (.5, .5, .5); the axis runs through (.5, -.5, 0) along z, radial is y.
        ("*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n.5,-.5,0, .5,-.5,1", (0, 1, 0), (0, 0, 1)),
        ("*orientation, name=o, system=spherical\n.5,-1.5,.5, .5,-1.5,1.5", (0, 1, 0), (0, 0, 1)),
        ("*ORIENTATION, NAME=O, DEFINITION=NODES\n4, 1", (0, 1, 0), None),
        ("*ORIENTATION, NAME=O, DEFINITION=NODES\n3, 1, 2", (0, 1, 0), (0, 0, 1)),
        ("*ORIENTATION, NAME=O, DEFINITION=OFFSET TO NODES\n4, 2", (0, 1, 0), (0, 0, -1)),
    ],
)  # fmt: skip
def test_orientations_in_every_system(lines: str, first: tuple, third: tuple | None, tmp_path: Path) -> None:
    text = NODES + BRICK + lines + "\n"
    if third is None:  # the origin, node 1 and node 4 lie on one line
        with pytest.raises(InputFileError, match=r"a.inp:12: \*ORIENTATION: its points do not settle"):
            axes(tmp_path, text)
        return
    found = axes(tmp_path, text)
    assert np.allclose(found[0], first, atol=1e-15) and np.allclose(found[2], third, atol=1e-15)
    assert np.linalg.det(found) == pytest.approx(1.0)


def test_shells_project_the_axis_after_the_named_one(tmp_path: Path) -> None:
    tilted = "*NODE\n1,0,0,0\n2,1,0,1\n3,1,1,1\n4,0,1,0\n*ELEMENT, TYPE=S4R, ELSET=ALL\n7,1,2,3,4\n"
    r = np.array([-1, 0, 1]) / np.sqrt(2)
    p = np.array([1, 0, 1]) / np.sqrt(2)
    flat = axes(tmp_path, tilted + "*ORIENTATION, NAME=O\n1,0,0, 0,1,0\n3, 0.\n")
    assert np.allclose(flat, [p, [0, 1, 0], r])
    quarter = axes(tmp_path, tilted + "*ORIENTATION, NAME=O\n1,0,0, 0,1,0\n3, 90.\n")
    assert np.allclose(quarter, [[0, 1, 0], -p, r], atol=1e-15)
    brick = NODES + BRICK.replace("C3D8R", "SC8R") + "*ORIENTATION, NAME=O\n1,0,1, 0,1,0\n3, 0.\n"
    assert np.allclose(axes(tmp_path, brick), np.eye(3))
    with pytest.raises(InputFileError, match="stands upright on the shell"):
        axes(tmp_path, brick.replace("1,0,1, 0,1,0", "0,0,1, 0,1,0"))


def test_sections_say_which_orientation_rules(tmp_path: Path) -> None:
    two = NODES + BRICK + "*ELEMENT, TYPE=C3D8, ELSET=B\n8, 1, 2, 3, 4, 5, 6, 7, 8\n*ELSET, ELSET=BOTH\nALL, B\n"
    rules = "*ORIENTATION, NAME=O\n1,0,0, 0,1,0\n*ORIENTATION, NAME=Q\n0,1,0, 0,0,1\n"
    sections = "*SOLID SECTION, ELSET=BOTH, ORIENTATION=O\n*SOLID SECTION, ELSET=B, ORIENTATION=Q, MATERIAL=M\n"
    (body,) = bodies(tmp_path, two + rules + sections)
    elements = list(body.scope.elements.values())
    found = material_axes(body, elements, np.zeros((2, 3)))
    assert np.allclose(found[:, 0], [[1, 0, 0], [0, 1, 0]])
    for wrong, message in [
        ("", "no section says with ORIENTATION="),
        ("*SOLID SECTION, ELSET=B, ORIENTATION=Q\n", "a.inp:11: element 7: no section with ORIENTATION="),
        (
            "*SOLID SECTION, ELSET=BOTH, ORIENTATION=X\n",
            r"a.inp:20: \*SOLID SECTION: there is no \*ORIENTATION, NAME=X",
        ),
        ("*SOLID SECTION, ELSET=BOTH, ORIENTATION=Q, COMPOSITE\n", "ply by ply"),
        ("*SOLID SECTION, ELSET=NONE, ORIENTATION=Q\n", "element set NONE is not defined"),
    ]:
        (body,) = bodies(tmp_path, two + rules + wrong)
        with pytest.raises(InputFileError, match=message):
            material_axes(body, list(body.scope.elements.values()), np.zeros((2, 3)))


def test_sets_of_spans_and_sets(tmp_path: Path) -> None:
    text = NODES + BRICK + "*ELSET, ELSET=S, GENERATE\n1, 9, 4\n12, 13\n*Elset, elset=t\ns, 40\n"
    (body,) = bodies(tmp_path, text)
    assert body.scope.members("T", "") == [1, 5, 9, 12, 13, 40]
    (body,) = bodies(tmp_path, text + "*ELSET, ELSET=S\nT\n")
    with pytest.raises(InputFileError, match="holds itself"):
        body.scope.members("T", "")
    more = "*ELSET, ELSET=PLATELET-3, INSTANCE=P-1\n7\n*ELSET, ELSET=X\nP-1.7, PLATELET-3\n"
    (body,) = bodies(tmp_path, assembly(NODES + BRICK, more=more))
    assert body.scope.members("PLATELET-3", "") == [7] and body.scope.members("X", "") == [7, 7]


@pytest.mark.parametrize(
    ("name", "kind", "family"),
    [
        ("C3D8RT", "hexahedron", "solid"), ("c3d10m", "tetra10", "solid"), ("C3D8RPHT", "hexahedron", "solid"),
        ("C3D6", "wedge", "solid"), ("C3D15V", "wedge15", "solid"), ("C3D20RHT", "hexahedron20", "solid"),
        ("SC6R", "wedge", "solid"), ("CSS8", "hexahedron", "solid"), ("DC3D4", "tetra", "solid"),
        ("S8R5", "quad8", "shell"), ("STRI65", "triangle6", "shell"), ("STRI3", "triangle", "shell"),
        ("S4RSW", "quad", "shell"), ("M3D9R", "quad9", "shell"), ("CPE4R", "quad", "plane"),
        ("CPS6M", "triangle6", "plane"),
    ],
)  # fmt: skip
def test_element_types(name: str, kind: str, family: str) -> None:
    shape = shape_of(name)
    assert not isinstance(shape, str) and shape is not None
    assert (shape.kind, shape.family) == (kind, family)


@pytest.mark.parametrize("name", ["T3D2", "B31", "R3D4", "CONN3D2", "MASS", "SPRINGA", "COH3D8", "SFM3D4R", "DCOUP3D"])
def test_elements_without_fibres_are_passed_over(name: str) -> None:
    assert shape_of(name) is None


def test_quadratic_elements_wrap_and_leave_nodes_out(tmp_path: Path) -> None:
    nodes = "*NODE\n" + "".join(f"{k}, {k}., 0., 0.\n" for k in range(1, 28))
    for kind, count, comma in (("C3D20R", 20, ","), ("C3D15", 15, ","), ("C3D27", 27, ","), ("C3D27", 21, ","),
                               ("C3D20", 20, "")):  # fmt: skip
        words = [str(k) for k in (5, *range(1, count + 1))]
        body_text = f"{', '.join(words[:9])}{comma}\n{', '.join(words[9:])}\n"
        (body,) = bodies(tmp_path, nodes + f"*ELEMENT, TYPE={kind}\n" + body_text + "6" + body_text[1:])
        assert list(body.scope.elements) == [5, 6]
        element = body.scope.elements[5]
        assert element.nodes == tuple(range(1, count + 1))
        ordered = vtk_nodes(element.shape, element.nodes)
        assert len(ordered[1]) == {27: 27, 21: 20}.get(count, count)


def test_the_27_nodes_come_in_the_order_of_vtk() -> None:
    pyvista = pytest.importorskip("pyvista")
    corners = np.array(CORNERS, dtype=float)
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    faces = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    points = [*corners, *(corners[list(e)].mean(axis=0) for e in edges), corners.mean(axis=0)]
    points += [corners[list(f)].mean(axis=0) for f in faces]
    shape = shape_of("C3D27")
    assert shape is not None and not isinstance(shape, str)
    kind, order = vtk_nodes(shape, tuple(range(27)))
    grid = pyvista.UnstructuredGrid({int(pyvista.CellType.TRIQUADRATIC_HEXAHEDRON): np.arange(27)[None]},
                                    np.array(points)[list(order)])  # fmt: skip
    parametric = np.array(grid.get_cell(0).GetParametricCoords()).reshape(-1, 3)
    assert kind == "hexahedron27" and np.allclose(np.array(points)[list(order)], parametric)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1, 2\n*NODE\n", r"a.inp:1: '1, 2' stands before any keyword"),
        (NODES + "*NGEN\n1, 8, 1\n", r"a.inp:10: \*NGEN generates nodes"),
        (NODES + "*NCOPY, CHANGE NUMBER=9, OLD SET=N, SHIFT\n", r"a.inp:10: \*NCOPY copies nodes"),
        (NODES + "*ELGEN\n", r"\*ELGEN generates elements"),
        ("*NODE, SYSTEM=S\n1, 1., 0., 0.\n", r"a.inp:1: \*NODE, SYSTEM=S: nodes are read in Cartesian"),
        (NODES + "*NODE\n3, 9., 9., 9.\n", "a.inp:11: node 3 stands elsewhere"),
        (NODES + BRICK + BRICK, "a.inp:13: element 7 is defined before: .*a.inp:11"),
        (NODES + "*ELEMENT, TYPE=C3D8\n7, 1, 2, 3\n", "a.inp:11: element 7 has 3 nodes, one of TYPE=C3D8 has 8"),
        (NODES + "*ELEMENT, TYPE=C3D4\n7, 1, 2, 3, 4, 5\n", "a.inp:11: element 7 has 5 nodes"),
        (NODES + "*ELEMENT, TYPE=CAX4\n7, 1, 2, 3, 4\n", r"a.inp:10: \*ELEMENT, TYPE=CAX4 cannot be mapped: axisymm"),
        (NODES + "*ELEMENT, TYPE=XYZ8\n", "TYPE=XYZ8 cannot be mapped: it is not known"),
        (NODES + "*ELEMENT\n", r"a.inp:10: \*ELEMENT lacks the parameter TYPE="),
        (NODES + "*ELSET, ELSET=A, GENERATE\n1, 8, 2\n", "a.inp:11: 8 is not reached from 1 in steps of 2"),
        ("*NODE\n1, <x>, 0., 0.\n", r"'<x>' is no number \(a \*PARAMETER is not worked out\)"),
        ("*NODE\n1, nan, 0., 0.\n", "a.inp:2: node 1 is not finite"),
        ("*PART, NAME=P\n" + NODES, r"ends within a \*PART; the file is truncated"),
        ("*END PART\n", r"a.inp:1: \*END PART: there is no Part open"),
        ("*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=Q\n*END INSTANCE\n*END ASSEMBLY\n", "there is no part Q"),
        ("*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, LIBRARY=J\n", "LIBRARY= takes the instance from another analysis"),
        (assembly(NODES + BRICK, "0,0,0\n0,0,0, 0,0,1\n"), "its place must be a line of three numbers"),
        (assembly(NODES + BRICK, "0,0,0\n1,1,1, 1,1,1, 9\n"), "two points of the axis .* are the same"),
        ("*SYSTEM\n0,0,0, 1,0,0, 2,0,0\n" + NODES, r"a.inp:1: \*SYSTEM: its points lie on one line"),
        ("*IMPERFECTION, FILE=x\n", r"\*IMPERFECTION moves nodes"),
    ],
)  # fmt: skip
def test_refusals_name_line_and_keyword(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=message):
        bodies(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("*ORIENTATION, NAME=O", "*ORIENTATION, NAME=O, SYSTEM=USER", r"a.inp:15: \*ORIENTATION, SYSTEM=USER is not"),
        ("3, 0.", "4, 0.", "a.inp:17: the second line of"),
        ("\nD\n", "\nE\n", r"a.inp:16: there is no \*DISTRIBUTION, NAME=E"),
        ("LOCATION=ELEMENT", "LOCATION=NODE", r"a.inp:12: \*DISTRIBUTION, LOCATION=NODE"),
        ("\n7, 0.,1.,0., -1.,0.,0.", "\nGONE, 0.,1.,0., -1.,0.,0.", "a.inp:14: .*set GONE is not defined"),
    ],
)  # fmt: skip
def test_axes_that_cannot_be_worked_out_are_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    lines = (NODES + BRICK + AXES + ORIENTATION).replace(old, new)
    with pytest.raises(InputFileError, match=message):
        axes(tmp_path, lines)


def test_what_is_passed_over_is_told(tmp_path: Path) -> None:
    rigid = "*PART, NAME=TOOL\n*NODE\n1,0,0,9\n*ELEMENT, TYPE=R3D4\n1, 1, 1, 1, 1\n*END PART\n"
    idle = "*PART, NAME=SPARE\n" + NODES + BRICK + "*END PART\n"
    more = "*INSTANCE, NAME=TOOL-1, PART=TOOL\n*END INSTANCE\n"
    (tmp_path / "a.inp").write_text(rigid + idle + assembly(NODES + BRICK, more=more))
    deck = read_deck(tmp_path / "a.inp")
    assert [body.name for body in deck.bodies] == ["P-1"]
    assert "1 R3D4" in deck.notes[0] and "SPARE" in deck.notes[1]


def test_an_independent_instance_holds_its_own_mesh(tmp_path: Path) -> None:
    text = (
        "*PART, NAME=P\n*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n0,0,0\n0,0,0, 0,0,1, 90.\n"
        + NODES + BRICK + AXES + ORIENTATION + "*END INSTANCE\n*END ASSEMBLY\n"
    )  # fmt: skip
    assert np.allclose(axes(tmp_path, text), [[-1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-15)


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    text = assembly(
        NODES + BRICK + AXES + ORIENTATION, "1.,2.,3.\n0,0,0, 0,0,1, 30.\n", "*ELSET, ELSET=X, INSTANCE=P-1\n7\n"
    )
    lines = text.split("\n")
    for _ in range(rng.randint(1, 3)):
        k = rng.randrange(len(lines))
        at = rng.randrange(len(lines[k]) + 1)
        lines[k] = lines[k][:at] + rng.choice(["", " ", ",", "*", "=", "-", "9", "D", "x", "\0"]) + lines[k][at + 1 :]
        if rng.random() < 0.3:
            lines.insert(rng.randrange(len(lines)), lines[rng.randrange(len(lines))])
        if rng.random() < 0.3:
            del lines[rng.randrange(len(lines))]
    with contextlib.suppress(InputFileError):
        for body in bodies(tmp_path, "\n".join(lines)):
            elements = list(body.scope.elements.values())
            material_axes(body, elements, np.zeros((len(elements), 3)))
