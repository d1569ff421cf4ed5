from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from ppmc.geometry.tools.contacts import find_contacts
from ppmc.geometry.tools.toolset import ToolSet

STEP = [[-9, -9], [9, -9], [9, 0], [0, 0], [0, 4], [-9, 4]]


def contacts(tools: ToolSet, points: list[list[float]], reach: float = 1.0) -> list[list[tuple[float, list[float]]]]:
    """Return for each point its walls as (distance, rounded normal), the nearest first."""
    count, _, phi, normal = find_contacts(tools.arrays, tools.offsets(0.0), np.array(points, dtype=float), reach)
    assert (np.sort(phi, axis=1) == phi).all()
    return [
        [(round(float(phi[p, k]), 9), np.round(normal[p, k], 9).tolist()) for k in range(count[p])]
        for p in range(len(points))
    ]


def test_every_face_of_a_box_cavity(make_tools: Callable[..., ToolSet]) -> None:
    cavity = make_tools({"box": {"shape": "box", "center": [0, 0, 0], "size": [4, 6, 8], "inside": True}})
    middle, face, edge, corner, beyond = contacts(
        cavity, [[0, 0, 0], [1.9, 0, 0], [1.5, 2.8, 0], [1.9, -2.8, 3.7], [2.1, 3.2, 3.7]]
    )
    assert middle == []
    assert face == [(0.1, [-1, 0, 0])]
    assert edge == [(0.2, [0, -1, 0]), (0.5, [-1, 0, 0])]
    assert corner == [(0.1, [-1, 0, 0]), (0.2, [0, 1, 0]), (0.3, [0, 0, -1])]
    # Behind two walls at once: the depth below each, not the distance to their common edge.
    assert beyond == [(-0.2, [0, -1, 0]), (-0.1, [-1, 0, 0]), (0.3, [0, 0, -1])]


def test_inner_edge_of_a_step_and_its_outer_edge(make_tools: Callable[..., ToolSet]) -> None:
    step = make_tools({"step": {"shape": "extrusion", "axis": [0, 1, 0], "first_axis": [0, 0, 1], "profile": STEP}})
    # Outline coordinates: first along z, second along x (axis x first_axis).
    inner, outer, top = contacts(step, [[0.4, 0, 0.3], [4.3, 0, 0.4], [4.5, 0, -3]])
    assert inner == [(0.3, [0, 0, 1]), (0.4, [1, 0, 0])]
    assert outer == [(0.5, [0.6, 0, 0.8])]
    assert top == [(0.5, [1, 0, 0])]


def test_round_hole_with_a_flat_end(make_tools: Callable[..., ToolSet]) -> None:
    hole = make_tools(
        {
            "hole": {
                "shape": "cylinder",
                "center": [0, 0, 0],
                "axis": [0, 0, 1],
                "radius": 3,
                "length": 8,
                "inside": True,
            }
        }
    )
    assert contacts(hole, [[2.5, 0, 3.8], [0, 0, 3.8]]) == [
        [(0.2, [0, 0, -1]), (0.5, [-1, 0, 0])],
        [(0.2, [0, 0, -1])],
    ]


def test_dish_of_revolution(make_tools: Callable[..., ToolSet]) -> None:
    profile = [[0, -2], [6, -2], [6, 3], [4, 3], [4, 0], [0, 0]]
    dish = make_tools({"dish": {"shape": "revolution", "axis": [0, 0, 1], "profile": profile}})
    (walls,) = contacts(dish, [[0, 3.6, 0.3]])
    assert walls == [(0.3, [0, 0, 1]), (0.4, [0, -1, 0])]


def test_one_wall_outside_convex_tools(make_tools: Callable[..., ToolSet], cloud: np.ndarray) -> None:
    section = {
        "box": {"shape": "box", "center": [0, 0, 0], "size": [8, 6, 10]},
        "wedge": {
            "shape": "extrusion",
            "axis": [1, 0, 0],
            "first_axis": [0, 1, 0],
            "profile": [[0, 0], [9, 0], [0, 3]],
        },
        "pin": {"shape": "cylinder", "center": [3, 0, 0], "axis": [0, 0, 1], "radius": 3},
    }
    for name, tool in section.items():
        tools = make_tools({name: tool})
        count, _, phi, _ = find_contacts(tools.arrays, tools.offsets(0.0), cloud, 3.0)
        distance = tools.distances(cloud)[0][0]
        assert (count == (distance <= 3.0)).all()
        np.testing.assert_array_equal(phi[count > 0, 0], distance[count > 0])


def test_the_nearest_wall_is_the_distance(make_tools: Callable[..., ToolSet], cloud: np.ndarray) -> None:
    tools = make_tools(
        {
            "low": {"shape": "plane", "point": [0, 0, -6], "normal": [0, 0, 1]},
            "box": {"shape": "box", "center": [0, 0, 0], "size": [20, 18, 16], "inside": True},
            "step": {"shape": "extrusion", "axis": [0, 1, 0], "first_axis": [0, 0, 1], "profile": STEP, "length": 10},
        }
    )
    count, tool, phi, normal = find_contacts(tools.arrays, tools.offsets(0.0), cloud, 2.0)
    distance = tools.distances(cloud)[0].min(axis=0)
    np.testing.assert_array_equal(count > 0, distance <= 2.0)
    near = (distance <= 2.0) & (distance > 0.0)
    np.testing.assert_allclose(phi[near, 0], distance[near], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normal[tool >= 0], axis=1), 1.0, atol=1e-12)


def test_contacts_do_not_depend_on_the_threads(make_tools: Callable[..., ToolSet], cloud: np.ndarray) -> None:
    tools = make_tools({"box": {"shape": "box", "center": [0, 0, 0], "size": [20, 18, 16], "inside": True}})
    before = numba.get_num_threads()
    results = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        results.append(find_contacts(tools.arrays, tools.offsets(0.0), cloud, 2.0))
    numba.set_num_threads(before)
    for one, two in zip(*results, strict=True):
        np.testing.assert_array_equal(one, two)
