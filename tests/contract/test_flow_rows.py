"""A row of a flow file is one particle, in every field of every frame: read from the file that the command wrote.

Exact relations between the fields of a particle hold whatever the flow, so that a field in another order breaks them:
p = F p0 / |F p0|, r = F^-T r0 / |F^-T r0|, p . r = 0 and J = det F (the volumetric correction draws J and the
volumetric part of F alike, which leaves directions as they are); positions move with the velocities of their frame.
"""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from ppmc.cli import _run
from ppmc.files import Provenance, open_series, write_particles
from ppmc.solver.run.simulation import Simulation
from ppmc.solver.step.implicit import ImplicitIntegrator

SHAPE = (7, 6, 5)
INTERVAL = 0.02
MATERIALS = {
    "newtonian": "{model: newtonian, shear_viscosity: 1 Pa*s}",
    "transversely_isotropic": "{model: transversely_isotropic, shear_viscosity: 1 Pa*s, anisotropy_ratio: 50}",
    "orientation_mixture": "{model: orientation_mixture, shear_viscosity: 1 Pa*s, anisotropy_ratio: 50, "
    "angles: [0, 90], fractions: [0.7, 0.3]}",
    "planar_uniform": "{model: planar_uniform, shear_viscosity: 1 Pa*s, anisotropy_ratio: 50}",
}
SCENE = """
name: rows
tooling:
  lower: {{shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}}
  ram: {{shape: plane, point: [0, 0, 5], normal: [0, 0, -1], motion: {{velocity: [0.5 mm/s, 0, -5 mm/s]}}}}
material: {material}
solver: {{end_time: 0.08, output_interval: {interval}, integrator: {integrator}{inertia}}}
"""


def write_scene(folder: Path, material: str, integrator: str) -> None:
    inertia = ", reynolds_number: 0.01" if integrator == "explicit" else ""
    text = SCENE.format(material=MATERIALS[material], interval=INTERVAL, integrator=integrator, inertia=inertia)
    (folder / "scene.yaml").write_text(text)


def write_charge(folder: Path) -> dict[str, np.ndarray]:
    """Particles in random order, each with a frame and a number of its own; the last field is their positions."""
    rng = np.random.default_rng(5)
    axes = [np.arange(n) + 0.5 for n in SHAPE]
    positions = rng.permutation(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
    n = len(positions)
    frames = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    frames *= np.linalg.det(frames)[:, None, None]
    fields = {
        "fibre_direction": frames[..., 0], "in_plane_direction": frames[..., 1], "platelet_normal": frames[..., 2],
        "volume": np.ones(n), "platelet_id": rng.permutation(n),
    }  # fmt: skip
    write_particles(
        folder / "charge.vtkhdf", "charge", positions, fields, provenance=Provenance.collect("test"),
        extra={"spacing": [1.0, 1.0, 1.0]},
    )  # fmt: skip
    return fields | {"position": positions}


def solve(folder: Path) -> int:
    names = [str(folder / name) for name in ("scene.yaml", "charge.vtkhdf", "flow.vtkhdf")]
    return _run(["solve", names[0], "--input", names[1], "--output", names[2]])


def sort_at_every_chance(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Shuffle the particles before each look at the neighbour list, so that each sorts them; return the count."""
    refresh, rng, done = ImplicitIntegrator.refresh_neighbours, np.random.default_rng(8), []

    def shuffled(self: ImplicitIntegrator, force: bool = False) -> None:
        before = self.state.original.copy()
        self.reorder(rng.permutation(len(self.state)))
        refresh(self, force=True)
        done.append(int(np.sum(before != self.state.original)))

    monkeypatch.setattr(ImplicitIntegrator, "refresh_neighbours", shuffled)
    return done


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def assert_rows_are_particles(folder: Path, start: dict[str, np.ndarray]) -> None:
    with open_series(folder / "flow.vtkhdf", "flow") as flow:
        np.testing.assert_array_equal(flow.static["platelet_id"], start["platelet_id"])
        np.testing.assert_allclose(flow.static["reference_position"], start["position"], atol=1e-6)
        frames = [flow.frame(k) for k in range(len(flow.times))]
    np.testing.assert_allclose(frames[0]["position"], start["position"], atol=1e-6)
    for number, frame in enumerate(frames):
        gradient = frame["deformation_gradient"].reshape(-1, 3, 3)
        p = unit(np.einsum("nab,nb->na", gradient, start["fibre_direction"]))
        r = unit(np.einsum("nba,nb->na", np.linalg.inv(gradient), start["platelet_normal"]))
        np.testing.assert_allclose(frame["fibre_direction"], p, atol=1e-6)
        np.testing.assert_allclose(frame["platelet_normal"], r, atol=1e-6)
        assert np.abs(np.einsum("na,na->n", frame["fibre_direction"], frame["platelet_normal"])).max() < 1e-6
        q = unit(np.einsum("nab,nb->na", gradient, start["in_plane_direction"]))
        np.testing.assert_allclose(frame["in_plane_direction"], q, atol=1e-6)
        sheared = np.degrees(np.arcsin(np.abs(np.einsum("na,na->n", p, q))))
        np.testing.assert_allclose(np.abs(frame["shear_angle"]), sheared, atol=1e-4)
        np.testing.assert_allclose(frame["volume_ratio"], np.linalg.det(gradient), rtol=1e-6)
        if number > 0:
            moved = frame["position"] - frames[number - 1]["position"]
            largest = np.abs(moved).max()
            assert 0.02 < largest < 0.3
            between = 0.5 * (frame["velocity"] + frames[number - 1]["velocity"]) if number > 1 else frame["velocity"]
            assert np.abs(moved - INTERVAL * between).max() < 0.35 * largest
            assert np.sqrt(np.mean((moved - INTERVAL * between) ** 2)) < 0.1 * np.sqrt(np.mean(moved**2))
    # The test could not fail if all particles were alike.
    assert np.abs(frames[-1]["fibre_direction"] - start["fibre_direction"]).max() > 0.02
    assert frames[-1]["velocity"].std(axis=0).min() > 0.05


@pytest.mark.parametrize("integrator", ["implicit", "explicit"])
@pytest.mark.parametrize("material", MATERIALS)
def test_every_field_is_in_the_order_of_the_charge(
    material: str, integrator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = write_charge(tmp_path)
    write_scene(tmp_path, material, integrator)
    sorts = sort_at_every_chance(monkeypatch)
    assert solve(tmp_path) == 0
    assert len(sorts) > 8
    assert min(sorts) > 100
    assert_rows_are_particles(tmp_path, start)


@pytest.mark.parametrize("integrator", ["implicit", "explicit"])
def test_the_order_survives_a_stop_and_a_resume(
    integrator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = write_charge(tmp_path)
    write_scene(tmp_path, "transversely_isotropic", integrator)
    sort_at_every_chance(monkeypatch)
    step, taken = Simulation._step, []

    def stopping_step(self: Simulation, target: float) -> None:
        step(self, target)
        taken.append(self.time)
        if len(taken) in (2, 3):
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(Simulation, "_step", stopping_step)
    assert [solve(tmp_path) for _ in range(3)] == [75, 75, 0]
    assert_rows_are_particles(tmp_path, start)


def test_a_turning_fibre_with_a_shape_factor_keeps_its_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With Jeffery's equation p leaves F p0; the same run unsorted says which row is which."""
    write_charge(tmp_path)
    write_scene(tmp_path, "transversely_isotropic", "implicit")
    text = (tmp_path / "scene.yaml").read_text().replace("end_time:", "shape_factor: 0.5, end_time:")
    (tmp_path / "scene.yaml").write_text(text)
    assert solve(tmp_path) == 0
    with open_series(tmp_path / "flow.vtkhdf", "flow") as flow:
        plain = flow.frame(-1)
    (tmp_path / "flow.vtkhdf").unlink()
    sort_at_every_chance(monkeypatch)
    assert solve(tmp_path) == 0
    with open_series(tmp_path / "flow.vtkhdf", "flow") as flow:
        shuffled = flow.frame(-1)
    # Sums in another order stop solves elsewhere: equal to the solver's tolerance, where rows differ by order one.
    for name in ("fibre_direction", "platelet_normal", "deformation_gradient"):
        np.testing.assert_allclose(shuffled[name], plain[name], atol=2e-3, err_msg=name)
