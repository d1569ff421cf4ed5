"""Mesh tools against exact distances, pyvista's and brute force."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import pytest
import pyvista

from ppmc.errors import InputFileError
from ppmc.geometry.surfaces.surface import ClosedSurface, closed_surface
from ppmc.geometry.surfaces.triangles import mesh_distances
from ppmc.geometry.tools.contacts import find_contacts
from ppmc.geometry.tools.distance_grid import distance_grid
from ppmc.geometry.tools.toolset import ToolSet

RING, TUBE = 10.0, 4.0


def surface_of(mesh: pyvista.PolyData) -> ClosedSurface:
    mesh = mesh.triangulate().clean()
    return closed_surface(mesh.points, mesh.faces.reshape(-1, 4)[:, 1:])


@pytest.fixture(scope="module")
def torus_mesh() -> pyvista.PolyData:
    mesh = pyvista.ParametricTorus(ringradius=RING, crosssectionradius=TUBE, u_res=97, v_res=49, w_res=5)
    mesh = mesh.triangulate().clean()
    return mesh.compute_normals(auto_orient_normals=True, split_vertices=False)


@pytest.fixture(scope="module")
def torus(torus_mesh: pyvista.PolyData) -> ClosedSurface:
    return surface_of(torus_mesh)


def torus_distance(p: np.ndarray) -> np.ndarray:
    return np.hypot(np.hypot(p[..., 0], p[..., 1]) - RING, p[..., 2]) - TUBE


def nodes(grid: object) -> np.ndarray:
    k, j, i = np.indices(grid.values.shape)
    return np.stack([i, j, k], axis=-1) * grid.spacing + grid.origin


def test_torus_grid(torus: ClosedSurface) -> None:
    grid = distance_grid(torus, 0.4)
    exact = torus_distance(nodes(grid))
    error = np.abs(grid.values - exact)
    facet = TUBE * (1 - np.cos(np.pi / 48)) + (RING + TUBE) * (1 - np.cos(np.pi / 96))
    assert error[np.abs(exact) < 2.5 * 0.4].max() <= facet + 1e-6
    # Beyond the band the nearest triangle is taken over from neighbours.
    assert error.max() <= facet + 0.2 * 0.4
    assert ((grid.values > 0) == (exact > 0))[np.abs(exact) > facet].all()


def test_against_pyvista_and_brute_force(torus: ClosedSurface, torus_mesh: pyvista.PolyData) -> None:
    grid = distance_grid(torus, 0.8)
    place = nodes(grid).reshape(-1, 3)
    value = grid.values.reshape(-1)
    chosen = np.flatnonzero(np.abs(value) < 2.0)[::37]
    np.testing.assert_allclose(
        np.abs(value[chosen]), mesh_distances(torus.points, torus.triangles, place[chosen]), rtol=1e-6
    )
    oracle = pyvista.PolyData(place[chosen]).compute_implicit_distance(torus_mesh)["implicit_distance"]
    clear = np.abs(oracle) > 1e-4
    np.testing.assert_allclose(value[chosen][clear], oracle[clear], atol=1e-5)


def test_points_inside_the_torus(torus: ClosedSurface) -> None:
    points = np.random.default_rng(0).uniform([-15, -15, -5], [15, 15, 5], (20000, 3))
    exact = torus_distance(points)
    clear = np.abs(exact) > 0.05
    np.testing.assert_array_equal(torus.contains(points)[clear], exact[clear] < 0)


def test_mesh_tool_is_the_primitive_it_was_made_of(make_tools: Callable[..., ToolSet], tmp_path: Path) -> None:
    pyvista.Box(bounds=(-4, 4, -3, 3, -5, 5)).triangulate().save(tmp_path / "box.stl")
    place = {"rotation": {"axis": [1, 1, 0], "angle": 30}}
    spacing = 0.25
    mesh = {"shape": "mesh", "file": str(tmp_path / "box.stl"), "origin": [1, 0, 2], "grid_spacing": spacing, **place}
    tools = make_tools(
        {
            "mesh": mesh,
            "box": {"shape": "box", "center": [1, 0, 2], "size": [8, 6, 10], **place},
            "inside out": {**mesh, "inside": True},
        }
    )
    points = np.random.default_rng(2).uniform(-12, 12, (20000, 3))
    phi, normals = tools.distances(points)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-9)
    near = np.abs(phi[1]) < 2 * spacing
    assert np.abs(phi[0] - phi[1])[near].max() < 0.3 * spacing
    assert np.median(np.abs(phi[0] - phi[1])[near]) < 1e-6
    flat = near & (np.sort(np.abs(normals[1] @ np.eye(3)), axis=1)[:, 2] <= 1.0)
    assert np.median(np.einsum("nc,nc->n", normals[0], normals[1])[flat]) > 1 - 1e-6
    # Far outside the grid its distance is a lower bound, never the wrong sign.
    far = phi[1] > 3.0
    assert (phi[0][far] > 0).all()
    assert (phi[0][far] <= phi[1][far] + 0.5 * spacing).all()
    np.testing.assert_array_equal(phi[2], -phi[0])
    np.testing.assert_array_equal(normals[2], -normals[0])


def test_walls_of_a_concave_mesh(make_tools: Callable[..., ToolSet], tmp_path: Path) -> None:
    pyvista.Box(bounds=(0, 10, 0, 8, 0, 6)).triangulate().save(tmp_path / "cavity.stl")
    tools = make_tools(
        {"m": {"shape": "mesh", "file": str(tmp_path / "cavity.stl"), "grid_spacing": 0.25, "inside": True}}
    )
    points = np.array([[5, 4, 3], [0.6, 4, 3], [0.6, 0.8, 3], [0.6, 0.8, 0.9], [0.7, 0.7, 3]])
    count, _, phi, normal = find_contacts(tools.arrays, tools.offsets(0.0), points, 1.5)
    assert count.tolist() == [0, 1, 2, 3, 2]
    np.testing.assert_allclose(phi[3, :3], [0.6, 0.8, 0.9], atol=0.02)
    np.testing.assert_allclose(normal[3, :3], np.eye(3), atol=1e-5)


def test_edge_seen_across_the_cavity_is_no_wall(make_tools: Callable[..., ToolSet], tmp_path: Path) -> None:
    # A floor and, above it to the right, a hanging block: one outline swept, saved as a mesh.
    outline = np.array([[0, -3], [14, -3], [14, 8], [6, 8], [6, 2.4], [11, 2.4], [11, 0], [0, 0]], dtype=float)
    polygon = pyvista.PolyData(np.c_[outline, np.zeros(len(outline))], faces=[len(outline), *range(len(outline))])
    solid = polygon.triangulate().extrude((0, 0, 10), capping=True).triangulate().clean()
    solid = solid.compute_normals(auto_orient_normals=True, split_vertices=False)
    solid.save(tmp_path / "mould.stl")
    tools = make_tools({"m": {"shape": "mesh", "file": str(tmp_path / "mould.stl"), "grid_spacing": 0.2}})
    count, _, phi, normal = find_contacts(tools.arrays, tools.offsets(0.0), np.array([[4.9, 0.5, 5.0]]), 2.0)
    assert count[0] == 1
    assert phi[0, 0] == pytest.approx(0.5, abs=1e-3)
    np.testing.assert_allclose(normal[0, 0], [0, 1, 0], atol=1e-3)


def test_points_that_are_no_numbers_or_far_away(make_tools: Callable[..., ToolSet], tmp_path: Path) -> None:
    pyvista.Box(bounds=(0, 10, 0, 8, 0, 6)).triangulate().save(tmp_path / "box.stl")
    tools = make_tools({"m": {"shape": "mesh", "file": str(tmp_path / "box.stl"), "grid_spacing": 0.5}})
    phi, _ = tools.distances([[np.nan, 0, 0], [1e9, 0, 0], [-1e300, 0, 0]])
    assert np.isnan(phi[0, 0])
    assert (phi[0, 1:] > 9e8).all()


def test_grid_does_not_depend_on_the_threads(torus: ClosedSurface) -> None:
    before = numba.get_num_threads()
    grids = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        grids.append(distance_grid(torus, 0.6).values)
    numba.set_num_threads(before)
    np.testing.assert_array_equal(*grids)


def test_too_fine_a_grid_is_refused(torus: ClosedSurface) -> None:
    with pytest.raises(InputFileError, match="set grid_spacing"):
        distance_grid(torus, 0.01)
