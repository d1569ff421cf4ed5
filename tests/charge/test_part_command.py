"""The command `ppmc part`: scenes that load, meshes that read, settings that are checked."""

import meshio
import pytest

from ppmc.charge.stage import run
from ppmc.errors import SceneError
from ppmc.files import read_particles
from ppmc.geometry.parts import PARTS, DoubleDome
from ppmc.geometry.parts.cli import part
from ppmc.geometry.parts.scene_text import make_part, scene_text
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.loader import load_scene, parse_scene


@pytest.mark.parametrize("name", PARTS)
def test_scene_of_a_part_loads_whole(name):
    made = PARTS[name]()
    scene = parse_scene(scene_text(made, name, 2.0))
    assert scene.name == name
    assert scene.solver.end_time == pytest.approx(made.closing_time)
    assert scene.tooling and scene.charge and scene.material and scene.analysis.regions
    moving = [t for t in scene.tooling.values() if hasattr(t.motion, "velocity")]
    assert len(moving) == 1 and moving[0].motion.travel == pytest.approx(made.stroke)


@pytest.mark.parametrize("name", PARTS)
def test_charge_of_a_part_lies_free_in_its_open_tools(name, tmp_path):
    made = PARTS[name]()
    scene = parse_scene(scene_text(made, name, 4.0))
    charge = read_particles(run(scene, output=tmp_path / "charge.vtkhdf"), "charge")
    assert charge.fields["volume"].sum() == pytest.approx(made.charge_volume, rel=1e-9)
    half = 0.5 * min(charge.extra["spacing"])
    clearance, _ = compile_tools(scene.tooling).clearance(charge.positions)
    # Bends thin the innermost cells of a draped charge to about two thirds.
    assert clearance.min() > (0.6 if name == "double_dome" else 0.98) * half


@pytest.mark.slow
def test_axial_charge_of_the_double_dome_lies_free_too(tmp_path):
    # Slow: the sheet is pressed together round both ends, which takes a thousand steps of forming.
    made = DoubleDome(charge="axial")
    charge = read_particles(run(parse_scene(scene_text(made, "axial", 3.0)), output=tmp_path / "c.vtkhdf"), "charge")
    clearance, _ = compile_tools(parse_scene(scene_text(made, "axial", 3.0)).tooling).clearance(charge.positions)
    assert clearance.min() > 0.5
    assert charge.extra["width_ratio"] == pytest.approx(1, abs=1e-2)
    assert 0.6 < charge.extra["least_areal_stretch"] < charge.extra["largest_areal_stretch"] < 1.15


def test_command_writes_scene_and_mesh(tmp_path, capsys):
    command = [
        "pin_bracket",
        "--set",
        "hole_diameter=0.375 inch",
        "--set",
        "flanges=minus",
        "--set",
        "flange_thickness=10",
    ]
    command += ["--output", str(tmp_path / "small.yaml"), "--mesh", str(tmp_path / "small.vtu"), "--mesh-size", "4"]
    part(command, result_action="return_value")
    scene = load_scene(tmp_path / "small.yaml")
    assert scene.name == "small" and scene.tooling["pin"].radius == pytest.approx(4.7625)
    assert set(scene.tooling) == {"mould", "core_1", "core_2", "pin", "ram"}
    assert meshio.read(tmp_path / "small.vtu").cells[0].type == "hexahedron"
    assert "bricks" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("bracket", [], "no part 'bracket'; there are pin_bracket"),
        ("pin_bracket", ["hole=3"], "has no dimension 'hole'; it has closing_speed, length"),
        ("pin_bracket", ["hole_diameter=3 s"], "pin_bracket.hole_diameter: .*wrong dimension"),
        ("pin_bracket", ["hole_diameter=50"], "does not fit a width"),
        ("plaque", ["length"], "write key=value"),
    ],
)
def test_bad_settings(name, settings, message):
    with pytest.raises(SceneError, match=message):
        make_part(name, settings)
