"""Scenes: units, exact messages with file and line, YAML 1.2, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ppmc.errors import SceneError
from ppmc.scene import Scene, load_scene, parse_scene, scene_json_schema

CONFIGS = Path(__file__).parents[2] / "configs"

GOOD = """\
name: test
seed: 3
charge:
  domain: {shape: box, size: [1 cm, 8, 0.006 m]}
  spacing: 500 um
  orientation: {source: uniform, fibre_direction: [2, 0, 0]}
material: {model: transversely_isotropic, shear_viscosity: 5.36 Pa*s, anisotropy_ratio: 1e3}
solver: {end_time: 500 ms}
"""


def test_units_become_mm_s_g_pa() -> None:
    scene = parse_scene(GOOD)
    assert scene.charge is not None and scene.solver is not None and scene.material is not None
    assert scene.charge.domain.size == pytest.approx((10.0, 8.0, 6.0))
    assert scene.charge.spacing == pytest.approx((0.5, 0.5, 0.5))
    assert scene.charge.orientation.fibre_direction == (1.0, 0.0, 0.0)
    assert scene.solver.end_time == pytest.approx(0.5)
    assert scene.material.anisotropy_ratio == 1000.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seed: 3", "sede: 3", "s.yaml:2: sede: unknown key; did you mean 'seed'?"),
        ("spacing: 500 um", "spacng: 500 um", "s.yaml:5: charge.spacng: unknown key; did you mean 'spacing'?"),
        ("spacing: 500 um", "spacing: -1 mm", "s.yaml:5: charge.spacing: Input should be greater than 0 (got '-1 mm')"),
        ("spacing: 500 um", "spacing: 3 s", ":5: charge.spacing: '3 s' has the wrong dimension: expected mm, got"),
        ("spacing: 500 um", "spacing: true", ":5: charge.spacing: expected a number or a quantity such as '1 mm', got"),
        ("spacing: 500 um", "spacing: .inf", "s.yaml:5: charge.spacing: Input should be a finite number"),
        ("spacing: 500 um", "spacing: .nan", "s.yaml:5: charge.spacing: Input should be"),
        ("fibre_direction: [2, 0, 0]", "fibre_direction: [0, 0, 0]", "a direction must not be the zero vector"),
        ("fibre_direction: [2, 0, 0]", "fibre_direction: 5", "expected three values [x, y, z], got 5"),
        ("solver: {end_time: 500 ms}", "solver: {}", "s.yaml:8: solver.end_time: this key is required"),
        ("name: test", "name: ../../etc", "s.yaml:1: name:"),
        ("source: uniform", "source: unifrom", "s.yaml:6: charge.orientation"),
        ("seed: 3", "seed: 3\nseed: 4", "s.yaml:3: not readable as YAML"),
        ("seed: 3", "seed: &a 3\ndescription: *a", "s.yaml:3: aliases"),
        ("seed: 3", "seed: !!python/object/apply:os.getcwd []", "not readable as YAML"),
        ("seed: 3", "seed: [", "not readable as YAML"),
        ("seed: 3", "seed: no", "s.yaml:2: seed:"),
    ],
)  # fmt: skip
def test_bad_scene_gets_one_clear_message(old: str, new: str, message: str) -> None:
    assert old in GOOD
    with pytest.raises(SceneError) as caught:
        parse_scene(GOOD.replace(old, new), Path("s.yaml"))
    assert message in str(caught.value)
    assert caught.value.exit_code == 2


def test_numbers_of_yaml_1_2() -> None:
    scene = parse_scene(GOOD.replace("spacing: 500 um", "spacing: 5e-1"))
    assert scene.charge is not None and scene.charge.spacing == (0.5, 0.5, 0.5)


@pytest.mark.parametrize("text", ["", "- 1", "just text", "3"])
def test_not_a_mapping(text: str) -> None:
    with pytest.raises(SceneError, match="a scene is a mapping"):
        parse_scene(text)


def test_files(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"no such scene file; did you mean .*demo\.yaml"):
        load_scene(CONFIGS / "demoo.yaml")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(tmp_path)
    big = tmp_path / "big.yaml"
    big.write_text("a" * 2_000_000)
    with pytest.raises(SceneError, match="larger"):
        load_scene(big)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match="cannot be read as text"):
        load_scene(binary)


def test_missing_section_is_named() -> None:
    with pytest.raises(SceneError, match="needs a section 'tooling:'"):
        parse_scene(GOOD).require("tooling")


def test_scene_is_frozen_and_round_trips() -> None:
    scene = parse_scene(GOOD)
    with pytest.raises(ValueError, match="frozen"):
        scene.seed = 4  # type: ignore[misc]
    assert Scene.model_validate(json.loads(json.dumps(scene.resolved()))) == scene


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_scenes_are_valid(path: Path) -> None:
    scene = load_scene(path)
    assert scene.name
    assert scene.locate("x") == path.parent / "x"


def test_shipped_schema_is_current() -> None:
    shipped = json.loads((CONFIGS / "schema" / "scene.schema.json").read_text())
    assert shipped == scene_json_schema(), "run: ppmc schema --output configs/schema/scene.schema.json"
