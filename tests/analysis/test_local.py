from __future__ import annotations

import numpy as np
import pytest

from ppmc.analysis.averages.averages import in_frames, region_averages
from ppmc.analysis.averages.local import local_frames, localise, material_normals, nearest_normals, turned_to
from ppmc.analysis.averages.paths import swept_path
from ppmc.particles import Particles

RNG = np.random.default_rng(8)


def test_general_form_is_d6_in_the_prismatic_zone() -> None:
    angle = RNG.uniform(0, 2 * np.pi, 200)
    n1, n2, zero = np.cos(angle), np.sin(angle), 0 * angle
    d6 = np.stack(
        [np.column_stack([zero, zero, zero + 1]), np.column_stack([n2, -n1, zero]), np.column_stack([n1, n2, zero])], 1
    )
    assert np.abs(local_frames(np.column_stack([n1, n2, zero]), [0, 0, 1]) - d6).max() < 1e-14


def test_frames_are_right_handed_and_tangential_for_any_normal() -> None:
    n = RNG.normal(size=(500, 3))
    R = local_frames(n, [0.3, -0.2, 1.0])
    assert np.abs(np.einsum("mij,mkj->mik", R, R) - np.eye(3)).max() < 1e-12
    assert np.allclose(np.linalg.det(R), 1)
    assert np.abs(np.einsum("mi,mi->m", R[:, 0], n)).max() < 1e-12
    # The axial row leans to the axial side, and the frame turns with the part.
    assert (R[:, 0] @ np.array([0.3, -0.2, 1.0]) > 0).all()
    Q = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    Q = Q * np.linalg.det(Q)
    assert np.abs(local_frames(n @ Q.T, Q @ [0.3, -0.2, 1.0]) - R @ Q.T).max() < 1e-10


def test_no_axis_stands_out_where_the_normal_is_axial() -> None:
    R = local_frames([[0, 0, 1.0], [np.nan, 0, 0], [0, 1.0, 0]], [0, 0, 1])
    assert np.isnan(R[0, 0]).all() and np.isnan(R[1]).all() and np.isfinite(R[2]).all()


def test_slanted_walls_look_plain_in_local_axes() -> None:
    """A roof of two walls at ±60°, fibres axial with share 0.7, else along the slope: A_aa = 0.7, A_nn = 0 on both."""
    x = RNG.uniform([-10, 0, -50], [10, 1, 50], (40_000, 3))
    side = np.sign(x[:, 0])
    n = np.column_stack([side * np.sin(np.pi / 3), np.full(len(x), np.cos(np.pi / 3)), 0 * side])
    R = local_frames(n, [0, 0, 1])
    p = np.sqrt(0.7) * R[:, 0] + np.sqrt(0.3) * R[:, 1]
    path = swept_path("across", 2, 0, 90, 1, 0, -10, 10, 10)
    s = Particles("roof", x, np.ones(len(x)), p, n)
    a = region_averages(s, path.regions)
    local = localise(path, turned_to(material_normals(a.normal_tensor), [0, 1, 0]), [0, 0, 1], "the material")
    b = in_frames(a, local.frames)
    assert local.components == ("a", "t", "n")
    assert np.allclose(b.fibre_tensor[:, 0, 0], 0.7) and np.allclose(b.fibre_tensor[:, 2, 2], 0, atol=1e-12)
    assert np.allclose(b.normal_tensor[:, 2, 2], 1)
    assert a.fibre_tensor[:, 1, 1].max() > 0.2


def test_empty_regions_have_no_normal() -> None:
    assert np.isnan(turned_to(material_normals(np.full((1, 3, 3), np.nan)), [0, 0, 1])).all()


def test_nearest_tool_gives_the_normal() -> None:
    d = np.array([[1.0, 5.0], [-2.0, 0.5]])
    n = np.array([[[1.0, 0, 0]] * 2, [[0, 1.0, 0]] * 2])
    assert nearest_normals(d, n).tolist() == [[1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("time", [0.0])
def test_normals_from_a_tool_of_the_scene(time: float) -> None:
    from ppmc.analysis.averages.build import tool_normals
    from ppmc.scene import parse_scene

    scene = parse_scene("""
name: plates
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  slope: {shape: plane, point: [20, 0, 0], normal: [-1, 0, 1]}
""")
    n = tool_normals(scene, np.array([[0.0, 0, 0.2], [19.0, 0, 3.0], [np.nan] * 3]), time)
    assert n is not None
    assert np.allclose(n[0], [0, 0, 1])
    assert np.allclose(np.abs(n[1]), np.array([1, 0, 1]) / np.sqrt(2))
    assert np.isnan(n[2]).all()
