"""Resolved reference in two dimensions: first instant of a slip squeeze in plane strain, finite elements.

Biquadratic velocities and discontinuous linear pressures, a stable pair, on cells that follow the faces of platelets;
a cell has one fibre direction. Plates slip, both ends are free. Exact for homogeneous material; the force of plies and
bricks moves by 2 % between its two finest meshes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sl
from scipy.interpolate import RegularGridInterpolator

PER_PLY = 8  # cells through a ply of a millimetre
WIDTH = 0.5  # mm, of a cell along the plates
INCOMPRESSIBLE = 1e-12  # mm^2/(Pa s): makes the pressure's block regular

Directions = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Reference:
    """Resolved flow for a ram that closes at unit rate.

    Attributes
    ----------
    force : float
        Over length, eta23 and rate.
    velocity : RegularGridInterpolator
        v1 and v3 at (x1, x3).
    """

    force: float
    velocity: RegularGridInterpolator


def resolved(directions: Directions, length: float, height: float, ratio: float, per_ply: int = PER_PLY) -> Reference:
    """Solve for the first instant of a block from the origin to (length, height), mm; eta23 = 1 Pa s.

    `directions` gives the fibre direction (..., 3) at x1, x3.
    """
    nx, nz = round(length / WIDTH), round(height * per_ply)
    h = np.array([length / nx, height / nz])
    centres = np.meshgrid((np.arange(nx) + 0.5) * h[0], (np.arange(nz) + 0.5) * h[1], indexing="ij")
    p = directions(*centres).reshape(-1, 3)
    m = p[:, :, None] * p[:, None, :] - np.eye(3) / 3.0
    m = np.stack([m[:, 0, 0], m[:, 2, 2], m[:, 0, 2]], axis=1)  # times D11, D33 and 2 D13
    material = np.array([[4.0, -2.0, 0.0], [-2.0, 4.0, 0.0], [0.0, 0.0, 3.0]]) / 3.0
    material = material + 4.0 * (ratio - 1.0) * m[:, :, None] * m[:, None, :]
    points, weights = np.polynomial.legendre.leggauss(3)
    across = 2 * nz + 1
    cell = np.stack(np.meshgrid(np.arange(nx), np.arange(nz), indexing="ij"), axis=-1).reshape(-1, 2)
    pairs = np.array(list(np.ndindex(3, 3)))
    node = (2 * cell[:, :1] + pairs[:, 0]) * across + 2 * cell[:, 1:] + pairs[:, 1]
    count = (2 * nx + 1) * across
    unknowns = np.concatenate([node, node + count], axis=1)
    stiffness, divergence = np.zeros((len(cell), 18, 18)), np.zeros((3, 18))
    for s, ws in zip(points, weights, strict=True):
        for t, wt in zip(points, weights, strict=True):
            gradient = _gradients(s, t, pairs) * (2.0 / h)
            strain = np.zeros((3, 18))
            strain[0, :9], strain[1, 9:] = gradient[:, 0], gradient[:, 1]
            strain[2, :9], strain[2, 9:] = gradient[:, 1], gradient[:, 0]
            area = h.prod() / 4.0 * ws * wt
            stiffness += area * np.einsum("ai,eab,bj->eij", strain, material, strain, optimize=True)
            divergence -= area * np.outer([1.0, s, t], strain[0] + strain[1])
    rows, columns = np.repeat(unknowns, 18, axis=1), np.tile(unknowns, (1, 18))
    a = sp.csr_matrix((stiffness.ravel(), (rows.ravel(), columns.ravel())), (2 * count, 2 * count))
    pressures = np.arange(3 * len(cell)).reshape(-1, 3)
    values = np.broadcast_to(divergence, (len(cell), 3, 18))
    places = np.repeat(pressures, 18, axis=1).ravel(), np.tile(unknowns, (1, 3)).ravel()
    b = sp.csr_matrix((values.ravel(), places), (3 * len(cell), 2 * count))
    numbers, u = np.arange(count).reshape(2 * nx + 1, across), np.zeros(2 * count)
    fixed = np.concatenate([numbers[:, 0] + count, numbers[:, -1] + count, [numbers[nx, nz]]])
    u[numbers[:, -1] + count] = -height
    free = np.setdiff1d(np.arange(2 * count), fixed)
    system = sp.bmat([[a[free][:, free], b[:, free].T], [b[:, free], -INCOMPRESSIBLE * sp.eye(3 * len(cell))]]).tocsc()
    load = np.concatenate([-(a[free][:, fixed] @ u[fixed]), -(b[:, fixed] @ u[fixed])])
    u[free] = sl.spsolve(system, load)[: len(free)]
    lines = np.linspace(0.0, length, 2 * nx + 1), np.linspace(0.0, height, across)
    field = np.stack([u[:count].reshape(-1, across), u[count:].reshape(-1, across)], axis=-1)
    return Reference(float(u @ (a @ u)) / height / length, RegularGridInterpolator(lines, field))


def _gradients(s: float, t: float, pairs: np.ndarray) -> np.ndarray:
    """Local gradients (9, 2) of the functions of a cell."""
    values = [np.array([c * (c - 1.0) / 2.0, 1.0 - c * c, c * (c + 1.0) / 2.0]) for c in (s, t)]
    slopes = [np.array([c - 0.5, -2.0 * c, c + 0.5]) for c in (s, t)]
    along = slopes[0][pairs[:, 0]] * values[1][pairs[:, 1]]
    return np.stack([along, values[0][pairs[:, 0]] * slopes[1][pairs[:, 1]]], axis=1)
