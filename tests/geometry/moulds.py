"""Closed surfaces of simple moulds, written to STL: solids of boxes, and polygons turned about an axis."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import meshio
import numpy as np

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def solid_of_boxes(add: list[Box], cut: list[Box] = []) -> tuple[np.ndarray, np.ndarray]:  # noqa: B006 - not changed
    """Return vertices and triangles of the union of boxes less those that are cut."""
    edges = [np.unique([b[a][e] for b in add + cut for e in (0, 1)]) for a in range(3)]
    middles = np.meshgrid(*[0.5 * (e[1:] + e[:-1]) for e in edges], indexing="ij")

    def within(boxes: list[Box]) -> np.ndarray:
        inside = [np.all([(b[a][0] < middles[a]) & (middles[a] < b[a][1]) for a in range(3)], axis=0) for b in boxes]
        return np.any(inside, axis=0) if inside else np.zeros(middles[0].shape, dtype=bool)

    filled = np.pad(within(add) & ~within(cut), 1)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        here, next_ = np.moveaxis(filled, axis, 0)[:-1], np.moveaxis(filled, axis, 0)[1:]
        for at in np.argwhere(here != next_):
            outward = bool(here[tuple(at)])
            cell = np.insert(at[1:], axis, at[0])
            corner = np.empty((4, 3))
            for n, (a, b) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                corner[n, axis] = edges[axis][cell[axis]]
                corner[n, u] = edges[u][cell[u] - 1 + a]
                corner[n, v] = edges[v][cell[v] - 1 + b]
            order = (0, 1, 2, 0, 2, 3) if outward else (0, 2, 1, 0, 3, 2)
            triangles += [corner[order[:3], :], corner[order[3:], :]]
    points = np.concatenate(triangles)
    return points, np.arange(len(points)).reshape(-1, 3)


def turned(profile: list[tuple[float, float]], sides: int = 96) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a polygon (r, z), anticlockwise, from axis to axis, turned about z."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), np.full(sides, z)], axis=1) for r, z in profile]
    triangles = []
    for low, high in pairwise(rings):
        for n in range(sides):
            a, b, c, d = low[n], low[(n + 1) % sides], high[(n + 1) % sides], high[n]
            triangles += [t for t in ((a, b, c), (a, c, d)) if len({tuple(p) for p in t}) == 3]
    points = np.array(triangles).reshape(-1, 3)
    return points, np.arange(len(points)).reshape(-1, 3)


def write_stl(path: Path, mesh: tuple[np.ndarray, np.ndarray], rotation: np.ndarray | None = None, scale: float = 1.0):
    """Write a surface, turned and scaled, to a binary STL file and return its name."""
    points, triangles = mesh
    points = scale * (points if rotation is None else points @ rotation.T)
    meshio.write(path, meshio.Mesh(points, [("triangle", triangles)]), binary=True)
    return str(path)
