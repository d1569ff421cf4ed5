"""What `ppmc check` says about an analysis: regions and paths against the charge's own extent."""

import pytest

from ppmc.analysis.check import findings
from ppmc.errors import SceneError
from ppmc.geometry.parts import DoubleDome
from ppmc.scene.loader import parse_scene
from ppmc.scene.scene import Scene

SCENE = """
name: shapes
charge:
  domain: DOMAIN
  spacing: 1 mm
  orientation: {source: planar_random}
analysis:
  regions:
    inside: {min: [48, 28, 1], max: [52, 32, 2]}
    origin: {min: [0, 0, 0], max: [3, 3, 3]}
  paths:
    length: {kind: straight, axis: x1, slices: 7}
"""
DOMAINS = {
    "box": "{shape: box, origin: [40, 20, 0], size: [20, 20, 4]}",
    "rounded box": "{shape: rounded_box, center: [50, 30, 2], size: [20, 20, 4], edge_radius: 1}",
    "cylinder": "{shape: cylinder, center: [50, 30, 2], axis: [0, 0, 1], radius: 10, length: 4}",
    "extrusion": "{shape: extrusion, origin: [40, 20, 0], axis: [0, 0, 1], first_axis: [1, 0, 0], length: 4, "
    "profile: [[0, 0], [20, 0], [20, 20], [0, 20]]}",
}


@pytest.mark.parametrize("name", DOMAINS)
def test_every_shape_of_charge_has_its_own_bounds(name):
    told = findings(parse_scene(SCENE.replace("DOMAIN", DOMAINS[name])))
    assert told[0] == "2 regions, 1 paths with 7 inspection regions"
    assert told[1] == "at the start no material is in region origin: fine if the flow gets there"


def test_a_sheet_is_looked_for_on_its_tool():
    sections = DoubleDome().scene_sections()
    sections["charge"]["spacing"] = 4.0
    sections["analysis"] = {
        "regions": {
            # The punch is 60 mm high, its foot 60 mm to either side; the sheet is 140 mm long and lies on all of it.
            "top": {"min": [-5, 60, -5], "max": [5, 65, 5]},
            "wall": {"min": [45, 20, -5], "max": [60, 40, 5]},
            "beyond": {"min": [-5, 60, 80], "max": [5, 65, 90]},
        }
    }
    told = findings(Scene.model_validate({"name": "dome", **sections}))
    assert "no material is in region beyond:" in told[1]
    sections["charge"]["domain"]["centre"] = [500.0, 0.0, 0.0]
    with pytest.raises(SceneError, match=r"sheet misses tool 'punch'"):
        findings(Scene.model_validate({"name": "dome", **sections}))
    sections["charge"]["domain"]["tool"] = "pinch"
    with pytest.raises(SceneError, match=r"no tool 'pinch' in the scene's tooling \(it has punch, die\)"):
        findings(Scene.model_validate({"name": "dome", **sections}))


def test_without_a_charge_nothing_is_said_of_its_place():
    text = SCENE[: SCENE.index("charge:")] + SCENE[SCENE.index("analysis:") :]
    assert findings(parse_scene(text))[0] == "2 regions, 1 paths"
