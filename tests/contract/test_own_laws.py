"""What the pages on materials and walls say works: their code runs, and a law is one file."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ppmc.errors import SceneError
from ppmc.materials import MATERIALS, LocalState, Material
from ppmc.scene import Scene
from ppmc.walls import LAWS, WallLaw
from tests.solver.scenes import make_squeeze

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python(?: file=(\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: str) -> list[tuple[str, str]]:
    """Code of a page of the docs: the file it is to stand in, if it says so, and the code."""
    return BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))


def test_the_page_on_materials_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "page"}
    for _, code in blocks("materials.md"):
        exec(compile(code, "docs/materials.md", "exec"), names)
    assert names["steps"]["unconverged"].max() == 0
    # Its fibres are those of the material that thins alike.
    mine, rng = names["ThinningFibres"](eta0=3.0, time=2.0, exponent=0.4), np.random.default_rng(0)
    directions = rng.normal(size=(5, 1, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    rate, local = rng.normal(size=(5, 3, 3)), LocalState(*np.zeros((4, 5, 3)))
    shear, stiffness = mine.viscosities(rate, directions, local)
    dissipated = np.einsum("nij,nij->n", rate := 0.5 * (rate + np.swapaxes(rate, 1, 2)), rate)
    dissipated = 2.0 * (dissipated - np.einsum("nii->n", rate) ** 2 / 3.0)
    along = np.einsum("nij,ni,nj->n", rate, *[directions[:, 0]] * 2) - np.einsum("nii->n", rate) / 3.0
    np.testing.assert_allclose(shear, mine.shear_at(np.sqrt(dissipated + 196.0 * along**2)))
    np.testing.assert_allclose(stiffness[:, 0], 196.0 * shear)


def test_a_wall_law_is_one_file(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "ppmc", tmp_path / "ppmc", ignore=shutil.ignore_patterns("__pycache__"))
    ((name, code),) = [block for block in blocks("walls.md") if block[0]]
    (tmp_path / name).write_text(code, encoding="utf-8")
    scene = """
name: a
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1], wall: {law: tresca, yield_stress: 20 kPa}}
"""
    ask = f"""
from ppmc.scene import parse_scene, scene_json_schema
scene = parse_scene({scene!r})
assert scene.tooling["lower"].wall.traction(scene.tooling["lower"].wall.yield_stress + 0.0, 0.0) == 20000.0
assert scene.resolved()["tooling"]["lower"]["wall"] == {{"law": "tresca", "yield_stress": 20000.0}}
assert "TrescaFriction" in scene_json_schema()["$defs"]
"""
    env = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, env=env, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_law_from_python_goes_through_a_scene() -> None:
    names: dict[str, Any] = {"__name__": "page"}
    exec(blocks("walls.md")[0][1], names)
    wall = names["Tresca"](3.0)
    plane = {"shape": "plane", "point": (0, 0, 0), "normal": (0, 0, 1), "wall": wall}
    scene = Scene(name="a", tooling={"lower": plane})
    assert scene.tooling is not None and scene.tooling["lower"].wall is wall
    kept = scene.resolved()["tooling"]["lower"]["wall"]
    assert kept["class"] == "page.Tresca" and kept["yield_stress"] == 3.0


@pytest.mark.parametrize(
    ("shear", "stiffness", "told"),
    [
        (np.ones(3), np.zeros((3, 0)), "shapes"), (np.full(64, -1.0), np.zeros((64, 0)), "shear viscosity of -1"),
        (np.full(64, np.nan), np.zeros((64, 0)), "shear viscosity of nan"), (np.ones(64), np.ones((64, 1)), "shapes"),
    ],
)  # fmt: skip
def test_a_material_that_gives_nonsense_is_named(shear: Any, stiffness: Any, told: str) -> None:
    class Odd(Material):
        ratio = 1.0

        def shear_at(self, rate: Any) -> Any:
            return 1.0

        def viscosities(self, rate: Any, directions: Any, local: Any) -> Any:
            return shear, stiffness

    with pytest.raises(SceneError, match=f"material Odd.*{told}"):
        make_squeeze((4, 4, 4), material=Odd()).initialise(0.0, 1e-3)


def test_an_empty_region_is_told() -> None:
    fluid = {"model": "newtonian", "shear_viscosity": 2.0}
    material = MATERIALS["by_region"](
        elsewhere=fluid, regions=[{"low": [0, 0, 0], "high": [4, 4, 2], "material": fluid}, {"low": [9, 9, 9], "high":
        [10, 10, 10], "material": fluid}],
    )  # fmt: skip
    (line,) = material.remarks(np.random.default_rng(0).uniform(0.0, 4.0, (50, 3)))
    assert "regions[1]" in line


@pytest.mark.parametrize("name", sorted(MATERIALS))
def test_materials_keep_their_word(name: str) -> None:
    kind = MATERIALS[name]
    given: dict[str, Any] = {
        "newtonian": {"shear_viscosity": 2.0},
        "by_region": {
            "elsewhere": {"model": "newtonian", "shear_viscosity": 2.0},
            "regions": [
                {
                    "low": [0, 0, 0], "high": [1, 1, 1],
                    "material": {
                        "model": "power_law", "shear_viscosity": 3.0, "anisotropy_ratio": 9.0, "reference_rate": 1.0,
                        "exponent": 0.5,
                    },
                }
            ],
        },
    }.get(name, {"shear_viscosity": 2.0, "anisotropy_ratio": 20.0})  # fmt: skip
    given |= {
        "orientation_mixture": {"angles": [0, 60], "fractions": [0.4, 0.6]},
        "carreau_yasuda": {"relaxation_time": 2.0, "exponent": 0.4},
        "power_law": {"reference_rate": 1.0, "exponent": 0.4},
    }.get(name, {})  # fmt: skip
    material = kind(**given)
    assert kind.model_validate(material.described()) == material
    rng, n = np.random.default_rng(0), 40
    frames = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    strain = np.eye(3) + 0.1 * rng.normal(size=(n, 3, 3))
    local = LocalState(frames[:, 0], frames[:, 1], strain, rng.uniform(0.0, 2.0, (n, 3)), frames[:, 2])
    directions = material.directions(local)
    assert directions.shape[0] == n and directions.shape[2] == 3
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1.0)
    gradient = rng.normal(size=(n, 3, 3))
    rate = 0.5 * (gradient + np.swapaxes(gradient, 1, 2))
    shear, stiffness = material.viscosities(rate, directions, local)
    assert shear.shape == (n,) and stiffness.shape == directions.shape[:2]
    assert (shear > 0.0).all() and (stiffness >= 0.0).all()
    # Viscosities change with the rate where a material says so, and nowhere else.
    faster, _ = material.viscosities(2.0 * rate, directions, local)
    assert np.array_equal(faster, shear) == (not material.rate_dependent)
    # Turned with everything around it a material says the same.
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turned = LocalState(
        frames[:, 0] @ turn.T, frames[:, 1] @ turn.T, turn @ strain, local.reference_position, frames[:, 2] @ turn.T
    )
    if not material.follows_walls:  # the three axes in a plane begin anywhere
        again = material.viscosities(turn @ rate @ turn.T, material.directions(turned), turned)
        np.testing.assert_allclose(again[0], shear, rtol=1e-9)
        np.testing.assert_allclose(again[1], stiffness, rtol=1e-9)
    # Where it deforms as it says, the power is that of its reference values.
    if material.even_as() == "fibres":
        factor = 4.0 - 1.0 / material.ratio
        along, across = 0.5 / material.ratio, 1.0 - 0.5 / material.ratio
        p, q = np.eye(3)[:2]
        one = LocalState(p[None], q[None], np.eye(3)[None], np.zeros((1, 3)))
        squeezed = np.diag([along, across, -1.0])[None] * 0.7
        at = material.viscosities(squeezed, material.directions(one), one)[0]
        assert at[0] == pytest.approx(float(material.shear_at(0.7 * factor**0.5)), rel=1e-12)
    assert material.reference(0.7).shear > 0.0 and material.reference(0.7).ratio == material.ratio


@pytest.mark.parametrize("name", sorted(LAWS))
def test_wall_laws_keep_their_word(name: str) -> None:
    given: dict[str, Any] = {
        "navier": {"friction": 2.0}, "coulomb": {"coefficient": 0.3},
        "power_law": {"reference_traction": 3.0, "reference_speed": 2.0, "exponent": 0.4},
    }.get(name, {})  # fmt: skip
    law = LAWS[name](**given)
    assert isinstance(law, WallLaw)
    speed, pressure = np.linspace(0.0, 5.0, 40), np.full(40, 7.0)
    found = law.traction(speed, pressure)
    assert found.shape == speed.shape and (found >= 0.0).all()
    assert (np.diff(found[np.isfinite(found)]) >= 0.0).all()
    if law.slip_length is not None and 0.0 < law.slip_length < np.inf:
        np.testing.assert_allclose(found, speed / law.slip_length)
    assert law.rubs == bool(found[-1] > 0.0)
