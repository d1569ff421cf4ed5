"""Bricks for a disk: a bulged square in the middle, a ring of bricks round it."""

from __future__ import annotations

import numpy as np

from ppmc.geometry.parts.meshes.hexahedra import (
    FloatArray,
    HexMesh,
    IntArray,
    divided,
    grid_quads,
    joined,
    swept_bricks,
)

# Half diagonal of the core square over the disk's radius; keeps the corner angles of core and ring alike.
CORE = 0.55


def disk_quads(radius: float, size: float, full_circle: bool = True) -> tuple[FloatArray, IntArray]:
    """Return nodes, shape (k, 2), and quadrilaterals, anticlockwise, of a disk about the origin, or its half y >= 0.

    The rim's polygon has the circle's area.
    """
    n = 2 * max(2, int(np.ceil(np.pi * radius / 4.0 / size)))
    u = np.linspace(-1.0, 1.0, n + 1)
    a, b = np.meshgrid(u, u if full_circle else u[n // 2 :], indexing="xy")
    core = CORE * radius / np.sqrt(2.0)
    bulge = 1.0 + 0.12 * (2.0 - a**2 - b**2) * np.maximum(np.abs(a), np.abs(b))
    nodes = np.stack([(core * a * bulge).ravel(), (core * b * bulge).ravel()], axis=1)
    quads = grid_quads(a.shape[0], a.shape[1])
    side = np.stack([u, -np.ones(n + 1)], axis=1)[:-1]
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    edge = np.concatenate([side @ np.linalg.matrix_power(turn, k).T for k in range(4)])
    angle = np.arctan2(edge[:, 1], edge[:, 0])
    if not full_circle:
        keep = edge[:, 1] >= -1e-12
        # A zero with a minus sign would turn the ray at 180 degrees to -180.
        edge, angle = edge[keep], np.arctan2(np.abs(edge[keep, 1]), edge[keep, 0])
        order = np.argsort(angle)
        edge, angle = edge[order], angle[order]
    grow = 1.0 + 0.12 * (1.0 - np.min(np.abs(edge), axis=1) ** 2)
    inner = core * edge * grow[:, None]
    steps = np.diff(angle, append=angle[0]) if full_circle else np.diff(angle)
    whole = np.pi if full_circle else np.pi / 2.0
    rim = radius * np.sqrt(whole / (0.5 * np.sum(np.sin(steps))))
    outer = rim * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    share = np.linspace(0.0, 1.0, max(2, int(np.ceil(0.5 * radius / size))) + 1)
    ring = (inner[None] + share[:, None, None] * (outer - inner)[None]).reshape(-1, 2)
    ring_quads = grid_quads(len(share), len(edge), closed=full_circle)[:, ::-1]
    return np.concatenate([nodes, ring]), np.concatenate([quads, ring_quads + len(nodes)])


def disk_mesh(radius: float, thickness: float, size: float) -> HexMesh:
    """Return bricks that fill a disk from x3 = 0 to `thickness`."""
    nodes, quads = disk_quads(radius, size)
    heights = divided(0.0, thickness, size=size)
    sections = np.stack([np.column_stack([nodes, np.full(len(nodes), z)]) for z in heights])
    return joined([swept_bricks(sections, quads)])
