"""A scene turned by any rotation gives the turned answer: the files of two runs through the command line."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ppmc.files import Provenance, open_series, write_particles
from ppmc.solver.run.setup import column_height

TURNS = {"upright": (0.0, 0.0, 0.6), "tilted": (0.39, -0.41, 0.31)}
NOWHERE = np.eye(3)
WITHIN = 1e-6  # of a spacing, of unity for directions and F, and of the press force
TOLERANCE = 1e-7


def platelets(shape: tuple[int, int, int], jitter: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 3) of particles of spacing 1 on the floor, and fibres of platelets about three spacings wide."""
    rng = np.random.default_rng(0)
    axes = [np.arange(n) + 0.5 for n in shape]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    p = np.empty_like(x)
    for layer in range(shape[2]):
        on = np.flatnonzero(x[:, 2].astype(int) == layer)
        count = max(1, len(on) // 8)
        angle, tilt = rng.uniform(0.0, np.pi, count), np.radians(5.0) * rng.normal(size=count)
        fibres = np.stack([np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)], axis=1)
        centres = rng.uniform((0.0, 0.0), shape[:2], (count, 2))
        p[on] = fibres[np.argmin(((x[on, None, :2] - centres) ** 2).sum(axis=-1), axis=1)]
    x += jitter * rng.uniform(-1.0, 1.0, x.shape) * [1.0, 1.0, 0.0]
    return x - [0.5 * shape[0], 0.5 * shape[1], 0.0], p


def plane(rotation: np.ndarray, point: tuple, normal: tuple) -> dict:
    return {"shape": "plane", "point": (rotation @ point).tolist(), "normal": (rotation @ normal).tolist()}


def run(directory: Path, rotation: np.ndarray, case: SimpleNamespace) -> SimpleNamespace:
    """Last frame of a squeeze and its press force (3,), all turned back."""
    directory.mkdir()
    x, p = platelets(case.shape, case.jitter)
    q = np.cross([0.0, 0.0, 1.0], p)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    frames = {"fibre_direction": p, "in_plane_direction": q, "platelet_normal": np.cross(p, q)}
    fields = {name: vectors @ rotation.T for name, vectors in frames.items()}
    fields |= {"volume": np.ones(len(x)), "platelet_id": np.zeros(len(x), dtype=np.int64)}
    charge, scene, flow = directory / "charge.vtkhdf", directory / "scene.yaml", directory / "flow.vtkhdf"
    write_particles(
        charge, "charge", x @ rotation.T, fields, provenance=Provenance.collect("test"), extra={"spacing": [1, 1, 1]}
    )
    height = float(case.shape[2])
    motion = {"velocity": (rotation @ [0.0, 0.0, -case.closing]).tolist(), "travel": case.closing}
    tooling = {
        "lower": plane(rotation, (0, 0, 0), (0, 0, 1)),
        "ram": plane(rotation, (0, 0, height), (0, 0, -1)) | {"motion": motion},
    }
    if case.wall:
        tooling["wall"] = plane(rotation, (-0.5 * case.shape[0], 0, 0), (1, 0, 0))
    solver = {"end_time": 1.0, "output_interval": 0.5, "velocity_tolerance": TOLERANCE, "max_strain_increment": 0.05}
    material = {"model": "transversely_isotropic", "shear_viscosity": 1.0, "anisotropy_ratio": case.ratio}
    content = {"name": "turned", "tooling": tooling, "material": material, "solver": solver | case.solver}
    scene.write_text(json.dumps(content))
    command = [sys.executable, "-m", "ppmc.cli", "solve", str(scene), "--input", str(charge), "--output", str(flow)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with open_series(flow, "flow") as series:
        frame = series.frame(-1)
        force = np.array([series.history[f"force_ram_{axis}"][-1] for axis in "xyz"])
        steps = len(series.history["time"])
    return SimpleNamespace(
        position=frame["position"] @ rotation, p=frame["fibre_direction"] @ rotation,
        q=frame["in_plane_direction"] @ rotation, packing=frame["packing"], force=force @ rotation, steps=steps,
        f=rotation.T @ frame["deformation_gradient"].reshape(-1, 3, 3) @ rotation,
    )  # fmt: skip


def check_turned(directory: Path, turns: list[str], **values: object) -> None:
    usual = {"shape": (5, 4, 3), "ratio": 100.0, "jitter": 0.1, "wall": True, "closing": 0.6, "solver": {}}
    case = SimpleNamespace(**usual | values)
    here = run(directory / "here", NOWHERE, case)
    moved = np.linalg.norm(here.position - platelets(case.shape, case.jitter)[0], axis=1)
    assert moved.max() > 0.3 * case.closing
    for name in turns:
        there = run(directory / name, Rotation.from_rotvec(TURNS[name]).as_matrix(), case)
        assert there.steps == here.steps
        np.testing.assert_allclose(there.position, here.position, atol=WITHIN)
        for field in ("f", "p", "q", "packing"):
            np.testing.assert_allclose(getattr(there, field), getattr(here, field), atol=WITHIN, err_msg=field)
        np.testing.assert_allclose(there.force, here.force, atol=WITHIN * np.abs(here.force).max())


def test_platelets_against_a_wall(tmp_path):
    check_turned(tmp_path, ["tilted"])


def test_explicit_integrator(tmp_path):
    # It has no tolerance but its stable step, which is estimated without a look at the axes.
    check_turned(tmp_path, ["tilted"], closing=0.3, solver={"integrator": "explicit", "reynolds_number": 0.05})


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 100.0, 1000.0])
@pytest.mark.parametrize("wall", [False, True])
def test_any_ratio_and_rotation(tmp_path, ratio, wall):
    check_turned(tmp_path, list(TURNS), shape=(8, 6, 4), ratio=ratio, wall=wall, closing=1.2)


def test_height_of_a_charge_is_that_of_the_turned_charge():
    x = platelets((9, 8, 4), 0.2)[0]
    heights = []
    for turn in [(0.0, 0.0, 0.0), *TURNS.values()]:
        rotation = Rotation.from_rotvec(turn).as_matrix()
        heights.append(column_height(x @ rotation.T, rotation @ [0.0, 0.0, 1.0], np.ones(3)))
    np.testing.assert_allclose(heights, heights[0], rtol=1e-12)
    assert heights[0] == 4.0
