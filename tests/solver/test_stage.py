"""The stage and its command: files, acceptance of the squeeze, restart, stop requests, refusals."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ppmc.errors import NumericalError, SceneError, StoppedWithCheckpoint
from ppmc.files import Provenance, open_series, write_particles
from ppmc.scene import parse_scene
from ppmc.solver.run.checkpoint import checkpoint_paths
from ppmc.solver.run.simulation import Simulation
from ppmc.solver.stage import run

from .blocks import lattice

SCENE = """
name: squeeze
tooling:
  lower: {{shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}}
  ram: {{shape: plane, point: [0, 0, {height} mm], normal: [0, 0, -1], motion: {{velocity: [0, 0, "-3 mm/s"]}}}}
material: {{model: {material}}}
solver: {{end_time: {end} s, output_interval: 0.25 s}}
"""
NEWTONIAN = "newtonian, shear_viscosity: 5.36 Pa*s"
FIBRES = "transversely_isotropic, shear_viscosity: 5.36 Pa*s, anisotropy_ratio: 100"


def scene_text(material: str = NEWTONIAN, end: float = 1.0, height: float = 6.0) -> str:
    return SCENE.format(material=material, end=end, height=height)


def write_charge(path: Path, shape: tuple[int, int, int]) -> Path:
    positions = lattice(shape)
    n = len(positions)
    frame = {
        "fibre_direction": [0.6, 0.8, 0.0],
        "in_plane_direction": [-0.8, 0.6, 0.0],
        "platelet_normal": [0.0, 0.0, 1.0],
    }
    fields = {name: np.tile(vector, (n, 1)) for name, vector in frame.items()}
    fields |= {"volume": np.ones(n), "platelet_id": np.zeros(n, dtype=np.int64)}
    write_particles(
        path, "charge", positions, fields, provenance=Provenance.collect("test"), extra={"spacing": [1.0, 1.0, 1.0]}
    )
    return path


@pytest.fixture
def charge(tmp_path: Path) -> Path:
    return write_charge(tmp_path / "charge.vtkhdf", (5, 5, 6))


def test_isotropic_squeeze_through_the_command_line(tmp_path: Path):
    charge = write_charge(tmp_path / "charge.vtkhdf", (10, 10, 6))
    (tmp_path / "scene.yaml").write_text(scene_text())
    flow = tmp_path / "flow.vtkhdf"
    command = [
        sys.executable,
        "-m",
        "ppmc.cli",
        "solve",
        str(tmp_path / "scene.yaml"),
        "--input",
        str(charge),
        "--output",
        str(flow),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "ETA" in done.stderr
    with open_series(flow, "flow") as series:
        np.testing.assert_allclose(series.times, [0.0, 0.25, 0.5, 0.75, 1.0])
        last = series.frame(-1)
        mean = last["deformation_gradient"].mean(axis=0).reshape(3, 3)
        exact = np.diag([2.0**0.5, 2.0**0.5, 0.5])
        np.testing.assert_allclose(mean, exact, atol=0.01 * 2.0**0.5)
        np.testing.assert_allclose(np.diag(mean), np.diag(exact), rtol=0.01)
        assert last["volume_ratio"].mean() == pytest.approx(1.0, abs=5e-3)
        force = series.history["press_force"][-1]
        assert force == pytest.approx(3.0 * 5.36 * 1.0 * 200.0, rel=0.05)
        assert series.history["time"][-1] == 1.0
        np.testing.assert_allclose(series.static["reference_position"], lattice((10, 10, 6)))
        # The middle of the block is well packed.
        middle = np.all(np.abs(last["position"] - last["position"].mean(axis=0)) < [3.0, 3.0, 1.0], axis=1)
        np.testing.assert_allclose(last["packing"][middle], 1.0, atol=0.05)
    assert not list(tmp_path.glob("*.partial*")) and not list(tmp_path.glob("*.h5ckpt"))
    assert len((tmp_path / "flow.steps.csv").read_text().splitlines()) == len(np.unique(series.history["time"])) + 1


def test_a_resumed_run_equals_an_unbroken_one_bit_for_bit(
    tmp_path: Path, charge: Path, monkeypatch: pytest.MonkeyPatch
):
    scene = parse_scene(scene_text(FIBRES, end=0.5))
    unbroken = run(scene, input=charge, output=tmp_path / "unbroken.vtkhdf")
    broken = tmp_path / "broken.vtkhdf"
    step, taken = Simulation._step, []

    def stopping_step(self: Simulation, target: float) -> None:
        step(self, target)
        taken.append(self.time)
        if len(taken) in (4, 9):
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(Simulation, "_step", stopping_step)
    for _ in range(2):
        with pytest.raises(StoppedWithCheckpoint, match="SIGTERM"):
            run(scene, input=charge, output=broken)
        assert not broken.exists()
        assert any(path.exists() for path in checkpoint_paths(broken))
    run(scene, input=charge, output=broken)
    with open_series(unbroken, "flow") as a, open_series(broken, "flow") as b:
        np.testing.assert_array_equal(a.times, b.times)
        for k in range(len(a.times)):
            first, second = a.frame(k), b.frame(k)
            for name in first:
                np.testing.assert_array_equal(first[name], second[name], err_msg=name)
        assert set(a.history) == set(b.history)
        for name in a.history:
            np.testing.assert_array_equal(a.history[name], b.history[name], err_msg=name)


def test_another_scene_is_refused_and_a_later_end_goes_on(
    tmp_path: Path, charge: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    flow, partial = tmp_path / "flow.vtkhdf", tmp_path / "flow.partial"
    scene = parse_scene(scene_text(end=0.5))
    step, taken = Simulation._step, []

    def stopping_step(self: Simulation, target: float) -> None:
        step(self, target)
        taken.append(self.time)
        if self.time == 0.25 and len(taken) < 100:
            os.kill(os.getpid(), signal.SIGHUP)

    monkeypatch.setattr(Simulation, "_step", stopping_step)
    with pytest.raises(StoppedWithCheckpoint, match=r"SIGHUP at t = 0\.25 s"):
        run(scene, input=charge, output=flow)
    monkeypatch.setattr(Simulation, "_step", step)
    with open_series(partial, "flow") as series:
        np.testing.assert_allclose(series.times, [0.0, 0.25])
        reached = series.frame(1)
    before = {path.name: path.read_bytes() for path in partial.iterdir()}
    other = parse_scene(scene_text(end=0.5).replace("5.36", "5.5"))
    told = r"2 frames up to t = 0\.25 s are there, .*material\.shear_viscosity: 5\.36 -> 5\.5; say --restart"
    with pytest.raises(SceneError, match=told):
        run(other, input=charge, output=flow)
    with pytest.raises(SceneError, match=r"solver\.end_time is 0\.2 s; give a later end"):
        run(parse_scene(scene_text(end=0.2).replace("0.25 s", "0.1 s")), input=charge, output=flow)
    write_charge(tmp_path / "other.vtkhdf", (5, 4, 6))
    with pytest.raises(SceneError, match=r"other\.vtkhdf: other content"):
        run(scene, input=tmp_path / "other.vtkhdf", output=flow)
    assert {path.name: path.read_bytes() for path in partial.iterdir()} == before
    run(parse_scene(scene_text(end=0.3).replace("0.25 s", "0.05 s")), input=charge, output=flow)
    assert "resumed at t = 0.25 s" in capsys.readouterr().out
    with open_series(flow, "flow") as series:
        np.testing.assert_allclose(series.times, [0.0, 0.25, 0.3])
        np.testing.assert_array_equal(series.frame(1)["position"], reached["position"])
        assert series.provenance.scene["solver"]["end_time"] == 0.3
    assert not partial.exists()


def test_wall_clock_limit_stops_with_a_checkpoint(tmp_path: Path, charge: Path):
    scene = parse_scene(scene_text())
    with pytest.raises(StoppedWithCheckpoint, match="wall-clock limit"):
        run(scene, input=charge, output=tmp_path / "flow.vtkhdf", max_walltime=0.5)


def test_values_that_are_not_finite_stop_the_run_with_a_dump(
    tmp_path: Path, charge: Path, monkeypatch: pytest.MonkeyPatch
):
    step = Simulation._step

    def poisoned_step(self: Simulation, target: float) -> None:
        if len(self.history.rows) == 2:
            self.state.position[self.state.original == 17] = np.nan
        step(self, target)

    monkeypatch.setattr(Simulation, "_step", poisoned_step)
    with pytest.raises(NumericalError, match=r"crash\.h5ckpt"):
        run(parse_scene(scene_text()), input=charge, output=tmp_path / "flow.vtkhdf")
    assert (tmp_path / "flow.crash.h5ckpt").exists()


def test_a_charge_inside_a_tool_is_refused(tmp_path: Path, charge: Path):
    with pytest.raises(SceneError, match=r"tooling\.ram: 50 particles of the charge start inside"):
        run(parse_scene(scene_text(height=4.0)), input=charge, output=tmp_path / "flow.vtkhdf")


def in_a_frame(length: float, solver: str = "") -> str:
    """Squeeze of 150 mm^3 from 6 to 5.25 mm in a frame of `length` x 5 mm."""
    frame = f"  frame: {{shape: box, center: [{length / 2}, 2.5, 0], size: [{length}, 5, 40], inside: true}}\n"
    return scene_text(end=0.25).replace("material:", frame + "material:").replace("solver: {", "solver: {" + solver)


def test_a_charge_without_room_is_refused(tmp_path: Path, charge: Path):
    told = r"charge\.vtkhdf: at 0\.25 s the charge takes 114\.\d+% of the closed cavity .* less travel"
    with pytest.raises(SceneError, match=told):
        run(parse_scene(in_a_frame(5.0)), input=charge, output=tmp_path / "flow.vtkhdf")
    assert list(tmp_path.iterdir()) == [charge]


@pytest.mark.parametrize(
    ("length", "solver", "told"),
    [(6.0, "", "95.2.%"), (5.6, "", "102.0.%"), (5.0, "bulk_modulus: 100, ", "114.2.%"), (5.714, "", "")],
)
def test_a_charge_unlike_the_cavity_is_told(tmp_path: Path, charge: Path, capsys, length, solver, told):
    run(parse_scene(in_a_frame(length, solver)), input=charge, output=tmp_path / "flow.vtkhdf")
    said = capsys.readouterr().out
    assert re.search(told, said) if told else "cavity" not in said


def test_the_scene_needs_all_sections(tmp_path: Path, charge: Path):
    with pytest.raises(SceneError, match="tooling"):
        run(parse_scene("name: bare\n"), input=charge, output=tmp_path / "flow.vtkhdf")
