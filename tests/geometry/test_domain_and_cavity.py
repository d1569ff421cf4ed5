from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
import pyvista
from pydantic import Field, TypeAdapter

from ppmc.errors import SceneError
from ppmc.geometry.cavity.cavity import cavity_volume
from ppmc.geometry.domain import Domain, closed_domain
from ppmc.geometry.tools.checks import check_charge_clear, check_tools_apart, tool_gaps
from ppmc.geometry.tools.toolset import ToolSet
from ppmc.scene.sections.tooling import SolidTool

LOW = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
RAM = {"shape": "plane", "point": [0, 0, 6], "normal": [0, 0, -1], "motion": {"velocity": [0, 0, -3]}}
SIDES = {"shape": "box", "center": [10, 5, 0], "size": [20, 10, 100], "inside": True}

TRIANGLE = [[0, 0], [4, 0], [0, 3]]


def domain(**shape: Any) -> Domain:
    return closed_domain(TypeAdapter(Annotated[SolidTool, Field(discriminator="shape")]).validate_python(shape))


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        ({"shape": "box", "center": [1, 2, 3], "size": [4, 6, 8], "rotation": {"axis": [1, 1, 0], "angle": 30}}, 192.0),
        ({"shape": "rounded_box", "center": [0, 0, 0], "size": [6, 6, 6], "edge_radius": 3}, 36 * np.pi),
        ({"shape": "cylinder", "center": [1, 0, 0], "axis": [1, 2, 0], "radius": 2, "length": 5}, 20 * np.pi),
        (
            {"shape": "cylinder", "center": [0, 0, 0], "axis": [0, 0, 1], "radius": 2, "length": 4, "edge_radius": 2},
            32 / 3 * np.pi,
        ),
        (
            {"shape": "extrusion", "axis": [1, 0, 0], "first_axis": [0, 1, 0], "profile": TRIANGLE, "length": 5},
            30.0,
        ),
        ({"shape": "revolution", "axis": [0, 1, 0], "profile": [[0, 0], [3, 0], [0, 4]]}, 12 * np.pi),
        (
            {"shape": "revolution", "axis": [0, 0, 1], "profile": [[0, 0], [3, 0], [3, 2], [0, 2]], "spine": 5},
            18 * np.pi + 60,
        ),
    ],
)  # fmt: skip
def test_volume_bounds_and_contents(shape: dict[str, Any], volume: float) -> None:
    region = domain(**shape)
    assert region.volume == pytest.approx(volume, rel=1e-12)
    low, high = region.bounds
    points = np.random.default_rng(0).uniform(low, high, (200_000, 3))
    box = float(np.prod(high - low))
    share = region.volume / box
    assert region.contains(points).mean() == pytest.approx(
        share, abs=5 * np.sqrt(share * (1 - share) / len(points)) + 1e-9
    )
    assert not region.contains([high + 0.01]).any()


def test_domain_of_a_mesh_in_its_place(tmp_path: Path) -> None:
    pyvista.Box(bounds=(0, 4, 0, 2, 0, 1)).triangulate().save(tmp_path / "a.stl")
    region = domain(
        shape="mesh", file=str(tmp_path / "a.stl"), origin=[10, 0, 0], rotation={"axis": [0, 0, 1], "angle": 90}
    )
    assert region.volume == pytest.approx(8.0)
    np.testing.assert_allclose(region.bounds, [[8, 0, 0], [10, 4, 1]], atol=1e-12)
    assert region.contains([[9, 3, 0.5], [11, 1, 0.5]]).tolist() == [True, False]


def test_an_endless_shape_cannot_be_filled() -> None:
    with pytest.raises(SceneError, match="`length`"):
        domain(shape="cylinder", center=[0, 0, 0], axis=[1, 0, 0], radius=2)


def test_cavity_of_a_squeeze_in_a_box(make_tools: Callable[..., ToolSet]) -> None:
    tools = make_tools({"low": LOW, "ram": RAM, "sides": SIDES})
    for time, height in ((0.0, 6.0), (1.0, 3.0), (1.5, 1.5)):
        found = cavity_volume(tools, [[10, 5, 0.5]], time, spacing=0.5)
        assert found.closed
        assert found.volume == pytest.approx(200 * height, rel=1e-3)


def test_cavity_is_found_from_points_that_the_ram_has_passed(make_tools: Callable[..., ToolSet]) -> None:
    seeds = [[10, 5, z] for z in np.arange(0.5, 6.0)]
    cavity = cavity_volume(make_tools({"low": LOW, "ram": RAM, "sides": SIDES}), seeds, 1.5)
    assert cavity.closed
    assert cavity.volume == pytest.approx(20 * 10 * 1.5, rel=0.01)


def test_cavity_with_a_pin_and_a_round_end(make_tools: Callable[..., ToolSet]) -> None:
    tools = make_tools(
        {
            "low": LOW,
            "top": {**LOW, "point": [0, 0, 4], "normal": [0, 0, -1]},
            "hole": {"shape": "cylinder", "center": [0, 0, 0], "axis": [0, 0, 1], "radius": 10, "inside": True},
            "pin": {"shape": "cylinder", "center": [3, 0, 0], "axis": [0, 0, 1], "radius": 3},
        }
    )
    found = cavity_volume(tools, [[-5, 0, 2]], spacing=0.5)
    assert found.closed
    assert found.volume == pytest.approx(4 * np.pi * (100 - 9), rel=2e-4)


def test_open_cavity_and_no_cavity(make_tools: Callable[..., ToolSet]) -> None:
    plates = make_tools({"low": LOW, "ram": RAM})
    assert not cavity_volume(plates, [[0, 0, 3]]).closed
    with pytest.raises(SceneError, match="free space"):
        cavity_volume(plates, [[0, 0, -3]])


def test_touching_walls_leave_no_slit(make_tools: Callable[..., ToolSet]) -> None:
    core = {"shape": "box", "center": [10, 5, 10], "size": [20, 10, 14]}
    found = cavity_volume(make_tools({"low": LOW, "core": core, "sides": SIDES}), [[10, 5, 1]], spacing=0.5)
    assert found.closed
    assert found.volume == pytest.approx(600.0, rel=1e-3)


def test_ram_through_the_lower_plate(make_tools: Callable[..., ToolSet]) -> None:
    tools = make_tools({"low": LOW, "ram": RAM, "sides": SIDES})
    box = [0, 0, 0], [20, 10, 6]
    check_tools_apart(tools, *box, end_time=1.9)
    (gap,) = [g for g in tool_gaps(tools, *box, end_time=1.0) if {g.first, g.second} == {"low", "ram"}]
    assert gap.gap == pytest.approx(3.0)
    assert gap.time == 1.0
    with pytest.raises(SceneError, match=r"'low' and 'ram' overlap by 1.5 mm at t = 2.5 s.*end_time"):
        check_tools_apart(tools, *box, end_time=2.5)
    with pytest.raises(SceneError, match=r"leave a gap of 0 mm"):
        check_tools_apart(tools, *box, end_time=2.0)


def test_tools_that_overlap_at_the_start(make_tools: Callable[..., ToolSet]) -> None:
    tools = make_tools({"low": LOW, "high": {**RAM, "point": [0, 0, -1], "motion": {}}})
    with pytest.raises(SceneError, match=r"overlap by 1 mm at t = 0 s.*move one"):
        check_tools_apart(tools, [0, 0, 0], [20, 10, 6], end_time=1.0)


def test_a_ram_that_reaches_into_side_walls_closes_on_the_plate_alone(make_tools: Callable[..., ToolSet]) -> None:
    ram = {"shape": "box", "center": [10, 5, 14], "size": [24, 14, 16], "motion": {"velocity": [0, 0, -1]}}
    tools = make_tools({"low": LOW, "ram": ram, "sides": SIDES})
    check_tools_apart(tools, [0, 0, 0], [20, 10, 6], end_time=5.5)
    with pytest.raises(SceneError, match="'low' and 'ram' overlap"):
        check_tools_apart(tools, [0, 0, 0], [20, 10, 6], end_time=6.5)


def test_tools_under_a_sheet_on_a_punch_may_overlap(make_tools: Callable[..., ToolSet]) -> None:
    # The die's cavity ends at the punch's foot, but the punch goes on below it.
    punch = {"shape": "box", "center": [0, 0, 0], "size": [20, 20, 20]}
    die = {"shape": "box", "center": [0, 0, 14], "size": [26, 26, 20], "inside": True}
    die["motion"] = {"velocity": [0, 0, -1], "travel": 9}
    tools = make_tools({"punch": punch, "die": die})
    box = [-13, -13, 4], [13, 13, 14]
    check_tools_apart(tools, *box, end_time=9.0)
    deeper = make_tools({"punch": punch, "die": {**die, "motion": {"velocity": [0, 0, -1], "travel": 15}}})
    with pytest.raises(SceneError, match="'punch' and 'die' overlap by 1 mm"):
        check_tools_apart(deeper, *box, end_time=15.0)


def test_charge_inside_a_tool(make_tools: Callable[..., ToolSet]) -> None:
    tools = make_tools({"low": LOW, "ram": RAM, "sides": SIDES})
    check_charge_clear(tools, [[0.5, 0.5, 0.5], [1.0, 9.5, 5.5]])
    with pytest.raises(SceneError, match=r"1 of 2 particles are inside 'ram', the deepest by 0.5 mm at \(1, 1, 6.5\)"):
        check_charge_clear(tools, [[0.5, 0.5, 0.5], [1.0, 1.0, 6.5]])
