from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from ppmc.errors import SceneError
from ppmc.geometry.tools.toolset import ToolSet, compile_tools
from ppmc.scene.sections.tooling import Tool

PLANE = {"shape": "plane", "point": [0, 0, "6 mm"], "normal": [0, 0, -1]}
TABLE = {"times": ["0 s", "1 s", "3 s"], "displacements": [[0, 0, 0], [0, 0, -2], [0, 0, "-3 mm"]]}


@pytest.fixture(scope="module")
def tools(make_tools: Callable[..., ToolSet]) -> ToolSet:
    return make_tools(
        {
            "fixed": PLANE,
            "ram": {
                **PLANE,
                "motion": {"velocity": [0, 0, "-3.55 mm/s"], "start": 0.5, "travel": 3.55},
                "wall": "no_slip",
            },
            "table": {**PLANE, "motion": TABLE, "wall": {"friction": "2 Pa*s/mm"}},
            "press": {**PLANE, "motion": {"force": "500 N", "direction": [0, 0, -2], "max_speed": 5, "travel": 2}},
        }
    )


def test_displacement_velocity_and_breaks(tools: ToolSet) -> None:
    assert tools.offsets(0.0).tolist() == np.zeros((4, 3)).tolist()
    np.testing.assert_allclose(tools.offsets(1.0)[:, 2], [0, -1.775, -2, 0])
    np.testing.assert_allclose(tools.offsets(9.0)[:, 2], [0, -3.55, -3, 0])
    np.testing.assert_allclose(tools.velocities(0.5)[:, 2], [0, -3.55, -2, 0])
    np.testing.assert_allclose(tools.velocities(1.0)[:, 2], [0, -3.55, -0.5, 0])
    np.testing.assert_allclose(tools.velocities(3.0)[:, 2], 0.0)
    breaks, time = [], 0.0
    while (time := tools.next_break(time)) < math.inf:
        breaks.append(time)
    assert breaks == [0.5, 1.0, 1.5, 3.0]


def test_steps_that_add_up_to_a_knot_reach_it(tools: ToolSet) -> None:
    time = sum([0.1] * 10)
    assert time < 1.0
    assert tools.next_break(time) == 1.5
    assert tools.velocities(time)[2, 2] == -0.5


def test_forced_tool_and_walls(tools: ToolSet) -> None:
    (control,) = tools.motions.forced
    assert (control.tool, control.force, control.max_speed, control.travel) == (3, 5e8, 5.0, 2.0)
    assert control.direction.tolist() == [0, 0, -1]
    assert [tool.wall.slip_length for tool in tools.tools] == [math.inf, 0.0, 0.5, math.inf]


def test_moving_a_tool_moves_its_distance(tools: ToolSet, cloud: np.ndarray) -> None:
    shift = tools.offsets(1.2)
    for k in range(len(tools)):
        moved = tools.distances(cloud + shift[k], 1.2)[0][k]
        np.testing.assert_allclose(moved, tools.distances(cloud)[0][k], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"motion": {"times": [0, 1], "displacements": [[0, 0, 0]] * 3}}, "one each"),
        ({"motion": {"times": [0, 2, 1], "displacements": [[0, 0, 0]] * 3}}, "must ascend"),
        ({"motion": {"velocity": [0, 0, 0], "travel": 1}}, "velocity is zero"),
        ({"motion": {"velocity": [0, 0, "3 s"]}}, "wrong dimension"),
        ({"motion": {"force": 5}}, "max_speed"),
        ({"motion": {"speed": 5}}, "speed"),
        ({"wall": "sticky"}, "no_slip"),
        ({"wall": {"friction": -1}}, "greater than 0"),
        ({"shape": "wedge"}, "set `shape` to plane, box"),
        ({"shape": "box", "center": [0, 0, 0], "size": [1, 0, 1]}, "greater than 0"),
        ({"normal": [0, 0, 0]}, "zero vector"),
    ],
)
def test_faulty_tools(change: dict[str, Any], message: str) -> None:
    data = {**PLANE, **change}
    if data["shape"] == "box":
        data = {k: v for k, v in data.items() if k not in ("point", "normal")}
    with pytest.raises(ValidationError, match=message):
        TypeAdapter(Tool).validate_python(data)


def test_shapes_that_do_not_fit() -> None:
    sweep = {"shape": "extrusion", "axis": [1, 0, 0]}
    cases = [
        ({"shape": "rounded_box", "center": [0, 0, 0], "size": [2, 4, 4], "edge_radius": 1.5}, "half the shortest"),
        ({"shape": "cylinder", "center": [0, 0, 0], "axis": [1, 0, 0], "radius": 1, "edge_radius": 2}, "not exceed"),
        ({**sweep, "first_axis": [1, 1, 0], "profile": [[0, 0], [1, 0], [0, 1]]}, "normal to"),
        ({"shape": "revolution", "axis": [1, 0, 0], "profile": [[-1, 0], [1, 0], [0, 1]]}, "negative first"),
        ({**sweep, "first_axis": [0, 1, 0], "profile": [[0, 0], [1, 0], [1, 0]]}, "repeats"),
    ]
    for data, message in cases:
        with pytest.raises(ValidationError, match=message):
            TypeAdapter(Tool).validate_python(data)
    with pytest.raises(SceneError, match="no tool"):
        compile_tools({})


def test_a_tool_survives_the_resolved_scene() -> None:
    adapter = TypeAdapter(Tool)
    for motion in ({}, {"fixed": True}, TABLE, {"velocity": [1, 0, 0]}):
        tool = adapter.validate_python({**PLANE, "motion": motion})
        assert adapter.validate_python(adapter.dump_python(tool, mode="json")) == tool
