"""Bricks for the double dome: a flat stadium of quadrilaterals, laid over the section by arc length."""

from __future__ import annotations

import numpy as np

from ppmc.geometry.parts.double_dome import DoubleDome
from ppmc.geometry.parts.meshes.disk import disk_quads
from ppmc.geometry.parts.meshes.hexahedra import (
    FloatArray,
    HexMesh,
    IntArray,
    divided,
    grid_quads,
    joined,
    swept_bricks,
)
from ppmc.geometry.parts.profile import Profile


def dome_mesh(part: DoubleDome, size: float) -> HexMesh:
    """Return the mesh of the closed part.

    Parameters
    ----------
    part : DoubleDome
        Dimensions.
    size : float
        Wanted edge length, mm; the thickness is divided evenly.
    """
    middle = Profile.of(part, part.thickness / 2.0)
    heights = divided(-part.thickness / 2.0, part.thickness / 2.0, size=size)
    blocks = []
    for flat, quads, along in _stadium(part, middle.length, size):
        distance = np.hypot(flat[:, 0], flat[:, 1])
        outwards = np.where(distance[:, None] > 1e-9, flat / np.maximum(distance, 1e-9)[:, None], [1.0, 0.0])
        points, normals = middle.at(distance)
        sections = np.empty((len(heights), len(flat), 3))
        for k, w in enumerate(heights):
            rho, height = (points + w * normals).T
            sections[k] = np.column_stack([rho * outwards[:, 0], height, along + rho * outwards[:, 1]])
        # x1, x3, x2 is left-handed: turn the quadrilaterals round.
        blocks.append(swept_bricks(sections, quads[:, ::-1]))
    return joined(blocks)


def _stadium(part: DoubleDome, radius: float, size: float) -> list[tuple[FloatArray, IntArray, FloatArray]]:
    """Return nodes (across, outwards along x3) of both round ends and the straight part, quads, and spine positions."""
    nodes, quads = disk_quads(radius, size, full_circle=False)
    half = part.spine / 2.0
    ends = [
        (nodes, quads, np.full(len(nodes), half)),
        (nodes * [1.0, -1.0], quads[:, ::-1], np.full(len(nodes), -half)),
    ]
    across = np.unique(np.round(nodes[np.abs(nodes[:, 1]) < 1e-9, 0], 9))
    along = divided(-half, half, size=size)
    x, z = np.meshgrid(across, along, indexing="xy")
    straight = np.stack([x.ravel(), np.zeros(x.size)], axis=1)
    return [*ends, (straight, grid_quads(len(along), len(across)), z.ravel())]
