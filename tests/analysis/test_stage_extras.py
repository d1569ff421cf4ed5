"""Other runs, structural meshes, cuts, moving picture and browser scene through the stage."""

from __future__ import annotations

import base64
import json
import re
import shutil
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest

from ppmc.analysis import check, stage
from ppmc.analysis.figures import movie, views
from ppmc.analysis.figures.rendering import RenderingStatus
from ppmc.analysis.mesh.mesh import read_mesh
from ppmc.analysis.output import file_names
from ppmc.analysis.stage import run_labels
from ppmc.errors import InputFileError, SceneError
from ppmc.scene import parse_scene
from tests.analysis.conftest import Chain, blank_pictures

SCENE = """
name: more
analysis:
  path: {axis: x1, slices: 6}
  paths:
    bar: {kind: swept, along: x2, sweep: x1, length: 4 mm, width: 1 mm, points: 8, centre: 4 mm}
    ring:
      {kind: circle, centre: [6, 4, 1.5], axis: [0, 0, 1], zero: [1, 0, 0], inner_radius: 1, outer_radius: 3, height: 4}
    line: {kind: line, points: [[1, 1, 1], [11, 7, 1]], radius: 1.5, steps: 5}
  views: [fibre_direction, dominant_direction, iso_surface, platelets, maps, fill_time, knit_line, difference]
  front: {axis: x3, mask: {path: volume.vtkhdf, time: 0 s}}
  cuts: {middle: {point: [0, 4, 0], normal: [0, -1, 0]}}
  interactive: true
  animation: true
  mesh:
    path: part.vtu
    method: average
    formats: [vtu, abaqus, gmsh]
    lamina:
      {axial_modulus: 140 GPa, transverse_modulus: 9 GPa, axial_poisson_ratio: 0.3, transverse_poisson_ratio: 0.4,
       shear_modulus: 5 GPa}
"""


def bricks(folder: Path) -> Path:
    """Write a 4 x 3 x 1 mesh of bricks over the squeezed block, with a line block that must be left out."""
    x, y, z = np.linspace(0, 17, 5), np.linspace(0, 11.3, 4), np.array([0, 1.5])
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)

    def node(i: int, j: int, k: int) -> int:
        return (i * 4 + j) * 2 + k

    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    cells = [[node(i + a, j + b, k) for k in (0, 1) for a, b in corners] for i in range(4) for j in range(3)]
    path = folder / "part.vtu"
    meshio.write(path, meshio.Mesh(points, [("line", np.array([[0, 1]])), ("hexahedron", np.array(cells))]))
    return path


@pytest.fixture(scope="module")
def out(chain: Chain, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("more")
    bricks(folder)
    shutil.copy(chain.volume, folder / "volume.vtkhdf")
    runs = []
    for name in ("second", "third"):
        (folder / name).mkdir()
        runs.append(Path(shutil.copy(chain.flow, folder / name / "flow.vtkhdf")))
    patch = pytest.MonkeyPatch()
    for module in (views, movie):
        patch.setattr(module, "render", blank_pictures)
    scene = parse_scene(SCENE, folder / "scene.yaml")
    stage.run(
        scene,
        input=chain.flow,
        output=folder / "out" / "analysis.vtkhdf",
        compare=runs[:1],
        seeds=runs,
        moulded=chain.orientations,
    )
    patch.undo()
    return folder / "out"


def test_equal_runs_do_not_differ(out: Path) -> None:
    table = pd.read_csv(out / "tables" / "comparisons.csv")
    assert table.run.tolist() == ["second", "CT of the part", "mask volume"]
    # The block was 12 x 8 x 3 mm, the squeezed one is 16.97 x 11.31 x 1.5 mm. Every second voxel of 0.25 mm stands for
    # 0.5 mm and begins at -0.125 mm: the scan reaches 11.875 x 7.875 mm into the quadrant that both share.
    seen = 11.875 * 7.875
    assert table.overlap[1] == pytest.approx(seen * 1.5 / (2 * 288 - seen * 1.5), abs=0.01)
    assert table.overlap_along_x3[1] == pytest.approx(seen / (192 + 96 - seen), abs=0.01)
    assert np.isnan(table.angle_mean_deg[1])
    assert table.overlap[0] == 1 and table.angle_mean_deg[0] == 0 and table.distance_p99_mm[0] == 0
    gaps = pd.read_csv(out / "tables" / "differences.csv").set_index("source")
    assert gaps.loc["second", "d_A11"] == 0 and 0.001 < abs(gaps.loc["CT of the part", "d_N33"]) < 0.05
    seeds = pd.read_csv(out / "tables" / "seeds_path_path.csv")
    assert (seeds.runs == 3).all() and seeds.sd_A11.dropna().max() < 1e-12
    assert "mean of 3 seeds" not in (out / "report.html").read_text()  # it stands in the figure, not in the text
    assert "3 runs with different seeds" in (out / "report.html").read_text()


def test_local_path_stands_beside_the_global_one(out: Path) -> None:
    table = pd.read_csv(out / "tables" / "paths.csv")
    assert {"path", "bar", "bar_local", "ring", "line"} == set(table.path)
    local = table[(table.path == "bar_local") & (table.time_s == 0)]
    assert (local.components == "a t n").all()
    plain = table[(table.path == "bar") & (table.time_s == 0)]
    # Flat part, normals along x3 within the platelets' tilt: axial is x2, transverse x1.
    assert np.nanmax(np.abs(local.A11.to_numpy() - plain.A22.to_numpy())) < 0.02


def test_mapped_mesh_opens_and_holds_everything(out: Path, chain: Chain) -> None:
    mesh = meshio.read(out / "mapped.vtu")
    data = {name: values[0] for name, values in mesh.cell_data.items()}
    assert len(mesh.cells) == 1 and len(data["fibre_direction"]) == 12
    assert data["particle_count"].sum() == chain.particles
    assert np.allclose(np.linalg.norm(data["platelet_normal"], axis=1), 1)
    assert data["stiffness_upper_Pa"].shape == (12, 21)
    assert (data["moduli_Pa"] > 3e9).all() and (data["moduli_Pa"] < 141e9).all()
    assert "*ORIENTATION" in (out / "mapped_axes.inp").read_text()
    assert (out / "mapped_CT_of_the_part.vtu").exists()


def test_json_has_both_orders_and_every_path(out: Path) -> None:
    summary = json.loads((out / "analysis.json").read_text())
    order = summary["fourth_order_indices"]
    assert order[:4] == ["1111", "1112", "1113", "1122"] and len(order) == 15
    last = next(s for s in summary["regions"][0]["sources"] if s["source"] == "flow" and s["time_s"] == 1)
    A, A4 = np.array(last["A"]), dict(zip(order, last["A_fourth"], strict=True))
    assert A4["1111"] + A4["1122"] + A4["1133"] == pytest.approx(A[0, 0])
    assert last["A_spread"][0][0] == pytest.approx((A4["1111"] - A[0, 0] ** 2) ** 0.5)
    paths = {path["name"]: path for path in summary["paths"]}
    assert set(paths) == {"path", "bar", "bar_local", "ring", "line"}
    assert paths["ring"]["components"] == ["r", "θ", "x3"]
    flow = next(s for s in paths["path"]["sources"] if s["source"] == "flow")
    assert np.array(flow["A"]).shape == (6, 3, 3) and np.array(flow["N_fourth"]).shape == (6, 15)


def test_elements_stand_in_a_table(out: Path, chain: Chain) -> None:
    table = pd.read_csv(out / "tables" / "mapped_elements.csv")
    assert table.element.tolist() == list(range(1, 13)) and table.particle_count.sum() == chain.particles
    filled = table[table.particle_count > 0]
    assert np.allclose(filled.A1111 + filled.A1122 + filled.A1133, filled.A11)
    assert (filled.sd_A11 > 0).any() and (filled.E1_Pa > 3e9).all()


def test_browser_scene_holds_its_data(out: Path, chain: Chain) -> None:
    text = (out / "scene.html").read_text()
    data = json.loads(re.search(r'type="application/json">(.*?)</script>', text, re.S).group(1))  # type: ignore[union-attr]
    assert len(base64.b64decode(data["positions"])) == chain.particles * 12
    assert [p["title"] for p in data["panels"]][:3] == ["p_1^2", "p_2^2", "p_3^2"]
    assert "http" not in text


def test_views_asked_for_are_there(out: Path) -> None:
    names = {p.stem for p in (out / "figures").iterdir()}
    assert {"fill_time", "cut_middle_flow_t1", "view_platelets_flow_t1", "view_maps_flow_t1", "filling"} <= names
    assert {"view_iso_surface_flow_t1", "difference_second", "front_second", "front_mask_volume"} <= names
    assert "No knit line" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "cannot read|no nodes"),
        (b"not a mesh at all", "cannot read|no nodes"),
        (None, "no such mesh"),
    ],
)
def test_bad_meshes_are_refused(content: bytes | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.vtu"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputFileError, match=words):
        read_mesh(path)


def test_meshes_without_elements_or_with_nan_are_refused(tmp_path: Path) -> None:
    meshio.write(tmp_path / "line.vtu", meshio.Mesh(np.zeros((2, 3)), [("line", np.array([[0, 1]]))]))
    with pytest.raises(InputFileError, match="no solid or shell"):
        read_mesh(tmp_path / "line.vtu")
    points = np.array([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]])
    meshio.write(tmp_path / "nan.vtu", meshio.Mesh(points, [("triangle", np.array([[0, 1, 2]]))]))
    with pytest.raises(InputFileError, match="not finite"):
        read_mesh(tmp_path / "nan.vtu")


def test_other_runs_need_a_flow(chain: Chain, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="only a flow"):
        stage.run(parse_scene("name: x"), input=chain.charge, output=tmp_path / "a.vtkhdf", compare=[chain.flow])


def test_figure_files_cannot_leave_their_folder() -> None:
    assert file_names(["a/b c", "../x", "a b/c", "a_b_c", "..."]) == ["a_b_c", "x", "a_b_c_2", "a_b_c_3", "figure"]
    with pytest.raises(SceneError, match="pattern"):
        parse_scene('name: x\nanalysis: {regions: {"../up": {min: [0, 0, 0], max: [1, 1, 1]}}}')


def test_check_says_what_is_ahead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "probe", lambda: RenderingStatus(False, "no EGL"))
    bricks(tmp_path)
    scene = parse_scene(
        """
name: x
charge: {domain: {shape: box, size: [12, 8, 3]}, spacing: 0.5, orientation: {source: planar_random}}
analysis:
  regions: {inside: {min: [1, 1, 1], max: [2, 2, 2]}, flange: {min: [20, 0, 0], max: [22, 8, 3]}}
  path: {axis: x1, slices: 7}
  mesh: {path: part.vtu}
""",
        tmp_path / "scene.yaml",
    )
    text = "\n".join(check.findings(scene))
    assert (
        "2 regions, 1 paths with 7" in text
        and "in region flange" in text
        and "12 elements" in text
        and "no EGL" in text
    )
    assert check.findings(parse_scene("name: y")) == []


def test_labels_tell_runs_apart() -> None:
    assert run_labels([Path("a/flow.vtkhdf"), Path("b/flow.vtkhdf")]) == ["a", "b"]
    assert run_labels([Path("a/x.vtkhdf"), Path("a/y.vtkhdf")]) == ["a/x", "a/y"]
