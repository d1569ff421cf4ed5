from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ppmc.analysis import stage
from ppmc.analysis.averages.sources import flow_source
from ppmc.analysis.figures import rendering, views
from ppmc.analysis.figures.rendering import Rendered
from ppmc.errors import InputFileError, SceneError
from ppmc.files import SeriesWriter, open_series
from ppmc.files.provenance import file_digest
from ppmc.orientation import push_affine
from ppmc.scene import Scene, parse_scene
from tests.analysis.conftest import Chain, blank_pictures

SCENE = """
name: small
analysis:
  regions:
    middle: {min: [3, 2, 0.5], max: [9, 6, 2.5]}
    far: {min: ["9 cm", 0, 0], max: [95, 1, 1]}
  path: {axis: x1, slices: 8}
"""


@pytest.fixture(autouse=True)
def without_vtk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "render", blank_pictures)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return parse_scene(SCENE)


@pytest.fixture(scope="module")
def whole(chain: Chain, scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    patch = pytest.MonkeyPatch()
    patch.setattr(views, "render", lambda jobs: Rendered([None] * len(jobs), "not in this test"))
    output = tmp_path_factory.mktemp("out") / "analysis.vtkhdf"
    stage.run(scene, input=chain.flow, output=output, volume=chain.volume, orientations=chain.orientations)
    patch.undo()
    return output


def test_report_needs_no_network_and_says_what_matters(whole: Path) -> None:
    text = (whole.parent / "report.html").read_text()
    assert not re.search(r'(src|href)="(?!data:|#)', text)
    assert "@import" not in text and "<script" not in text
    expected = ("beside the phantom", "Region &#x27;far", "empty", "J = det F", "matplotlib", "SHA-256", "Press force")
    for words in expected:
        assert words in text
    assert text.count("<figcaption>") == text.count("<img") >= 6


def test_captions_name_units_region_and_counts(whole: Path, chain: Chain) -> None:
    text = (whole.parent / "report.html").read_text()
    for caption in re.findall(r"<figcaption>(.*?)</figcaption>", text):
        assert re.search(r"\[(–|N|s)\]", caption), caption
        assert re.search(r"\d[\d,]* (particles|voxels|points|values)", caption), caption
    assert f"{chain.particles:,}" in text


def test_tables_agree_with_the_affine_squeeze(whole: Path, chain: Chain) -> None:
    table = pd.read_csv(whole.parent / "tables" / "regions.csv")
    flow = table[(table.source == "flow") & (table.region == "whole")].set_index("time_s")
    with open_series(chain.flow, "flow") as file:
        p0 = file.frame(0)["fibre_direction"]
    p1 = push_affine(p0, np.broadcast_to(chain.deformation_gradient, (len(p0), 3, 3)))
    for i in range(3):
        assert flow.loc[0.0, f"A{i + 1}{i + 1}"] == pytest.approx((p0[:, i] ** 2).mean(), abs=1e-8)
        assert flow.loc[1.0, f"A{i + 1}{i + 1}"] == pytest.approx((p1[:, i] ** 2).mean(), abs=1e-8)
    far = table[table.region == "far"]
    assert (far.particle_count == 0).all() and far.A11.isna().all()
    motion = pd.read_csv(whole.parent / "tables" / "kinematics.csv")
    assert motion.F11_mean.iloc[-1] == pytest.approx(2**0.5, abs=1e-8)
    assert motion.J_mean.iloc[-1] == pytest.approx(1)
    force = pd.read_csv(whole.parent / "tables" / "press_force.csv")
    assert force.press_N.tolist() == [2, 3, 4]


def test_extent_is_that_of_the_deformed_particles(chain: Chain) -> None:
    with open_series(chain.flow, "flow") as file:
        source = flow_source(file, -1)
    assert np.allclose(source.upper - source.lower, [12 * 2**0.5, 8 * 2**0.5, 1.5])


def test_ct_stands_beside_truth(whole: Path) -> None:
    summary = json.loads((whole.parent / "analysis.json").read_text())
    rows = {row["source"]: row for row in summary["truth"]["rows"]}
    assert rows["phantom truth"]["largest_difference"] == 0
    assert 0 < rows["CT"]["largest_difference"] < 0.03
    assert rows["CT"]["particle_count"] > 100
    assert rows["flow, t = 1 s"]["A"][2][2] < rows["flow, t = 0 s"]["A"][2][2]
    # Gaussian noise of 0.03 in each component: mean tilt 0.03 sqrt(pi/2) rad.
    assert summary["truth"]["fibre_angle_error_deg"]["mean"] == pytest.approx(
        np.degrees(0.03 * np.sqrt(np.pi / 2)), rel=0.1
    )


def test_analysis_file_meets_its_contract(whole: Path) -> None:
    with open_series(whole, "analysis") as file:
        assert file.times.tolist() == [0.0, 1.0]
        assert file.n == 3 + 8
        last = file.frame(-1)
        assert file.extra["region_names"][:3] == ["whole", "middle", "far"]
        assert last["particle_count"][2] == 0 and np.isnan(last["fibre_tensor"][2]).all()
        assert np.allclose(last["fibre_tensor"][0, :3].sum(), 1)
        assert abs(last["principal_normal_direction"][0, 2]) > 0.99


@pytest.mark.parametrize("name", ["charge", "orientations"])
def test_a_single_product_is_enough(name: str, chain: Chain, scene: Scene, tmp_path: Path) -> None:
    output = tmp_path / "analysis.vtkhdf"
    stage.run(scene, input=getattr(chain, name), output=output)
    table = pd.read_csv(tmp_path / "tables" / "regions.csv")
    assert len(table) == 3 and table.time_s.isna().all()
    assert "Deformation and volume" not in (tmp_path / "report.html").read_text()


def test_every_frame_on_request(chain: Chain, tmp_path: Path) -> None:
    scene = parse_scene("name: all\nanalysis: {frames: all, views: []}")
    stage.run(scene, input=chain.flow, output=tmp_path / "analysis.vtkhdf")
    with open_series(tmp_path / "analysis.vtkhdf", "analysis") as file:
        assert file.times.tolist() == [0, 0.5, 1]
    assert (tmp_path / "figures" / "history_whole.png").exists()


def test_one_time_step_without_normals_or_forces_is_shown_as_such(chain: Chain, tmp_path: Path) -> None:
    with open_series(chain.flow, "flow") as file:
        frame = file.frame(0)
        names = ("fibre_direction", "deformation_gradient", "volume_ratio", "velocity", "pressure")
        writer = SeriesWriter.create(
            tmp_path / "partial.vtkhdf", file.n, file.static, names, (), provenance=file.provenance
        )
        writer.append(0.0, frame["position"], {name: frame[name] for name in names})
        writer.seal(tmp_path / "flow.vtkhdf")
    scene = parse_scene("name: one\nanalysis: {views: [fibre_direction, platelet_normal, fill_time]}")
    stage.run(scene, input=tmp_path / "flow.vtkhdf", output=tmp_path / "analysis.vtkhdf")
    text = (tmp_path / "report.html").read_text()
    for words in ("one time step only", "N is not known", "no press-force curve"):
        assert words in text
    table = pd.read_csv(tmp_path / "tables" / "regions.csv")
    assert len(table) == 1 and table.N11.isna().all() and table.A11.notna().all()
    assert not (tmp_path / "tables" / "press_force.csv").exists()


def test_what_cannot_be_shown_is_said(chain: Chain, tmp_path: Path) -> None:
    scene = parse_scene("""
name: away
analysis:
  paths:
    away: {kind: circle, centre: [500, 0, 0], inner_radius: 1, outer_radius: 2, height: 1}
    here: {kind: straight, slices: 3}
  views: [fibre_direction, fill_time]
  cuts: {beyond: {point: [-99, 0, 0], normal: [1, 0, 0]}}
""")
    stage.run(scene, input=chain.charge, output=tmp_path / "analysis.vtkhdf")
    text = (tmp_path / "report.html").read_text()
    for words in ("Path &#x27;away&#x27; meets no point", "show: fill_time", "Cut &#x27;beyond&#x27; leaves no"):
        assert words in text
    assert "&#x27;here&#x27; meets" not in text
    table = pd.read_csv(tmp_path / "tables" / "paths.csv")
    assert (table[table.path == "away"].particle_count == 0).all() and table[table.path == "away"].A11.isna().all()


def test_every_input_is_named_with_its_digest(chain: Chain, tmp_path: Path) -> None:
    other = tmp_path / "other" / "flow.vtkhdf"
    other.parent.mkdir()
    with open_series(chain.flow, "flow") as file:
        frame = file.frame(-1)
        names = ("fibre_direction", "deformation_gradient", "volume_ratio", "velocity", "pressure")
        writer = SeriesWriter.create(
            tmp_path / "partial.vtkhdf", file.n, file.static, names, (), provenance=file.provenance
        )
        writer.append(0.0, frame["position"] + 1.0, {name: frame[name] for name in names})
        writer.seal(other)
    scene = parse_scene("name: two\nanalysis: {views: []}")
    stage.run(scene, input=chain.flow, output=tmp_path / "out" / "analysis.vtkhdf", seeds=[other])
    inputs = json.loads((tmp_path / "out" / "analysis.json").read_text())["inputs"]
    assert inputs == {"flow.vtkhdf": file_digest(chain.flow), "other/flow.vtkhdf": file_digest(other)}


def test_same_input_gives_the_same_bytes(chain: Chain, tmp_path: Path) -> None:
    scene = parse_scene("name: twice\nanalysis: {views: []}")
    for k in "ab":
        stage.run(scene, input=chain.charge, output=tmp_path / k / "analysis.vtkhdf")
    assert (tmp_path / "a" / "report.html").read_bytes() == (tmp_path / "b" / "report.html").read_bytes()


def test_wrong_inputs_are_refused(chain: Chain, scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="--volume"):
        stage.run(scene, input=chain.volume, output=tmp_path / "a.vtkhdf")
    with pytest.raises(InputFileError, match="no such file"):
        stage.run(scene, input=tmp_path / "none.vtkhdf", output=tmp_path / "a.vtkhdf")
    with pytest.raises(SceneError, match="same file"):
        stage.run(scene, input=chain.flow, output=chain.flow)


def test_rendering_failure_is_a_reason_not_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering.sys, "executable", "/nonexistent/python")
    assert "could not start" in rendering.probe().reason
    monkeypatch.undo()
    status = rendering.probe({"VTK_DEFAULT_OPENGL_WINDOW": "vtkXOpenGLRenderWindow", "LIBGL_ALWAYS_SOFTWARE": "1"})
    assert status.available or status.reason
