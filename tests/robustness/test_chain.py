"""The whole chain on a small scene: every file opens in VTK, reruns skip, equal runs give equal bytes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ppmc.chain import is_current, links, run_chain
from ppmc.cli import _run
from ppmc.files import FIELDS, open_series
from ppmc.files.describe import describe_file, verify_file
from ppmc.files.verdict import verdict_of
from ppmc.scene import Scene, load_scene, run_paths

SCENE = (Path(__file__).parents[2] / "pipelines" / "faults" / "chain.yaml").read_text()
PRODUCTS = ("volume", "orientations", "charge", "flow", "analysis")


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Path]:
    folder = tmp_path_factory.mktemp("chain")
    (folder / "scene.yaml").write_text(SCENE)
    scene = load_scene(folder / "scene.yaml")
    run_chain(scene, workdir=folder / "run")
    return scene, folder / "run"


def test_every_file_is_there_and_sound(done: tuple[Scene, Path]) -> None:
    scene, folder = done
    for product in PRODUCTS:
        path = getattr(run_paths(scene, folder), product)
        assert verify_file(path)
        text = describe_file(path)
        assert product in text and "scene 'small'" in text
        for field in FIELDS[product]:
            if field.required:
                assert f"{field.name} / {field.unit}: " in text
    left = {p.name for p in folder.iterdir()} - {f"{p}.vtkhdf" for p in PRODUCTS}
    assert "report.html" in left
    assert not [name for name in left if "partial" in name or "checkpoint" in name or name.endswith(".tmp")]


@pytest.mark.parametrize("product", PRODUCTS)
def test_vtk_shows_its_vectors(done: tuple[Scene, Path], product: str) -> None:
    import pyvista

    scene, folder = done
    mesh = pyvista.read(getattr(run_paths(scene, folder), product))
    name = "principal_fibre_direction" if product == "analysis" else "fibre_direction"
    assert mesh.n_points > 0
    assert mesh.point_data[name].shape == (mesh.n_points, 3)
    if product not in ("volume", "analysis"):
        assert np.allclose(np.linalg.norm(mesh.point_data[name], axis=1), 1.0, atol=1e-3)


def test_unchanged_stages_are_skipped(done: tuple[Scene, Path], capsys: pytest.CaptureFixture[str]) -> None:
    scene, folder = done
    before = {p: p.stat().st_mtime_ns for p in folder.iterdir() if p.suffix == ".vtkhdf"}
    run_chain(scene, workdir=folder)
    assert capsys.readouterr().err.count("unchanged") == 5
    assert {p: p.stat().st_mtime_ns for p in before} == before


def test_a_change_runs_what_depends_on_it(done: tuple[Scene, Path]) -> None:
    scene, folder = done
    assert scene.material is not None
    material = scene.material.model_copy(update={"anisotropy_ratio": 30.0})
    changed = scene.model_copy(update={"material": material})
    state = {link.name: is_current(link, changed) for link in links(changed, run_paths(changed, folder))}
    assert state == {"phantom": True, "ct": True, "charge": True, "solve": False, "analyze": True}
    reseeded = scene.model_copy(update={"seed": 12})
    state = {link.name: is_current(link, reseeded) for link in links(reseeded, run_paths(reseeded, folder))}
    assert state["phantom"] is False and state["ct"] is True


def test_equal_runs_give_equal_bytes(done: tuple[Scene, Path], tmp_path: Path) -> None:
    scene, folder = done
    run_chain(scene, workdir=tmp_path, until="solve")
    for product in ("volume", "orientations", "charge", "flow"):
        name = f"{product}.vtkhdf"
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), product


def test_flow_keeps_volume_and_height(done: tuple[Scene, Path]) -> None:
    scene, folder = done
    with open_series(run_paths(scene, folder).flow, "flow") as flow:
        assert np.allclose(flow.times, [0.0, 0.025, 0.05])
        last = flow.frame(-1)
        assert abs(np.average(last["volume_ratio"], weights=flow.static["volume"]) - 1.0) < 5e-3
        F = last["deformation_gradient"].reshape(-1, 3, 3)
        assert abs(np.average(F[:, 2, 2], weights=flow.static["volume"]) - 2.35 / 2.4) < 0.003
        assert (flow.history["press_force"][-3:] > 0).all() if "press_force" in flow.history else True


def test_files_that_the_analysis_names_are_watched(tmp_path: Path) -> None:
    """Another mesh or another mask means another analysis."""
    (tmp_path / "part.vtu").write_text("one")
    (tmp_path / "front.png").write_text("two")
    text = SCENE.replace(
        "slices: 3}", "slices: 3}, mesh: {path: part.vtu}, front: {mask: {path: front.png, pixel: 0.1 mm}}"
    )
    (tmp_path / "scene.yaml").write_text(text)
    scene = load_scene(tmp_path / "scene.yaml")
    *_, analysis = links(scene, run_paths(scene, tmp_path / "run"))
    assert {path.name for path in analysis.inputs} >= {"flow.vtkhdf", "part.vtu", "front.png"}


def test_the_report_begins_with_the_verdict(done: tuple[Scene, Path]) -> None:
    scene, folder = done
    verdict = verdict_of(run_paths(scene, folder).flow)
    assert verdict is not None and verdict.passed
    page = (folder / "report.html").read_text()
    assert 'href="#s1">Verdict</a>' in page
    assert page.index("The flow passed: all 12 limits kept.") < page.index("Overview</h2>")
    told = json.loads((folder / "analysis.json").read_text())["verdict"]
    assert told == json.loads(json.dumps(verdict.as_facts()))


def test_a_strict_run_writes_everything_and_ends_with_4(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A solve that may not iterate breaks a limit; run again, nothing is computed and the answer is the same."""
    text = SCENE[: SCENE.index("phantom:")] + SCENE[SCENE.index("charge:") :]
    text = text.replace("{source: ct, fallback: {source: nearest}}", "{source: planar_random}")
    text = text.replace("end_time: 0.05 s, output_interval: 0.025 s", "end_time: 0.02 s, max_iterations: 8")
    (tmp_path / "scene.yaml").write_text(text)
    arguments = ["run", str(tmp_path / "scene.yaml"), "--workdir", str(tmp_path / "run")]
    assert _run([*arguments, "--strict"]) == 4
    assert "takes no broken limit: unconverged solves" in capsys.readouterr().err
    page = (tmp_path / "run" / "report.html").read_text()
    assert page.index("NOT PASSED: 1 of 12 limits not kept") < page.index("Overview</h2>")
    assert _run([*arguments, "--strict"]) == 4
    told = capsys.readouterr().err
    assert told.count("unchanged") == 3 and "verdict NOT PASSED" in told
    assert _run([*arguments, "--strict", "--only", "charge"]) == 0
    assert _run(arguments) == 0
