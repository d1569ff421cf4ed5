"""What `ppmc check` says about charges: particles, platelets, tools, volume balance."""

from pathlib import Path

import pytest

from ppmc.charge.check import findings
from ppmc.errors import InputFileError, SceneError
from ppmc.geometry.parts import DoubleDome, PinBracket
from ppmc.scene.loader import parse_scene
from ppmc.scene.scene import Scene

BLOCK = """
name: block
charge:
  domain: {shape: box, size: [20, 10, 4]}
  spacing: 1 mm
  orientation: {source: planar_random}
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 4], normal: [0, 0, -1], motion: {velocity: [0, 0, -1], travel: 2}}
  frame: {shape: box, center: [20, 5, 0], size: [40, 10, 20], inside: true}
solver: {end_time: 2}
"""


def said(text: str) -> str:
    return "\n".join(findings(parse_scene(text)))


def test_particles_and_balance_of_a_block():
    assert "800 particles in 4 layers, spacing 1 x 1 x 1 mm, 800 mm^3" in said(BLOCK)
    assert "takes 100.00% of the closed cavity of 800" in said(BLOCK)
    assert "50.00% of the closed cavity" in said(BLOCK.replace("end_time: 2", "end_time: 1e-9"))
    assert said(BLOCK.replace("end_time: 2", "end_time: 1e-9")).endswith("a short shot")
    farther = BLOCK.replace("travel: 2", "travel: 2.05").replace("end_time: 2", "end_time: 2.2")
    assert "too much" in said(farther) and "by about 0.05 mm" in said(farther)
    with pytest.raises(SceneError, match=r"takes 111\.11% of the closed cavity.*too much"):
        said(farther.replace("2.05", "2.2"))


def test_open_and_forced_tools():
    no_frame = BLOCK.replace("  frame: {shape: box, center: [20, 5, 0], size: [40, 10, 20], inside: true}\n", "")
    assert "free sides" in said(no_frame)
    force = "motion: {force: 5 N, direction: [0, 0, -1], max_speed: 1 mm/s}"
    assert "tools under force" in said(BLOCK.replace("motion: {velocity: [0, 0, -1], travel: 2}", force))


def test_a_charge_inside_a_tool_and_a_faulty_tool_are_refused(tmp_path: Path):
    with pytest.raises(SceneError, match="particles are inside 'lower'"):
        findings(parse_scene(BLOCK.replace("point: [0, 0, 0]", "point: [0, 0, 1]")))
    (tmp_path / "ram.stl").write_text("solid a\nendsolid a\n")
    faulty = BLOCK.replace("frame: {shape: box, center: [20, 5, 0], size: [40, 10, 20], inside: true}",
                           "frame: {shape: mesh, file: ram.stl}")  # fmt: skip
    with pytest.raises(InputFileError, match=r"ram\.stl"):
        findings(parse_scene(faulty, tmp_path / "scene.yaml"))


def test_platelets_of_few_particles_are_named():
    few = BLOCK.replace("{source: planar_random}", "{source: platelets, length: 2, width: {mean: 1.5, deviation: 0.1}}")
    assert "fewer than 4 particles" in said(few)
    many = BLOCK.replace("{source: planar_random}", "{source: platelets, length: 6, width: {values: [2, 4]}}")
    assert "a platelet of 6 x 4 mm has about 24 particles" in said(many)


@pytest.mark.parametrize("part", [PinBracket(hole_diameter=9.525), DoubleDome(), DoubleDome(charge="axial")])
def test_parts_are_full_at_closure(part):
    sections = part.scene_sections()
    sections["charge"]["spacing"] = 3.0
    text = findings(Scene.model_validate({"name": "part", **sections}))[-1]
    share = float(text.split("takes ")[1].split("%")[0])
    assert share == pytest.approx(100.0, abs=0.1)


def test_no_charge_says_nothing():
    assert findings(parse_scene("name: empty")) == []
