"""The closed cavity of moulds of all kinds against its closed form, and tools that overlap at its edge."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ppmc.errors import SceneError
from ppmc.geometry.cavity.cavity import cavity_volume
from ppmc.geometry.cavity.charge_balance import charge_balance
from ppmc.geometry.tools.toolset import ToolSet, rotation_matrix
from ppmc.scene.sections.tooling import Rotation

from .moulds import solid_of_boxes, turned, write_stl

Make = Callable[..., ToolSet]
OBLIQUE = {"axis": (1.0, 2.0, 3.0), "angle": 37.0}
# A pocket of 16 x 12 x 8 with a rib of 2.5 x 12 x 4 below it; the punch stands 2 above the floor.
DIE = solid_of_boxes(
    [((-5, 21), (-5, 17), (-8, 8))], [((0, 16), (0, 12), (0, 8)), ((6, 8.5), (0, 12), (-4, 0))]
)  # fmt: skip
VOLUME = 16 * 12 * 2 + 2.5 * 12 * 4
SEEDS = np.stack(np.meshgrid(np.arange(4.5, 12), np.arange(3.5, 9), np.arange(0.5, 6), indexing="ij"), -1).reshape(
    -1, 3
)


def punch(clearance: float, *, above: float = 2.0) -> Any:
    return solid_of_boxes([((clearance, 16 - clearance), (clearance, 12 - clearance), (above, 14))])


def mesh(file: str, **keys: Any) -> dict[str, Any]:
    return {"shape": "mesh", "file": file, **keys}


@pytest.mark.parametrize("clearance", [0.0, 0.05, 0.3, 0.9])
@pytest.mark.parametrize("oblique", [False, True])
def test_clearances_below_a_spacing_are_closed(
    make_tools: Make, tmp_path: Path, clearance: float, oblique: bool
) -> None:
    turn = rotation_matrix(Rotation.model_validate(OBLIQUE)) if oblique else np.eye(3)
    tools = make_tools(
        {
            "die": mesh(write_stl(tmp_path / "die.stl", DIE, turn)),
            "punch": mesh(write_stl(tmp_path / "punch.stl", punch(clearance, above=8.0), turn),
                          motion={"velocity": (turn @ [0, 0, -6]).tolist(), "travel": 6}),
        }
    )  # fmt: skip
    seeds = SEEDS @ turn.T
    found = cavity_volume(tools, seeds, 1.0, spacing=1.0)
    assert found.closed
    assert found.volume == pytest.approx(VOLUME, rel=0.01)
    # A wider gap lets it out.
    assert not cavity_volume(tools, seeds, 0.0, spacing=0.5 * clearance).closed if clearance else True
    balance = charge_balance(tools, seeds, 1.0, 1.35 * VOLUME, 1.0)
    assert balance.share == pytest.approx(1.35, rel=0.01)
    assert "less travel" in balance.told
    less = float(balance.told.split("by about ")[1].split()[0])
    assert less == pytest.approx(0.35 * VOLUME / (16 * 12), rel=0.05)
    with pytest.raises(SceneError, match=r"scene\.yaml: at 1 s the charge takes 13[45]\.\d+%.*bulk_modulus"):
        balance.check_room(None, "scene.yaml")
    balance.check_room(1e6, "scene.yaml")


@pytest.mark.parametrize("clearance", [0.05, 0.3, 0.7])
def test_a_round_plunger_in_its_pot(make_tools: Make, tmp_path: Path, clearance: float) -> None:
    pot = turned([(0, -4), (14, -4), (14, 12), (10, 12), (10, 0), (0, 0)])
    radius = 10 - clearance
    tools = make_tools(
        {
            "pot": mesh(write_stl(tmp_path / "pot.stl", pot, scale=1e-3), unit="m"),
            "plunger": mesh(write_stl(tmp_path / "plunger.stl", turned([(0, 3), (radius, 3), (radius, 14), (0, 14)])),
                            motion={"velocity": [0, 0, -1], "travel": 0.5}),
        }
    )  # fmt: skip
    found = cavity_volume(tools, [[0, 0, 1], [3, 0, 1]], 1.0, spacing=0.8)
    area = 48 * 100 * np.sin(2 * np.pi / 96)
    assert found.closed
    assert found.volume == pytest.approx(2.5 * area, rel=0.01)


def test_mixed_tools_and_three_of_them(make_tools: Make, tmp_path: Path) -> None:
    die = write_stl(tmp_path / "die.stl", DIE)
    ram = {"shape": "box", "center": [8, 6, 6], "size": [15.6, 11.6, 8]}
    assert cavity_volume(make_tools({"die": mesh(die), "ram": ram}), SEEDS, spacing=1.0).volume == pytest.approx(
        VOLUME, rel=0.01
    )
    lid = {"shape": "plane", "point": [0, 0, 8.2], "normal": [0, 0, -1]}
    closed = cavity_volume(make_tools({"die": mesh(die), "lid": lid}), SEEDS, spacing=1.0)
    assert closed.volume == pytest.approx(16 * 12 * 8.2 + 2.5 * 12 * 4, rel=0.005)
    # A frame with a punch from above and one from below, each with its own clearance.
    frame = solid_of_boxes([((-5, 15), (-5, 13), (0, 12))], [((0, 10), (0, 8), (0, 12))])
    lower = solid_of_boxes([((0.2, 9.8), (0.2, 7.8), (-6, 3))])
    upper = solid_of_boxes([((0.4, 9.6), (0.4, 7.6), (6, 20))])
    names = {"frame": frame, "lower": lower, "upper": upper}
    tools = make_tools({name: mesh(write_stl(tmp_path / f"{name}.stl", m)) for name, m in names.items()})
    assert cavity_volume(tools, [[5, 4, 4], [2, 2, 5]], spacing=0.7).volume == pytest.approx(240, rel=0.01)


def test_of_two_pockets_the_reachable_one(make_tools: Make, tmp_path: Path) -> None:
    die = solid_of_boxes([((-4, 30), (-4, 14), (-6, 6))], [((0, 10), (0, 10), (0, 6)), ((14, 26), (0, 10), (-3, 6))])
    tops = solid_of_boxes(
        [((-4, 30), (-4, 14), (6, 9)), ((0.2, 9.8), (0.2, 9.8), (3, 7)), ((14.2, 25.8), (0.2, 9.8), (3, 7))]
    )
    tools = make_tools({
        "die": mesh(write_stl(tmp_path / "die.stl", die), grid_spacing=0.15),
        "top": mesh(write_stl(tmp_path / "top.stl", tops), grid_spacing=0.15),
    })  # fmt: skip
    for seeds, volume in (([[5, 5, 1.5]], 300.0), ([[20, 5, 0]], 720.0), ([[5, 5, 1.5], [20, 5, 0]], 1020.0)):
        assert cavity_volume(tools, seeds, spacing=1.0).volume == pytest.approx(volume, rel=0.01)


def test_plates_without_side_walls_are_open(make_tools: Make, tmp_path: Path) -> None:
    lower, upper = solid_of_boxes([((0, 40), (0, 40), (-5, 0))]), solid_of_boxes([((0, 40), (0, 40), (4, 9))])
    files = {"lower": lower, "upper": upper}
    tools = make_tools({name: mesh(write_stl(tmp_path / f"{name}.stl", m)) for name, m in files.items()})
    assert not cavity_volume(tools, [[20, 20, 2]], spacing=1.0).closed
    assert charge_balance(tools, np.array([[20.0, 20.0, 2.0]]), 1.0, 50.0, 1.0).share is None
    # One side without a wall, of planes that are turned: open, and closed with the last of them.
    turn = rotation_matrix(Rotation.model_validate(OBLIQUE))
    walls = {}
    for axis in range(3):
        for end in (0, 1):
            normal, point = np.zeros(3), np.zeros(3)
            normal[axis], point[axis] = (1, 0) if end == 0 else (-1, (30, 20, 4)[axis])
            walls[f"w{axis}{end}"] = {
                "shape": "plane", "point": (turn @ point).tolist(), "normal": (turn @ normal).tolist()
            }  # fmt: skip
    seeds = np.array([[3.0, 3.0, 2.0], [5.0, 4.0, 2.0]]) @ turn.T
    assert cavity_volume(make_tools(walls), seeds, spacing=1.0).volume == pytest.approx(2400, rel=0.002)
    walls.pop("w01")
    assert not cavity_volume(make_tools(walls), seeds, spacing=1.0).closed


def test_a_charge_thinner_than_a_spacing(make_tools: Make, tmp_path: Path) -> None:
    tools = make_tools(
        {
            "die": mesh(write_stl(tmp_path / "die.stl", solid_of_boxes(
                [((-5, 21), (-5, 17), (-8, 8))], [((0, 16), (0, 12), (0, 8))]))),
            "punch": mesh(write_stl(tmp_path / "punch.stl", punch(0.1, above=0.6))),
        }
    )  # fmt: skip
    found = cavity_volume(tools, SEEDS, spacing=1.0)
    assert found.closed and found.clearance < 0.6
    assert found.volume == pytest.approx(16 * 12 * 0.6, rel=0.01)


def moulded(make_tools: Make, tmp_path: Path, upper: Any, **keys: Any) -> ToolSet:
    tool = upper if isinstance(upper, dict) else mesh(write_stl(tmp_path / "punch.stl", upper))
    motion = {"velocity": [0, 0, -6], "travel": 6}
    return make_tools({"die": mesh(write_stl(tmp_path / "die.stl", DIE)), "punch": {**tool, "motion": motion, **keys}})


@pytest.mark.parametrize("kind", ["mesh", "box", "one side"])
def test_a_punch_wider_than_its_pocket_is_refused(make_tools: Make, tmp_path: Path, kind: str) -> None:
    upper: Any = punch(-0.2, above=8.0)
    if kind == "box":
        upper = {"shape": "box", "center": [8, 6, 13], "size": [16.4, 12.4, 10]}
    if kind == "one side":
        upper = solid_of_boxes([((0.1, 15.9), (0.1, 12.2), (8, 20))])
    tools = moulded(make_tools, tmp_path, upper)
    with pytest.raises(SceneError, match=r"'die' and 'punch' overlap by 0\.2\d* mm at t = 1 s near .*; make one"):
        charge_balance(tools, SEEDS, 1.0, VOLUME, 1.0)


def test_overlap_out_of_reach_and_planes_are_let_pass(make_tools: Make, tmp_path: Path) -> None:
    # A shoulder that sinks into the rim of the die, six spacings above the cavity.
    shouldered = solid_of_boxes([((0.1, 15.9), (0.1, 11.9), (8, 20)), ((-3, 19), (-3, 15), (13.5, 20))])
    tools = moulded(make_tools, tmp_path, shouldered)
    assert charge_balance(tools, SEEDS, 1.0, VOLUME, 1.0).share == pytest.approx(1.0, rel=0.01)
    ram = {"shape": "plane", "point": [0, 0, 8], "normal": [0, 0, -1]}
    assert charge_balance(moulded(make_tools, tmp_path, ram), SEEDS, 1.0, VOLUME, 1.0).share == pytest.approx(
        1, rel=0.01
    )


def test_a_boss_that_is_pressed_into_the_floor_far_from_the_charge(make_tools: Make, tmp_path: Path) -> None:
    boss = solid_of_boxes([((0.1, 15.9), (0.1, 11.9), (8, 20)), ((12, 15), (2, 6), (5.7, 9))])
    with pytest.raises(SceneError, match=r"'die' and 'punch' overlap by 0\.3\d* mm .*shorten `travel`"):
        charge_balance(moulded(make_tools, tmp_path, boss), SEEDS[SEEDS[:, 0] < 10], 1.0, VOLUME, 1.0)


def test_insert_at_rest_is_told(make_tools: Make, tmp_path: Path) -> None:
    # Set into the floor by half a millimetre.
    insert = solid_of_boxes([((11, 14), (3, 9), (-0.5, 0.5))])
    motion = {"velocity": [0, 0, -6], "travel": 6}
    tools = make_tools(
        {
            "die": mesh(write_stl(tmp_path / "die.stl", DIE)),
            "insert": mesh(write_stl(tmp_path / "insert.stl", insert)),
            "punch": mesh(write_stl(tmp_path / "punch.stl", punch(0.1, above=8.0)), motion=motion),
        }
    )
    balance = charge_balance(tools, SEEDS, 1.0, VOLUME - 9, 1.0)
    assert balance.share == pytest.approx(1.0, rel=0.01)
    assert "'die' and 'insert' overlap by 0.5" in balance.told


def test_tools_that_press_and_withdraw_and_tools_under_force(make_tools: Make, tmp_path: Path) -> None:
    above = punch(0.1, above=8.0)
    table = {"times": [0, 0.6, 0.8, 1.0], "displacements": [[0, 0, 0], [0, 0, -6], [0, 0, -6], [0, 0, -5]]}
    balance = charge_balance(moulded(make_tools, tmp_path, above, motion=table), SEEDS, 1.0, 1.1 * VOLUME, 1.0)
    assert balance.share == pytest.approx(1.1, rel=0.01) and balance.told.startswith("at 0.8 s")
    force = {"force": "5 N", "direction": [0, 0, -1], "max_speed": 6.0}
    unknown = charge_balance(moulded(make_tools, tmp_path, above, motion=force), SEEDS, 1.0, VOLUME, 1.0)
    assert unknown.share is None
    stopped = moulded(make_tools, tmp_path, above, motion={**force, "travel": 6.0})
    balance = charge_balance(stopped, SEEDS, 1.0, 1.3 * VOLUME, 1.0)
    assert balance.share == pytest.approx(1.3, rel=0.01) and "at their stops" in balance.told
    balance.check_room(None, "charge")  # a force does not press what has no room


def test_a_charge_that_is_carried_away_from_where_it_lay(make_tools: Make, tmp_path: Path) -> None:
    sleeve = {"shape": "cylinder", "center": [0, 0, 0], "axis": [0, 0, 1], "radius": 6, "inside": True}
    ram = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "motion": {"velocity": [0, 0, 30], "travel": 30}}
    lid = {"shape": "plane", "point": [0, 0, 33], "normal": [0, 0, -1]}
    seeds = np.array([[0.0, 0.0, z] for z in (0.5, 1.5, 2.5)])
    balance = charge_balance(make_tools({"sleeve": sleeve, "ram": ram, "lid": lid}), seeds, 1.0, 108 * np.pi, 0.5)
    assert balance.share == pytest.approx(1.0, rel=0.002)
