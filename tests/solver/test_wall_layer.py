"""Half-cells between wall layers and walls that rub, against the full viscosity tensor."""

import numpy as np
import pytest

from ppmc.solver.sph.viscosity import viscosity_tensor
from ppmc.solver.walls.contact import Contacts
from ppmc.solver.walls.wall_layer import layer_drag, sheared

from .blocks import unit_vectors

SHEAR, RATIO, WIDTH, AREA = 0.7, 300.0, 0.4, 1.7
FRACTIONS = np.array([0.3, 0.7])


def faces(normals: np.ndarray) -> Contacts:
    """One face a particle, with the given normals (m, 3)."""
    m = len(normals)
    normal = np.zeros((m, 3, 3))
    normal[:, 0] = normals
    tool = np.full((m, 3), -1, dtype=np.int32)
    tool[:, 0] = 0
    return Contacts(
        np.arange(m), tool, normal, np.full((m, 3), WIDTH), np.zeros((m, 3)), np.zeros((m, 3, 3)), tool >= 0
    )


def drag_of(normals: np.ndarray, directions: np.ndarray, slip: float) -> np.ndarray:
    m = len(normals)
    slips = np.full((m, 3), np.inf)
    slips[:, 0] = slip
    fibre = np.tile(4.0 * SHEAR * (RATIO - 1.0) * FRACTIONS, (m, 1))
    return layer_drag(faces(normals), slips, np.full((m, 3), AREA), np.full(m, SHEAR), fibre, directions)[:, 0]


@pytest.mark.parametrize("slip", [0.0, 1e-4, 0.3, 1e4, np.inf])
def test_half_cell_and_wall_are_in_series(slip):
    m = 20
    normals = unit_vectors(m, 3)[:, 0]
    directions = np.stack([unit_vectors(m, 4)[:, 0], unit_vectors(m, 5)[:, 0]], axis=1)
    found = drag_of(normals, directions, slip)
    for i, n in enumerate(normals):
        tensor = viscosity_tensor(SHEAR, RATIO, directions[i], FRACTIONS)
        along = np.linalg.svd(n[None])[2][1:]  # two directions along the wall
        layer = np.einsum("ai,ijkl,j,bk,l->ab", along, tensor, n, along, n) / WIDTH
        both = np.zeros((2, 2)) if np.isinf(slip) else np.linalg.inv(slip * np.eye(2) + np.linalg.inv(layer))
        expected = AREA * along.T @ both @ along
        np.testing.assert_allclose(found[i], expected, rtol=0, atol=1e-9 * AREA * np.abs(layer).max())


def test_simple_shear_is_what_the_half_cell_sees():
    normals, m = unit_vectors(8, 6)[:, 0], 8
    directions = np.stack([unit_vectors(m, 7)[:, 0], unit_vectors(m, 8)[:, 0]], axis=1)
    across = np.cross(normals, unit_vectors(m, 9)[:, 0])
    gradient = across[:, :, None] * normals[:, None, :]
    # A wall that rubs so little that the material moves on it, which leaves the rest of the sliding to the half-cell.
    drag, slip = drag_of(normals, directions, 0.01), np.full((m, 3), np.inf)
    slip[:, 0] = 0.01
    traction = np.stack([
        np.einsum("ijkl,j,kl->i", viscosity_tensor(SHEAR, RATIO, directions[i], FRACTIONS), normals[i], gradient[i])
        for i in range(m)
    ])  # fmt: skip
    traction -= np.einsum("ma,ma->m", traction, normals)[:, None] * normals
    slide = np.zeros((m, 3, 3))
    slide[:, 0] = WIDTH * across + 0.01 * traction
    np.testing.assert_allclose(np.einsum("mab,mb->ma", drag, slide[:, 0]), AREA * traction, rtol=1e-9, atol=1e-9)
    full = np.zeros((m, 3, 3, 3))
    full[:, 0] = drag
    other = gradient + 5.0 * across[:, :, None] * normals[:, None, :]  # what the centre sees counts along the wall only
    behind, power = sheared(faces(normals), slip, np.full((m, 3), AREA), full, slide, other)
    np.testing.assert_allclose(behind, gradient, atol=1e-9)
    np.testing.assert_allclose(power, AREA * WIDTH * np.einsum("ma,ma->m", traction, across), rtol=1e-9)
