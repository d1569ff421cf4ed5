"""Contacts with tools: faces near particles, constraints, reactions, half-widths."""

import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.walls.contact import (
    Contacts,
    between_wall_layers,
    half_widths,
    kept_half_widths,
    places,
    starting_half_widths,
)
from ppmc.solver.walls.tools import AT_ONCE, faces_near


def one_particle(normals, gaps, velocities=None) -> Contacts:
    m = len(normals)
    shape = (1, 3)
    contacts = Contacts(
        rows=np.zeros(1, np.int64), tool=np.full(shape, -1, np.int32), normal=np.zeros((1, 3, 3)),
        half_width=np.zeros(shape), gap=np.full(shape, np.inf), wall_velocity=np.zeros((1, 3, 3)),
        active=np.zeros(shape, bool),
    )  # fmt: skip
    contacts.tool[0, :m] = np.arange(m)
    contacts.normal[0, :m] = normals
    contacts.gap[0, :m] = gaps
    contacts.active[0, :m] = True
    contacts.half_width[0, :m] = 0.5
    if velocities is not None:
        contacts.wall_velocity[0, :m] = velocities
    return contacts


def test_constraints_of_oblique_walls_are_all_met():
    rng = np.random.default_rng(2)
    for m in (1, 2, 3):
        normals = rng.normal(size=(m, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        wall, gaps = rng.normal(size=(m, 3)), rng.normal(size=m)
        contacts = one_particle(normals, gaps, wall)
        free, held = contacts.constrain(0.1)
        v = free[0] @ rng.normal(size=3) + held[0]
        np.testing.assert_allclose(normals @ v, np.einsum("ka,ka->k", normals, wall) - gaps / 0.1, atol=1e-9)
        np.testing.assert_allclose(free[0] @ free[0], free[0], atol=1e-12)
        assert np.trace(free[0]) == pytest.approx(3 - m)
        # Reactions add up to the constrained part of a force.
        force = rng.normal(size=3)
        pressing, forces = contacts.reactions(((np.eye(3) - free[0]) @ force)[None])
        np.testing.assert_allclose(forces[0].sum(axis=0), (np.eye(3) - free[0]) @ force, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(forces[0, :m], axis=1), np.abs(pressing[0, :m]))


def test_half_widths_follow_the_lattice():
    start, now = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]), np.tile([4.0, 1.0, 0.25, 0.0, 0.0, 0.0], (3, 1))
    # 2.0 is cut at 1.5.
    np.testing.assert_allclose(half_widths(np.full(3, 0.5), now, start, np.eye(3)), [0.75, 0.5, 0.25])
    np.testing.assert_allclose(half_widths(np.full(3, 0.5), now, now[0], np.eye(3)), 0.5)


def test_touching_particles_keep_their_distance_and_return_with_strain():
    ideal, distance, growth = np.full((2, 1), 0.5), np.array([[0.4], [np.inf]]), np.full((2, 1), 0.9)
    np.testing.assert_allclose(kept_half_widths(ideal, distance, growth, np.zeros(2))[0], 0.36)
    np.testing.assert_allclose(kept_half_widths(ideal, distance, growth, np.full(2, 10.0)), 0.5)


def test_wall_layers_resist_with_half_a_cell_a_face():
    contacts = one_particle([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], [0.0, 0.1])
    assert contacts.layers().tolist() == [2]
    contacts.active[:] = False
    contacts.gap[0, :2] = [0.1, 0.2]
    assert contacts.layers().tolist() == [1]
    np.testing.assert_allclose(between_wall_layers(np.array([0, 1, 2])), [1.0, 0.5, 0.25], atol=0.04)


def test_starting_half_widths():
    # A scattered layer on the tool keeps its own distances, a layer with clearance does not.
    on = np.array([0.4, 0.5, 0.6, 1.5, 2.4])
    np.testing.assert_allclose(starting_half_widths(on, 1.0), [0.4, 0.5, 0.6, 0.5, 0.5])
    clear = np.array([0.70, 0.71, 0.72, 1.7])
    np.testing.assert_allclose(starting_half_widths(clear, 1.0), 0.5)


def test_faces_near_are_those_of_all_particles():
    points = np.random.default_rng(5).uniform(0.0, 12.0, (2 * AT_ONCE + 77, 3))
    tools = compile_tools({"floor": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1)),
                           "wall": PlaneTool(shape="plane", point=(0, 0, 0), normal=(1, 0, 0))})  # fmt: skip
    rows, tool, distance, normal = faces_near(tools.arrays, tools.offsets(0.0), points, 1.5)
    np.testing.assert_array_equal(rows, np.flatnonzero((points[:, 0] < 1.5) | (points[:, 2] < 1.5)))
    np.testing.assert_allclose(distance[:, 0], np.minimum(points[rows, 0], points[rows, 2]))
    both = (points[rows, 0] < 1.5) & (points[rows, 2] < 1.5)
    np.testing.assert_array_equal(np.isfinite(distance[:, 1]), both)
    np.testing.assert_array_equal(tool[:, 0], np.where(points[rows, 0] < points[rows, 2], 1, 0))
    np.testing.assert_allclose(normal[:, 0, 0], tool[:, 0])
    nowhere = faces_near(tools.arrays, tools.offsets(0.0), points + 5.0, 1.5)
    assert [part.shape for part in nowhere] == [(0,), (0, 3), (0, 3), (0, 3, 3)]


def test_places_of_rows():
    assert places(np.array([1, 4]), 6).tolist() == [-1, 0, -1, -1, 1, -1]
