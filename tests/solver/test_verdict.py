"""The verdict through the command line and the file: a scene that trips each limit, strictness, resumed runs."""

import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest

from ppmc.cli import _run
from ppmc.errors import StoppedWithCheckpoint
from ppmc.files import Provenance, open_series, read_state, write_particles
from ppmc.files.describe import describe_file
from ppmc.files.verdict import verdict_of
from ppmc.scene import parse_scene
from ppmc.solver.run.simulation import Simulation
from ppmc.solver.run.verdict import judge
from ppmc.solver.stage import run

from .blocks import lattice

SCENE = """
name: verdict
tooling:
  lower: {{shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}}
  ram: {{shape: plane, point: [0, 0, {height}], normal: [0, 0, -1], motion: {{{motion}}}}}
{more}
material: {{{material}}}
solver: {{{solver}}}
"""
ISOTROPIC = "model: newtonian, shear_viscosity: 1"
FIBRES = "model: transversely_isotropic, shear_viscosity: 1, anisotropy_ratio: 61215"
FOUR_WAYS = (
    "model: orientation_mixture, shear_viscosity: 1, anisotropy_ratio: 10000, angles: [0, 45, 90, 135], "
    "fractions: [0.25, 0.25, 0.25, 0.25]"
)


def scene_text(height=4.0, motion="velocity: [0, 0, -2]", material=ISOTROPIC, solver="end_time: 0.2", more=""):
    return SCENE.format(height=height, motion=motion, material=material, solver=solver, more=more)


def write_charge(path, positions, volume=1.0, tilt=0.0, mixed=False):
    """Particles a millimetre apart whose fibres lie in planes tilted about x2, or in the plane at random."""
    n = len(positions)
    a = np.radians(tilt)
    p, q = np.tile([np.cos(a), 0.0, np.sin(a)], (n, 1)), np.tile([0.0, 1.0, 0.0], (n, 1))
    if mixed:
        angle = np.random.default_rng(0).uniform(0.0, np.pi, n)
        p = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
        q = np.stack([-np.sin(angle), np.cos(angle), np.zeros(n)], axis=1)
    fields = {"fibre_direction": p, "in_plane_direction": q, "platelet_normal": np.cross(p, q)}
    fields |= {"volume": np.full(n, volume), "platelet_id": np.zeros(n, dtype=np.int64)}
    write_particles(
        path, "charge", positions, fields, provenance=Provenance.collect("test"), extra={"spacing": [1.0, 1.0, 1.0]}
    )
    return path


def solve(folder, text, *options):
    """Exit code of `ppmc solve` with a scene, and its output."""
    (folder / "scene.yaml").write_text(text)
    flow = folder / "flow.vtkhdf"
    paths = ["--input", str(folder / "charge.vtkhdf"), "--output", str(flow)]
    return _run(["solve", str(folder / "scene.yaml"), *paths, *options]), flow


def around_a_pin():
    """A block of 7 x 7 x 4 without what a pin of 3 x 3 x 3 in its middle takes."""
    x = lattice((7, 7, 4))
    return x[~((np.abs(x[:, :2] - 3.5) < 1.5).all(axis=1) & (x[:, 2] < 3.0))]


# What is written as the charge, the scene, and the limits that must be told, as they begin.
TRIPS = {
    "a slender stiff charge whose forces are noise": (
        lambda path: write_charge(path, lattice((4, 4, 10))),
        scene_text(
            10.0,
            "velocity: [0, 0, -10]",
            FIBRES,
            "end_time: 0.3, output_interval: 0.05, max_strain_increment: 0.1, velocity_tolerance: 0.002",
        ),
        ("tools' forces out of balance",),
    ),
    "a soft penalty lets the charge shrink": (
        lambda path: write_charge(path, lattice((4, 4, 4))),
        scene_text(solver="end_time: 0.25, bulk_modulus: 3, max_strain_increment: 0.1"),
        ("mean |J - 1|", "largest |J - 1|"),
    ),
    "stored pressure moves what rests": (
        lambda path: write_charge(path, lattice((4, 4, 4))),
        scene_text(
            motion="velocity: [0, 0, -4], travel: 0.54",
            solver="end_time: 3, output_interval: 3, bulk_modulus: 2, max_strain_increment: 0.1",
        ),
        ("flow driven by tools",),
    ),
    "a charge that fills two thirds of its lattice": (
        lambda path: write_charge(path, lattice((8, 8, 3)), volume=0.65),
        scene_text(3.0, "velocity: [0, 0, -1]", solver="end_time: 0.04, output_interval: 0.04"),
        ("packing inside, 5 %", "packing inside, farthest"),
    ),
    "a charge that overfills its lattice": (
        lambda path: write_charge(path, lattice((8, 8, 3)), volume=1.15),
        scene_text(3.0, "velocity: [0, 0, -1]", solver="end_time: 0.04, output_interval: 0.04"),
        ("packing inside, 95 %",),
    ),
    "solves that may not iterate": (
        lambda path: write_charge(path, lattice((4, 4, 4)), mixed=True),
        scene_text(material=FIBRES, solver="end_time: 0.01, max_iterations: 8"),
        ("unconverged solves",),
    ),
    "a single layer between a pin and the ram": (
        lambda path: write_charge(path, around_a_pin()),
        scene_text(
            solver="end_time: 0.22, max_strain_increment: 0.05",
            more="  pin: {shape: box, center: [3.5, 3.5, 1.5], size: [3, 3, 3]}",
        ),
        ("penetration",),
    ),
    "a tilted stubby stack tips over": (
        lambda path: write_charge(path, lattice((4, 4, 5)), tilt=3.0),
        scene_text(5.0, "velocity: [0, 0, -3]", FOUR_WAYS, "end_time: 0.12, max_strain_increment: 0.05"),
        ("cover kept by a closing tool",),
    ),
    "scattered stiff particles": (
        lambda path: write_charge(path, lattice((4, 4, 4), 0.4), mixed=True),
        scene_text(4.6, "velocity: [0, 0, -10]", FIBRES, "end_time: 0.05"),
        ("work of zero-energy control",),
    ),
    "a particle far from all others": (
        lambda path: write_charge(path, np.vstack([lattice((4, 4, 4)), [30.0, 0.5, 0.5]])),
        scene_text(solver="end_time: 0.02, reynolds_number: 0.01"),
        ("particles outside",),
    ),
}


@pytest.mark.parametrize("case", TRIPS)
def test_each_limit_has_a_scene_that_breaks_it(tmp_path, capsys, case):
    charge, text, broken = TRIPS[case]
    charge(tmp_path / "charge.vtkhdf")
    code, flow = solve(tmp_path, text)
    assert code == 0
    verdict = verdict_of(flow)
    assert not verdict.passed
    names = [finding.name for finding in verdict.broken]
    for start in broken:
        assert any(name.startswith(start) for name in names), names
    told, described = capsys.readouterr().err, describe_file(flow)
    assert "verdict NOT PASSED" in told and "Verdict: NOT PASSED" in described
    for finding in verdict.broken:
        assert finding.told() in told and f"! {finding.told()}" in described
    with open_series(flow, "flow") as series:
        assert judge(series.history, *(series.extra[name] for name in ("tools", "spacing", "bulk_modulus"))) == verdict


def test_places_are_where_the_particles_are(tmp_path):
    """The last row of the table and the last frame are the same instant; what is worst is worst in the frame."""
    write_charge(tmp_path / "charge.vtkhdf", np.vstack([lattice((4, 4, 4)), [30.0, 0.5, 0.5]]))
    _, flow = solve(tmp_path, scene_text(solver="end_time: 0.02, output_interval: 0.01, reynolds_number: 0.01"))
    with open_series(flow, "flow") as series:
        for k in range(1, len(series.times)):
            frame, row = series.frame(k), int(np.flatnonzero(series.history["time"] == series.times[k])[0])
            table = {name: values[row] for name, values in series.history.items()}
            for place in ("volume_ratio", "outside", "packing"):
                particle = int(table[f"{place}_particle"])
                found = [table[f"{place}_x{axis}"] for axis in (1, 2, 3)]
                np.testing.assert_allclose(found, frame["position"][particle], rtol=1e-12, err_msg=place)
            error = np.abs(frame["volume_ratio"] - 1.0)
            assert table["max_volume_ratio_error"] == pytest.approx(error[int(table["volume_ratio_particle"])])
            assert table["max_volume_ratio_error"] == pytest.approx(error.max())
            assert table["outside_particle"] == 64


def test_a_sound_run_passes_strictly(tmp_path, capsys):
    write_charge(tmp_path / "charge.vtkhdf", lattice((4, 4, 4)))
    text = scene_text(solver="end_time: 0.5, output_interval: 0.25, max_strain_increment: 0.1")
    code, flow = solve(tmp_path, text, "--strict")
    assert code == 0
    assert verdict_of(flow).passed
    said = capsys.readouterr()
    assert said.out.split() == [str(flow)]
    assert "verdict passed: all 12 limits kept" in said.err
    assert "Verdict: passed" in describe_file(flow)


def test_strictness_ends_with_4_and_leaves_a_complete_file(tmp_path):
    charge, text, _ = TRIPS["solves that may not iterate"]
    charge(tmp_path / "charge.vtkhdf")
    (tmp_path / "scene.yaml").write_text(text)
    command = [sys.executable, "-m", "ppmc.cli", "solve", "scene.yaml", "--strict", "--input", "charge.vtkhdf"]
    done = subprocess.run(
        [*command, "--output", "flow.vtkhdf"], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 4, done.stderr
    assert "takes no broken limit: unconverged solves" in done.stderr
    with open_series(tmp_path / "flow.vtkhdf", "flow") as series:
        assert series.complete and series.times[-1] == 0.01
    assert not list(tmp_path.glob("*.partial*"))


def test_a_charge_that_lets_go_of_closing_tools_ends_the_run(tmp_path, capsys):
    write_charge(tmp_path / "charge.vtkhdf", lattice((4, 4, 5)), tilt=3.0)
    text = scene_text(5.0, "velocity: [0, 0, -3]", FOUR_WAYS, "end_time: 0.5, max_strain_increment: 0.05")
    code, flow = solve(tmp_path, text)
    assert code == 4
    assert not flow.exists()
    told = capsys.readouterr().err
    # Which of the two plates goes first is left to round-off.
    assert re.search(r"the charge has let go of '(lower|ram)'( and 'ram')?: since t = 0\.\d+ s", told)
    assert "particle" in told and "mm" in told
    arrays, facts, _ = read_state(tmp_path / "flow.crash.h5ckpt")
    assert len(arrays["position"]) == 80 and 0.1 < facts["time"] < 0.3


def test_a_tool_that_parts_from_the_charge_is_no_fault(tmp_path):
    write_charge(tmp_path / "charge.vtkhdf", lattice((4, 4, 4)))
    motion = "times: [0, 0.2, 0.4], displacements: [[0, 0, 0], [0, 0, -0.4], [0, 0, 1]]"
    code, flow = solve(tmp_path, scene_text(motion=motion, solver="end_time: 0.4, output_interval: 0.4"), "--strict")
    assert code == 0
    with open_series(flow, "flow") as series:
        assert series.history["cover_ram"][-1] == 0.0
        assert series.history["cover_ram"].max() > 16.0


@pytest.mark.parametrize(
    ("solver", "motion"),
    [
        ("end_time: 0.12, max_strain_increment: 0.05", "velocity: [0, 0, -3]"),
        ("end_time: 0.02, integrator: explicit, reynolds_number: 0.01, bulk_modulus: 10", "velocity: [0, 0, -3]"),
        ("end_time: 0.12, max_strain_increment: 0.05", "force: 20, direction: [0, 0, -1], max_speed: 3"),
    ],
    ids=["implicit", "explicit", "press"],
)
def test_a_resumed_run_gives_the_same_verdict_and_the_same_bytes(tmp_path, monkeypatch, solver, motion):
    charge = write_charge(tmp_path / "charge.vtkhdf", lattice((4, 4, 5)), tilt=3.0)
    material = FOUR_WAYS if "implicit" in solver or "strain" in solver else ISOTROPIC
    scene = parse_scene(scene_text(5.0, motion, material, solver))
    unbroken = run(scene, input=charge, output=tmp_path / "unbroken.vtkhdf")
    step, taken = Simulation._step, []

    def stopping_step(self, target):
        step(self, target)
        taken.append(self.time)
        if len(taken) in (2, 6):
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(Simulation, "_step", stopping_step)
    broken = tmp_path / "broken.vtkhdf"
    for _ in range(2):
        with pytest.raises(StoppedWithCheckpoint):
            run(scene, input=charge, output=broken)
    run(scene, input=charge, output=broken)
    assert verdict_of(broken) == verdict_of(unbroken)
    assert broken.read_bytes() == unbroken.read_bytes()
