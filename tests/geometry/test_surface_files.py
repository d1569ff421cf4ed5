from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import pyvista

from ppmc.errors import InputFileError
from ppmc.geometry.surfaces.surface import closed_surface, points_inside, read_surface

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@pytest.fixture(scope="module")
def cube() -> pyvista.PolyData:
    return pyvista.Cube(x_length=10.0, y_length=20.0, z_length=30.0).triangulate()


@pytest.fixture(scope="module")
def facets(cube: pyvista.PolyData) -> np.ndarray:
    out = np.zeros(cube.n_cells, dtype=RECORD)
    out["corners"] = cube.points[cube.faces.reshape(-1, 4)[:, 1:]]
    return out


def write_stl(path: Path, facets: np.ndarray, count: int | None = None) -> Path:
    announced = struct.pack("<I", len(facets) if count is None else count)
    path.write_bytes(b"binary".ljust(80) + announced + facets.tobytes())
    return path


@pytest.mark.parametrize("name", ["a.stl", "text.stl", "a.ply", "a.obj", "a.vtu", "A.STL"])
def test_every_format_gives_the_same_cube(tmp_path: Path, cube: pyvista.PolyData, name: str) -> None:
    path = tmp_path / name
    if name.endswith((".obj", ".vtu")):
        pyvista.save_meshio(path, cube)
    elif name == "A.STL":
        cube.save(tmp_path / "b.stl")
        (tmp_path / "b.stl").rename(path)
    else:
        cube.save(path, binary=name != "text.stl")
    surface = read_surface(path)
    assert surface.volume == pytest.approx(6000.0, rel=1e-12)
    assert surface.area == pytest.approx(2 * (200 + 600 + 300), rel=1e-12)
    assert len(surface.points) == 8


def test_quadrilaterals_are_split(tmp_path: Path) -> None:
    quads = pyvista.Cube(x_length=4.0, y_length=4.0, z_length=4.0).clean()
    pyvista.save_meshio(tmp_path / "quads.vtu", quads)
    assert read_surface(tmp_path / "quads.vtu").volume == pytest.approx(64.0)


def test_unit_and_scale(tmp_path: Path, facets: np.ndarray) -> None:
    small = facets.copy()
    small["corners"] *= np.float32(1e-3)
    path = write_stl(tmp_path / "metres.stl", small)
    assert read_surface(path, unit="m").volume == pytest.approx(6000.0, rel=1e-5)
    assert read_surface(path, unit="m", scale=2.0).volume == pytest.approx(48000.0, rel=1e-5)
    assert read_surface(path, unit="mm").volume == pytest.approx(6e-6, rel=1e-5)


def faulty(kind: str, facets: np.ndarray, path: Path) -> Path:
    """Write one faulty STL file."""
    bad = facets.copy()
    corners = bad["corners"]
    if kind == "empty":
        path.write_bytes(b"")
        return path
    if kind == "random":
        path.write_bytes(np.random.default_rng(0).bytes(5000))
        return path
    if kind == "truncated":
        write_stl(path, bad)
        path.write_bytes(path.read_bytes()[:300])
        return path
    if kind == "huge count":
        return write_stl(path, bad, 0xFFFFFFFF)
    if kind == "cut text":
        path.write_text("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0\n")
        return path
    if kind == "nan":
        corners[0, 0, 0] = np.nan
    elif kind == "open":
        bad = bad[1:]
    elif kind == "inverted":
        bad["corners"] = corners[:, ::-1]
    elif kind == "one flipped":
        corners[0] = corners[0, ::-1].copy()
    elif kind == "doubled face":
        bad = np.concatenate([bad, bad[:1]])
    elif kind == "metres":
        corners *= np.float32(1e-3)
    elif kind == "micrometres":
        corners *= np.float32(1e3)
    elif kind == "crossing":
        other = facets.copy()
        other["corners"] += np.float32([3.0, 3.3, 3.7])
        bad = np.concatenate([bad, other])
    elif kind == "inverted second body":
        other = facets.copy()
        other["corners"] = 0.5 * other["corners"][:, ::-1] + np.float32([30.0, 0.0, 0.0])
        bad = np.concatenate([bad, other])
    elif kind == "flat":
        corners[..., 2] *= 0.0
    elif kind == "no triangles":
        bad = bad[:0]
    return write_stl(path, bad)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("empty", "empty; export"),
        ("truncated", "truncated"),
        ("huge count", "announces 4,294,967,295 triangles"),
        ("random", "no STL file"),
        ("cut text", "not a readable STL"),
        ("no triangles", "no triangles"),
        ("nan", "not finite"),
        ("open", "open: 3 edges"),
        ("inverted", "inside out"),
        ("one flipped", "disagree in orientation at 3 edges"),
        ("doubled face", "not manifold: 3 edges"),
        ("crossing", "crosses itself"),
        ("inverted second body", "body 2 of 2"),
        ("flat", "not manifold"),
    ],
)
def test_each_fault_has_its_message(tmp_path: Path, facets: np.ndarray, kind: str, message: str) -> None:
    path = faulty(kind, facets, tmp_path / "bad.stl")
    with pytest.raises(InputFileError, match=message) as caught:
        read_surface(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.obj", "hello world\n", "no vertices"),
        ("a.ply", "ply\nformat ascii 1.0\n", "complete header"),
        ("a.ply", "hello\n", "complete header"),
        ("a.vtu", "<VTKFile>", "not a readable VTU"),
        ("a.step", "ISO-10303", "convert"),
    ],
)
def test_damaged_files_of_other_formats(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputFileError, match=message):
        read_surface(tmp_path / name)


def test_missing_file_and_volume_cells(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such surface file"):
        read_surface(tmp_path / "none.stl")
    pyvista.save_meshio(tmp_path / "solid.vtu", pyvista.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid())
    with pytest.raises(InputFileError, match="needs triangles"):
        read_surface(tmp_path / "solid.vtu")


@pytest.mark.parametrize(("kind", "unit"), [("metres", "m"), ("micrometres", "um")])
def test_a_size_that_speaks_for_another_unit_is_told_and_read(
    kind: str, unit: str, tmp_path: Path, facets: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    path = faulty(kind, facets, tmp_path / f"{kind}.stl")
    factor = {"m": 1e-9, "um": 1e9}[unit]
    assert read_surface(path).volume == pytest.approx(6000.0 * factor, rel=1e-5)
    assert f"set `unit: {unit}`" in capsys.readouterr().err
    read_surface(path, unit="mm")
    assert capsys.readouterr().err == ""


CUBE = np.array([[x, y, z] for x in (0, 10) for y in (0, 8) for z in (0, 6)], dtype=float)
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
SPLIT = [t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]


def text_stl(end: str = "\n") -> str:
    lines = ["solid cube"]
    for t in SPLIT:
        lines += ["  facet normal 0 0 0", "    outer loop"]
        lines += [f"      vertex {' '.join(f'{v:.6e}' for v in CUBE[i])}" for i in t]
        lines += ["    endloop", "  endfacet"]
    return end.join([*lines, "endsolid cube", ""])


def binary_stl(header: bytes = b"binary", count: int = len(SPLIT)) -> bytes:
    records = np.zeros(len(SPLIT), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    records["v"] = CUBE[np.array(SPLIT)]
    return header.ljust(80) + np.uint32(count).tobytes() + records.tobytes()


def text_obj(faces: str, extra: str = "", colour: str = "") -> bytes:
    return ("".join(f"v {x} {y} {z}{colour}\n" for x, y, z in CUBE.tolist()) + extra + faces).encode()


def faces(form: str, shift: int = 1) -> str:
    return "".join("f " + " ".join(form.format(i + shift) for i in quad) + "\n" for quad in QUADS)


def text_ply(name: str = "vertex_indices", end: str = "\n") -> bytes:
    head = ["ply", "format ascii 1.0", "element vertex 8", *(f"property float {c}" for c in "xyz"), "element face 12"]
    head += [f"property list uchar int {name}", "end_header"]
    rows = [" ".join(map(str, x)) for x in CUBE.tolist()] + ["3 " + " ".join(map(str, t)) for t in SPLIT]
    return end.join([*head, *rows, ""]).encode()


BOM = b"\xef\xbb\xbf"


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("capitals.stl", text_stl().upper().encode()),
        ("mark.stl", BOM + text_stl().encode()),
        ("mark.stl", text_stl().encode("utf-16")),
        ("returns.stl", text_stl("\r").encode()),
        ("long_name.stl", ("solid " + "x" * 2000 + text_stl()[10:]).encode()),
        ("latin.stl", text_stl().replace("cube", "w\xfcrfel").encode("latin-1")),
        ("fortran.stl", text_stl().replace("e+", "D+").encode()),
        ("trailing.stl", text_stl().encode() + b"\0" * 100),
        ("two_bytes_more.stl", binary_stl() + b"\r\n"),
        ("padded.stl", binary_stl() + b"\0" * 4096),
        ("says_solid.stl", binary_stl(b"solid facet x")),
        ("says_solid.stl", binary_stl(b"SOLID facet x") + b"\n"),
        ("capitals.obj", text_obj(faces("{}")).upper()),
        ("mark.obj", BOM + text_obj(faces("{}"))),
        ("backwards.obj", text_obj(faces("{}", -8))),
        ("textured.obj", text_obj(faces("{}/1/1"), "vn 0 0 1\nvt 0 0\ng side\nusemtl m\ns off\n")),
        ("normals.obj", text_obj(faces("{}//1"), "o a\nvn 0 0 1 # up\n")),
        ("coloured.obj", text_obj(faces("{}"), colour=" 0.5 0.5 0.5")),
        ("mark.ply", BOM + text_ply()),
        ("capitals.ply", text_ply().replace(b"ply\n", b"PLY\n")),
        ("index.ply", text_ply("vertex_index")),
        ("returns.ply", text_ply(end="\r\n") + b"\r\n"),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_what_programs_really_write_is_the_same_cuboid(name: str, data: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    surface = read_surface(tmp_path / name)
    assert surface.volume == pytest.approx(480.0, rel=1e-12)
    assert len(surface.triangles) == 12 and len(surface.points) == 8


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("points.stl", binary_stl()[:80] + np.uint32(1).tobytes() + bytes(50), "all triangles are degenerate"),
        ("short.stl", binary_stl()[:-3], "announces 12 triangles .* has 681 bytes"),
        ("two.stl", binary_stl() + binary_stl(), "more than one solid"),
        ("none.stl", binary_stl(count=0), "announces 0 triangles"),
        ("cut.stl", text_stl().encode()[:-300], "truncated"),
        ("comma.stl", text_stl().replace("1.000000e+01", "10,0").encode(), "'10,0' in a vertex is no number"),
        ("zero.obj", text_obj("f 0 1 2\n"), "zero.obj:9: '0' in a face is no vertex number"),
        ("flat.obj", b"v 1 2\n", "has 2 coordinates"),
        ("beyond.obj", text_obj("f 1 2 99\n"), "refers to vertex 98"),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_what_cannot_be_the_whole_surface_is_refused(name: str, data: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputFileError, match=message):
        read_surface(tmp_path / name)


def test_nearly_equal_vertices_are_merged(cube: pyvista.PolyData) -> None:
    faces = cube.faces.reshape(-1, 4)[:, 1:]
    loose = cube.points[faces].reshape(-1, 3).astype(float)
    loose += np.random.default_rng(1).uniform(-3e-6, 3e-6, loose.shape)
    surface = closed_surface(loose, np.arange(len(loose)).reshape(-1, 3))
    assert len(surface.points) == 8
    assert surface.volume == pytest.approx(6000.0, rel=1e-5)


def test_a_void_in_a_body_is_outside(cube: pyvista.PolyData) -> None:
    faces = cube.faces.reshape(-1, 4)[:, 1:]
    points = np.concatenate([cube.points, 0.5 * cube.points]).astype(float)
    surface = closed_surface(points, np.concatenate([faces, faces[:, ::-1] + len(cube.points)]))
    assert surface.volume == pytest.approx(6000.0 * (1 - 1 / 8))
    inside = points_inside(surface, [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [6.0, 0.0, 0.0]])
    assert inside.tolist() == [False, True, False]


def test_inside_at_edges_and_vertices_of_the_mesh() -> None:
    # Every line of this grid runs through vertices and along edges of the cube's triangles.
    cube = pyvista.Box(bounds=(0.0, 4.0, 0.0, 4.0, 0.0, 4.0), level=3).triangulate().clean()
    surface = closed_surface(cube.points, cube.faces.reshape(-1, 4)[:, 1:])
    axis = np.arange(-1.0, 5.5, 0.5)
    points = np.array(np.meshgrid(axis, axis, axis)).reshape(3, -1).T
    clear = np.all((points > 0) & (points < 4), axis=1)
    away = np.any((points < 0) | (points > 4), axis=1)
    inside = points_inside(surface, points)
    assert inside[clear].all()
    assert not inside[away].any()
