"""Orientations to other programs and back, and files that are not what they should be."""

import numpy as np
import pytest

from ppmc.charge.cli import charge as command
from ppmc.charge.exchange import FORMATS, read_points, writer_of
from ppmc.charge.exchange.points import oriented_points
from ppmc.charge.orientations.imported import imported_frames
from ppmc.charge.stage import export, run
from ppmc.errors import InputFileError, SceneError
from ppmc.files import read_particles
from ppmc.orientation import angle_between_axes
from ppmc.scene.loader import load_scene, parse_scene
from ppmc.scene.sections.charge import FileOrientation

SCENE = """
name: block
charge:
  domain: {{shape: box, size: [6, 4, 1]}}
  spacing: 0.5 mm
  orientation: {orientation}
"""
PLATELETS = "{source: platelets, length: 3, width: 1.5, pitch: 5, roll: 10}"


@pytest.fixture(scope="module")
def charge(tmp_path_factory):
    return run(parse_scene(SCENE.format(orientation=PLATELETS)), output=tmp_path_factory.mktemp("c") / "charge.vtkhdf")


@pytest.mark.parametrize("ending", FORMATS)
def test_export_and_import_give_the_charge_back(charge, ending, tmp_path):
    path = export(charge, tmp_path / f"charge{ending}")
    again = run(
        parse_scene(SCENE.format(orientation=f"{{source: file, file: {path}}}")), output=tmp_path / "again.vtkhdf"
    )
    one, two = read_particles(charge, "charge"), read_particles(again, "charge")
    for name in ("fibre_direction", "platelet_normal", "in_plane_direction"):
        assert np.abs(one.fields[name] - two.fields[name]).max() < 1e-8
    assert np.array_equal(one.fields["platelet_id"], two.fields["platelet_id"])
    assert np.all(two.fields["orientation_source"] == 5)
    assert two.extra["largest_distance_mm"] < 1e-6


def test_abaqus_file_reads_as_abaqus_wants_it(charge, tmp_path):
    text = export(charge, tmp_path / "charge.inp").read_text()
    for line in ("*Node", "*Element, type=PC3D", "*Elset, elset=PLATELET-0", "*Distribution Table", "coord3D, coord3D"):
        assert line in text
    head = (
        "*Distribution, name=PLATELET_AXES, location=element, table=PLATELET_AXES_TABLE\n, 1., 0., 0., 0., 1., 0.\n1, "
    )
    assert head in text
    assert max(map(len, text.splitlines())) <= 256


def test_abaqus_bricks_with_a_default_orientation(tmp_path):
    path = tmp_path / "model.inp"
    path.write_text(
        "*Heading\n a model\n** comment\n*NODE, nset=all\n" + "".join(
            f"{k + 1}, {k & 1}, {k >> 1 & 1}, {k >> 2}\n" for k in range(8)
        ) + "*Element, TYPE=C3D8\n1, 1, 2, 4, 3, 5, 6, 8, 7\n"
        "*Distribution, name=d, Location=Element, table=t\n, 0, 1, 0, 0, 0, 1\n"
    )  # fmt: skip
    points = read_points(path)
    np.testing.assert_allclose(points.positions, [[0.5, 0.5, 0.5]])
    np.testing.assert_allclose(points.fibre_direction, [[0, 1, 0]])
    np.testing.assert_allclose(points.platelet_normal, [[1, 0, 0]])


def test_vtu_of_cells_is_read_at_their_middle(tmp_path):
    import meshio

    cells = [("tetra", np.array([[0, 1, 2, 3]]))]
    corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]])
    data = {"fibre_direction": [np.array([[1.0, 0, 0]])], "platelet_normal": [np.array([[0.0, 1, 0]])]}
    meshio.Mesh(corners, cells, cell_data=data).write(tmp_path / "cells.vtu")
    np.testing.assert_allclose(read_points(tmp_path / "cells.vtu").positions, [[1, 1, 1]])


def test_each_particle_takes_its_nearest_points_frame():
    points = oriented_points("here", np.array([[0.0, 0, 0], [10, 0, 0]]), np.eye(3)[:2], np.eye(3)[[2, 2]])
    section = FileOrientation(file="x.csv", search_radius=6)
    frames = imported_frames(section, points, np.array([[1.0, 0, 0], [9, 0, 0], [4.9, 0, 0]]))
    assert angle_between_axes(frames.fibre_direction, np.eye(3)[[0, 1, 0]]).max() == 0
    with pytest.raises(SceneError, match=r"only 50.00% of the 2 particles have a point of x.csv within 6 mm"):
        imported_frames(section, points, np.array([[1.0, 0, 0], [20, 0, 0]]))


PARTICLE = "*Node\n1,0,0,0\n*Element,type=PC3D\n7,{node}\n*Distribution,location=element,name=d,table=t\n{axes}\n"
HEADER = "x1,x2,x3,p1,p2,p3,r1,r2,r3\n"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "x1,x2\n1,2\n", "no column x3, p1"),
        ("a.csv", HEADER, "holds no point"),
        ("a.csv", HEADER + "0,0,0,1,0,0,0,0,one\n", "no number"),
        ("a.csv", HEADER + "0,0,0,1,0,0,0,0,\n", "r of point 1 is not finite"),
        ("a.csv", HEADER + "0,0,0,2,0,0,0,0,1\n", "p of point 1 has length 2, must be 1"),
        ("a.csv", HEADER + "0,0,0,1,0,0,1,0,0\n", "are not perpendicular"),
        ("a.csv", "", "not readable as CSV"),
        ("a.npz", "junk", "not readable as NPZ"),
        ("a.vtu", "<junk", "not readable as VTU"),
        ("a.inp", "*Node\n1, 0, 0, 0\n", r"no \*ELEMENT that could hold fibres"),
        ("a.inp", "*Node\n1, 0, 0, zero\n", r"a.inp:2: 'zero' is no number"),
        ("a.inp", PARTICLE.format(node=1, axes="8,1,0,0,0,1,0"), r"a.inp:4: element 7 has no line in the distribution"),
        ("a.inp", PARTICLE.format(node=2, axes="7,1,0,0,0,1,0"), r"a.inp:4: element 7 refers to node 2"),
        ("a.inp", PARTICLE.format(node=1, axes="7,1,0,0"), r"a.inp:6: a line of \*DISTRIBUTION has a label and 6 or 9"),
        ("a.inp", PARTICLE.format(node=1, axes="7,1,0,0,2,0,0"), "do not settle the axes of element 7"),
        ("a.inp", "*Node\n1,0,0,0\n*Element,type=PC3D\n7,1\n", "a.inp:4: element 7: neither"),
        ("a.txt", "", "orientations are read from .csv"),
    ],
)
def test_bad_files_are_named_with_what_is_wrong(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputFileError, match=message):
        read_points(tmp_path / name)


def test_missing_file_unknown_ending_and_same_file(charge, tmp_path):
    with pytest.raises(InputFileError, match="no such file"):
        read_points(tmp_path / "nothing.csv")
    with pytest.raises(SceneError, match=r"exported to \.csv"):
        export(charge, tmp_path / "charge.stl")
    assert writer_of(tmp_path / "A.CSV")


def test_arrays_of_wrong_shape(tmp_path):
    np.savez(tmp_path / "a.npz", position=np.zeros((3, 3)), fibre_direction=np.eye(3), platelet_normal=np.eye(2))
    with pytest.raises(InputFileError, match=r"r has shape \(2, 2\), must be \(3, 3\)"):
        read_points(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", position=np.zeros((3, 3)))
    with pytest.raises(InputFileError, match="no array fibre_direction, platelet_normal; it has position"):
        read_points(tmp_path / "b.npz")


def test_command_exports_and_reports(tmp_path, capsys):
    (tmp_path / "block.yaml").write_text(SCENE.format(orientation=PLATELETS))
    arguments = [
        str(tmp_path / "block.yaml"),
        "--output",
        str(tmp_path / "c.vtkhdf"),
        "--export",
        str(tmp_path / "c.csv"),
    ]
    command([*arguments, "--export", str(tmp_path / "c.inp")], result_action="return_value")
    out = capsys.readouterr().out
    assert "192 particles in 2 layers" in out and "platelets incomplete" in out
    assert len(read_points(tmp_path / "c.csv").positions) == len(read_points(tmp_path / "c.inp").positions) == 192


def quadratic_bar() -> str:
    """Three C3D20R elements along x1, their element lines wrapped as Abaqus requires; p = x2."""
    numbers: dict[tuple[int, int, int], int] = {}
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    places = corners + [tuple((a + b) // 2 for a, b in zip(corners[i], corners[j], strict=True)) for i, j in edges]
    cells = []
    for k in range(3):
        cells.append([numbers.setdefault((x + 2 * k, y, z), len(numbers) + 1) for x, y, z in places])
    text = "*NODE\n" + "".join(f"{n}, {x}., {y}., {z}.\n" for (x, y, z), n in numbers.items())
    text += "*ELEMENT, TYPE=C3D20R, ELSET=A\n"
    for k, row in enumerate(cells, 1):
        words = [str(n) for n in (k, *row)]
        text += ", ".join(words[:16]) + ",\n" + ", ".join(words[16:]) + "\n"
    text += "*DISTRIBUTION TABLE, NAME=T\nCOORD3D, COORD3D\n*DISTRIBUTION, NAME=D, LOCATION=ELEMENT, TABLE=T\n"
    text += ", 1., 0., 0., 0., 1., 0.\n" + "".join(f"{k}, 0., 1., 0., -1., 0., 0.\n" for k in (1, 2, 3))
    return text + "*ORIENTATION, NAME=O\nD\n3, 0.\n*ELSET, ELSET=PLATELET-7, GENERATE\n1, 3, 1\n"


@pytest.mark.parametrize(
    ("old", "new", "tensor"),
    [
        ("", "", (0, 1, 0)),
        ("D\n3, 0.", "D\n3, 90.", (1, 0, 0)),
        ("D\n3, 0.", "D\n1, 90.", (0, 1, 0)),
        ("NAME=O\nD\n3, 0.", "NAME=O, SYSTEM=CYLINDRICAL\n3.,-9.,0., 3.,9.,0.\n1, 0.", None),
        ("PART", "PART", (1, 0, 0)),
    ],
    ids=["as it is", "about 3", "about 1", "cylinder", "turned instance"],
)
def test_abaqus_directions_reach_the_charge(old, new, tensor, tmp_path):
    text = quadratic_bar()
    if old == "PART":
        text = f"*PART, NAME=P\n{text}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n0,0,0\n"
        text += "3,1,0, 3,1,1, 90.\n"
        text += "*END INSTANCE\n*END ASSEMBLY\n"
    (tmp_path / "bar.inp").write_text(text.replace(old, new) if old != "PART" else text)
    (tmp_path / "bar.yaml").write_text(
        "name: bar\ncharge:\n  domain: {shape: box, size: [6, 2, 2]}\n  spacing: 0.5\n"
        "  orientation: {source: file, file: bar.inp}\n"
    )
    path = run(load_scene(tmp_path / "bar.yaml"), output=tmp_path / "o.vtkhdf")
    file = read_particles(path, "charge")
    p = file.fields["fibre_direction"]
    assert set(file.fields["platelet_id"]) == {7}
    points = read_points(tmp_path / "bar.inp")
    assert len(points.positions) == 3
    if old == "PART":
        assert np.allclose(points.positions, [[3, -1, 1], [3, 1, 1], [3, 3, 1]])
    else:
        assert np.allclose(points.positions, [[1, 1, 1], [3, 1, 1], [5, 1, 1]])
    if tensor is not None:
        assert np.allclose((p**2).mean(axis=0), tensor, atol=1e-6)
    else:  # radial from the line x1 = 3, x3 = 0 along x2
        x, z = points.positions[:, 0] - 3.0, points.positions[:, 2]
        radial = np.column_stack([x, 0 * x, z]) / np.hypot(x, z)[:, None]
        assert np.allclose(np.abs((points.fibre_direction * radial).sum(axis=1)), 1)
