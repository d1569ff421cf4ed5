"""Bricks for the pin bracket: a block for the base, a ring of bricks round each hole, nodes shared where they meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.geometry.parts.meshes.hexahedra import HexMesh, divided, grid_quads, joined, swept_bricks
from ppmc.geometry.parts.pin_bracket import PinBracket

FloatArray = NDArray[np.float64]


def bracket_mesh(part: PinBracket, size: float) -> HexMesh:
    """Return the mesh of the closed bracket, base from x3 = charge_height - base_height to charge_height.

    Parameters
    ----------
    part : PinBracket
        Dimensions.
    size : float
        Wanted edge length, mm.
    """
    outline = flange_outline(part, size)
    bottom = np.sort(outline[np.abs(outline[:, 1]) < 1e-9, 0])
    starts = part.flange_starts
    breaks = sorted({0.0, part.length, *starts, *(s + part.flange_thickness for s in starts)})
    x1 = divided(*breaks, size=size)
    z = part.charge_height
    heights = divided(z - part.base_height, z, size=size)
    y, h = np.meshgrid(bottom, heights, indexing="xy")
    section = np.stack([np.zeros(y.size), y.ravel(), h.ravel()], axis=1)
    blocks = [_swept_along_x1(section, x1, grid_quads(len(heights), len(bottom)))]
    ring = np.array([part.width / 2.0, part.hole_height])
    inner = outline - ring
    inner /= np.linalg.norm(inner, axis=1, keepdims=True)
    angles = np.arctan2(inner[:, 1], inner[:, 0])
    polygon = 0.5 * np.sum(np.sin(np.diff(angles, append=angles[0])))
    inner *= part.hole_diameter / 2.0 * np.sqrt(np.pi / polygon)
    gap = np.linalg.norm(outline - ring - inner, axis=1).min()
    steps = np.linspace(0.0, 1.0, max(2, int(np.ceil(gap / size))) + 1)
    rings = ring + inner[None] + steps[:, None, None] * (outline - ring - inner)[None]
    flat = rings.reshape(-1, 2) + np.array([0.0, z])
    section = np.column_stack([np.zeros(len(flat)), flat])
    quads = grid_quads(len(steps), len(outline), closed=True)[:, ::-1]
    for start in starts:
        blocks.append(
            _swept_along_x1(section, x1[(x1 >= start - 1e-9) & (x1 <= start + part.flange_thickness + 1e-9)], quads)
        )
    return joined(blocks)


def flange_outline(part: PinBracket, size: float) -> FloatArray:
    """Return the flange's outline (x2, height above the base), anticlockwise from the lower left corner.

    The half circle is drawn a little outside itself, so that the polygon has its area.
    """
    w, hole, top = part.width, part.hole_height, part.flange_height
    bottom = [(x, 0.0) for x in divided(0.0, w, size=size)[:-1]]
    right = [(w, y) for y in divided(0.0, hole, size=size)[:-1]]
    if part.top == "square":
        right = [(w, y) for y in divided(0.0, hole, top, size=size)[:-1]]
        over = [(w - x, top) for x in divided(0.0, w, size=size)[:-1]]
        left = [(0.0, top - y) for y in divided(0.0, top - hole, top, size=size)[:-1]]
        return np.array(bottom + right + over + left)
    n = max(8, int(np.ceil(np.pi * w / 2.0 / size)))
    step = np.pi / n
    radius = w / 2.0 * np.sqrt(step / np.sin(step))
    angles = np.arange(n + 1) * step
    arc = [(w / 2.0 + radius * np.cos(a), hole + radius * np.sin(a)) for a in angles]
    left = [(0.0, hole - y) for y in divided(0.0, hole, size=size)[1:-1]]
    arc[0], arc[-1] = (w, hole), (0.0, hole)
    return np.array(bottom + right + arc + left)


def _swept_along_x1(section: FloatArray, x1: FloatArray, quads: NDArray[np.int64]) -> HexMesh:
    """Return the bricks of a section of constant shape, swept through the given x1."""
    sections = np.repeat(section[None], len(x1), axis=0)
    sections[:, :, 0] = x1[:, None]
    return swept_bricks(sections, quads)
