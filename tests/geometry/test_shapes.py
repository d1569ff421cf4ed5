"""Signed distances against their closed forms in plain numpy, and against what every exact distance must satisfy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ppmc.errors import SceneError
from ppmc.geometry.tools.distance import distance_bound
from ppmc.geometry.tools.outline import outline_integrals, outline_segments
from ppmc.geometry.tools.toolset import ToolSet

U_PROFILE = [[-5, 0], [5, 0], [5, 6], [2, 6], [2, 2], [-2, 2], [-2, 6], [-5, 6]]

SHAPES: dict[str, dict[str, Any]] = {
    "plane": {"shape": "plane", "point": [0, 0, 2], "normal": [1, 2, -2]},
    "box": {"shape": "box", "center": [1, 0, -1], "size": [8, 6, 10]},
    "box_turned": {
        "shape": "box",
        "center": [1, 0, 0],
        "size": [8, 6, 10],
        "rotation": {"axis": [1, 1, 0], "angle": 30},
    },
    "cavity": {"shape": "box", "center": [0, 0, 0], "size": [16, 12, 10], "inside": True},
    "rounded_box": {"shape": "rounded_box", "center": [1, 0, 0], "size": [8, 6, 10], "edge_radius": 1.5},
    "ball": {"shape": "rounded_box", "center": [0, 1, 0], "size": [6, 6, 6], "edge_radius": 3},
    "pin": {"shape": "cylinder", "center": [1, 0, 0], "axis": [1, 2, 0], "radius": 3, "length": 9, "edge_radius": 0.5},
    "hole": {"shape": "cylinder", "center": [1, 0, 0], "axis": [0, 0, 1], "radius": 7, "inside": True},
    "channel": {"shape": "extrusion", "axis": [1, 0, 0], "first_axis": [0, 1, 0], "profile": U_PROFILE, "length": 10},
    "filleted": {
        "shape": "extrusion",
        "axis": [0, 0, 1],
        "first_axis": [1, 0, 0],
        "profile": U_PROFILE[::-1],
        "corner_radii": 0.6,
    },
    "slot": {
        "shape": "extrusion",
        "axis": [0, 1, 0],
        "first_axis": [1, 0, 0],
        "profile": [[-4, -9], [4, -9], [4, 3], [-4, 3]],
        "corner_radii": [0, 0, 4, 4],
        "length": 12,
        "origin": [0, -6, 0],
        "inside": True,
    },
    "cone": {"shape": "revolution", "axis": [0, 0, 1], "profile": [[0, 0], [5, 0], [3, 4], [0, 4]]},
    "ring": {
        "shape": "revolution",
        "axis": [1, 0, 0],
        "profile": [[3, -1], [6, -1], [6, 1], [3, 1]],
        "corner_radii": 0.4,
    },
    "stadium": {
        "shape": "revolution",
        "axis": [0, 0, 1],
        "profile": [[0, 0], [5, 0], [3, 4], [0, 4]],
        "corner_radii": [0, 1, 1, 0],
        "spine": 6,
        "spine_axis": [0, 1, 0],
    },
}


@pytest.fixture(scope="module")
def tools(make_tools: Callable[..., ToolSet]) -> ToolSet:
    return make_tools(SHAPES)


def box_twin(points: np.ndarray, half: np.ndarray, rounding: float = 0.0) -> np.ndarray:
    q = np.abs(points) - half + rounding
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - rounding


def polygon_twin(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance by all edges, sign by counting crossings (even-odd rule): shares nothing with the kernel."""
    best = np.full(len(points), np.inf)
    inside = np.zeros(len(points), dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
        if a[1] != b[1]:
            over = (points[:, 1] >= a[1]) != (points[:, 1] >= b[1])
            inside ^= over & (points[:, 0] < a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
    return np.where(inside, -best, best)


def swept_twin(flat: np.ndarray, along: np.ndarray) -> np.ndarray:
    both = np.stack([flat, along], axis=1)
    return np.linalg.norm(np.maximum(both, 0), axis=1) + np.minimum(both.max(axis=1), 0)


def test_closed_forms(tools: ToolSet, cloud: np.ndarray) -> None:
    phi = dict(zip(tools.names, tools.distances(cloud)[0], strict=True))
    x, y, z = cloud.T
    expected = {
        "plane": (x + 2 * y - 2 * (z - 2)) / 3,
        "box": box_twin(cloud - [1, 0, -1], np.array([4, 3, 5])),
        "cavity": -box_twin(cloud, np.array([8, 6, 5])),
        "rounded_box": box_twin(cloud - [1, 0, 0], np.array([4, 3, 5]), 1.5),
        "ball": np.linalg.norm(cloud - [0, 1, 0], axis=1) - 3,
        "hole": 7 - np.hypot(x - 1, y),
        "channel": swept_twin(polygon_twin(cloud[:, 1:], np.array(U_PROFILE, float)), np.abs(x - 5) - 5),
        "cone": polygon_twin(
            np.stack([np.hypot(x, y), z], axis=1), np.array([[-5, 0], [5, 0], [3, 4], [-3, 4]], float)
        ),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(phi[name], value, atol=1e-12, err_msg=name)


def test_normals_are_unit_gradients_and_lead_to_the_surface(tools: ToolSet, cloud: np.ndarray) -> None:
    phi, normals = tools.distances(cloud)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-12)
    step = 1e-6
    change = [tools.distances(cloud + e)[0] - tools.distances(cloud - e)[0] for e in step * np.eye(3)]
    gradient = np.stack(change, axis=2) / (2 * step)
    off = np.linalg.norm(gradient - normals, axis=2) > 1e-6
    # Only where two walls are equally near the gradient does not exist.
    assert off.mean() < 1e-3
    for k in range(len(tools)):
        foot = cloud - phi[k][:, None] * normals[k]
        np.testing.assert_allclose(tools.distances(foot)[0][k], 0.0, atol=1e-12)


def test_distances_are_one_lipschitz(tools: ToolSet, cloud: np.ndarray) -> None:
    other = cloud + np.random.default_rng(5).normal(scale=2.0, size=cloud.shape)
    change = np.abs(tools.distances(cloud)[0] - tools.distances(other)[0])
    assert (change <= np.linalg.norm(other - cloud, axis=1) + 1e-12).all()


def test_corners_edges_and_axes_have_defined_normals(tools: ToolSet) -> None:
    points = np.array([[5.0, 3.0, 4.0], [1.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 1.0, 0.0], [5, 0, 0]])
    phi, normals = tools.distances(points)
    assert np.isfinite(phi).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-12)


def test_outside_a_corner_the_normal_points_from_it(make_tools: Callable[..., ToolSet]) -> None:
    box = make_tools({"box": {"shape": "box", "center": [0, 0, 0], "size": [2, 2, 2]}})
    phi, normals = box.distances([[2.0, 3.0, 3.0]])
    assert phi[0, 0] == pytest.approx(3.0)
    np.testing.assert_allclose(normals[0, 0], np.array([1, 2, 2]) / 3)


def test_turning_tool_and_points_together_changes_nothing(
    make_tools: Callable[..., ToolSet], cloud: np.ndarray
) -> None:
    axis, angle = np.array([2.0, -1.0, 2.0]) / 3, 40.0
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(np.radians(angle)) * k + (1 - np.cos(np.radians(angle))) * k @ k
    plain = {
        "a": {"shape": "box", "center": [0, 0, 0], "size": [8, 6, 10]},
        "b": {**SHAPES["channel"], "origin": [0, 0, 0]},
        "c": {**SHAPES["stadium"], "origin": [0, 0, 0]},
        "d": {**SHAPES["pin"], "center": [0, 0, 0]},
    }
    turned = {
        "a": {**plain["a"], "rotation": {"axis": axis.tolist(), "angle": f"{angle} deg"}},
        "b": {**plain["b"], "axis": (turn @ [1, 0, 0]).tolist(), "first_axis": (turn @ [0, 1, 0]).tolist()},
        "c": {**plain["c"], "axis": (turn @ [0, 0, 1]).tolist(), "spine_axis": (turn @ [0, 1, 0]).tolist()},
        "d": {**plain["d"], "axis": (turn @ [1, 2, 0]).tolist()},
    }
    phi, normals = make_tools(plain).distances(cloud)
    phi_turned, normals_turned = make_tools(turned).distances(cloud @ turn.T)
    np.testing.assert_allclose(phi_turned, phi, atol=1e-12)
    np.testing.assert_allclose(normals_turned, normals @ turn.T, atol=1e-9)


def test_bounding_box_never_exceeds_the_distance(tools: ToolSet, cloud: np.ndarray) -> None:
    phi = tools.distances(cloud)[0]
    still = np.zeros((len(tools), 3))
    for k in range(len(tools)):
        for p in range(0, len(cloud), 40):
            assert distance_bound(tools.arrays, k, still, *cloud[p]) <= phi[k, p] + 1e-12


def test_outline_integrals_are_exact() -> None:
    area, moment = outline_integrals(outline_segments([[1, 0], [5, 0], [5, 2], [1, 2]]))
    assert (area, moment) == (pytest.approx(8.0), pytest.approx(24.0))
    # A disc drawn as a square with full fillets, centred at u = 3.
    area, moment = outline_integrals(outline_segments([[2, 0], [4, 0], [4, 2], [2, 2]], 1.0))
    assert area == pytest.approx(np.pi, rel=1e-13)
    assert moment == pytest.approx(3 * np.pi, rel=1e-13)


@pytest.mark.parametrize(
    ("profile", "radii", "message"),
    [
        ([[0, 0], [4, 4], [4, 0], [0, 4]], 0.0, "crosses"),
        ([[0, 0], [4, 0], [8, 0]], 0.0, "no area"),
        ([[0, 0], [4, 0], [4, 4], [0, 0], [0, 4]], 0.0, "same point"),
        ([[0, 0], [4, 0], [4, 4], [0, 4]], 2.5, "smaller corner_radii"),
    ],
)
def test_faulty_outlines(profile: list[list[float]], radii: float, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        outline_segments(profile, radii)
