"""Every notebook of the docs runs and keeps its own promises (each ends in assertions)."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from ppmc.analysis.explore import scene_paths
from ppmc.files import Provenance, SeriesWriter
from ppmc.orientation import push_affine
from ppmc.scene import parse_scene

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
SLOW = {"ct_validation"}  # compiles the kernels of the CT stage


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(path.stem, marks=pytest.mark.slow if path.stem in SLOW else ())
        for path in sorted(FOLDER.glob("*.py"))
    ],
)
def test_notebook(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("PPMC_BRACKET_FLOW", "PPMC_DOME_FLOW"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(FOLDER / f"{name}.py"))


SCENES = {
    "bracket": ("PPMC_BRACKET_FLOW", """
name: run
tooling: {ram: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}}
analysis:
  paths:
    base: {kind: straight, axis: x1, slices: 5}
    hole: {kind: circle, centre: [2, 4, 5], inner_radius: 1, outer_radius: 4, height: 4, points: 12}
"""),
    "double_dome": ("PPMC_DOME_FLOW", """
name: run
tooling: {lower: {shape: plane, point: [0, 0, 0], normal: [0, 1, 0]}}
analysis: {paths: {across: {kind: swept, along: x3, sweep: x1, length: 10, width: 1, centre: 5, points: 4}}}
"""),
}  # fmt: skip


def write_run(folder: Path, text: str) -> Path:
    """Write planar random fibres in the x1-x3 plane, stretched by 2 along x3, with their scene."""
    rng = np.random.default_rng(7)
    n, F = 4000, np.diag([1.0, 0.5, 2.0])
    x, angle = rng.uniform(0, [4, 8, 10], (n, 3)), rng.uniform(0, np.pi, n)
    p = np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    origin = Provenance.collect("test", scene=parse_scene(text))
    static = {"platelet_id": np.arange(n), "reference_position": x, "volume": np.full(n, 0.08)}
    names = ("fibre_direction", "platelet_normal", "deformation_gradient", "volume_ratio", "velocity", "pressure")
    writer = SeriesWriter.create(folder / "partial.vtkhdf", n, static, names, provenance=origin)
    for time, f in ((0.0, np.eye(3)), (1.0, F)):
        every = np.broadcast_to(f, (n, 3, 3))
        values = {
            "fibre_direction": push_affine(p, every),
            "platelet_normal": np.tile([0.0, 1.0, 0.0], (n, 1)),
            "deformation_gradient": every.reshape(n, 9),
            "volume_ratio": np.ones(n),
            "velocity": np.zeros((n, 3)),
            "pressure": np.zeros(n),
        }
        writer.append(time, x @ f.T, values)
    writer.seal(folder / "flow.vtkhdf")
    return folder / "flow.vtkhdf"


def test_paths_of_a_file_are_those_of_its_scene(tmp_path: Path) -> None:
    paths = scene_paths(write_run(tmp_path, SCENES["double_dome"][1]))
    assert list(paths) == ["across", "across_local"]
    assert np.allclose(paths["across_local"].frames, [[0, 0, 1], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("name", SCENES)
def test_notebooks_take_a_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    variable, text = SCENES[name]
    monkeypatch.setenv(variable, str(write_run(tmp_path, text)))
    monkeypatch.chdir(tmp_path)
    found = runpy.run_path(str(FOLDER / f"{name}.py"))
    printed = capsys.readouterr().out
    assert "Solver run" in printed and "Closed form only" not in printed
    if name == "double_dome":
        # λ = 2 of planar random fibres: A_aa = 2/3.
        assert found["grown"] == pytest.approx(2)
        assert np.nanmean(found["found"].fibre_tensor[:, 0, 0]) == pytest.approx(2 / 3, abs=0.02)
    else:
        assert [ring.name for ring in found["rings"]] == ["hole"]


def test_index_lists_every_notebook() -> None:
    listed = (FOLDER / "index.md").read_text().splitlines()
    assert {path.stem for path in FOLDER.glob("*.py")} <= set(listed)
