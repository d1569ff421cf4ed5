"""Closed triangle surfaces from STL, OBJ, PLY and VTU files: read, checked, asked what lies inside."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.geometry.points import as_points
from ppmc.geometry.surfaces.checks import check_closed, check_vertices, doubtful_scale
from ppmc.geometry.surfaces.crossings import Columns, points_in_mesh, sort_into_columns
from ppmc.geometry.surfaces.formats import read_triangles
from ppmc.notices import notice

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MILLIMETRES = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 1e-3, "inch": 25.4}


@dataclass(frozen=True)
class ClosedSurface:
    """A closed, outward-oriented triangle surface.

    Attributes
    ----------
    points : ndarray, shape (vertices, 3)
        Vertices, mm.
    triangles : ndarray of int64, shape (triangles, 3)
        Vertex numbers, anticlockwise seen from outside.
    name : str
        What to call it in messages.
    """

    points: FloatArray
    triangles: IntArray
    name: str = "surface"

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest coordinates, mm."""
        return self.points.min(axis=0), self.points.max(axis=0)

    @cached_property
    def volume(self) -> float:
        """Enclosed volume, mm^3 (sum of signed tetrahedra, exact for the triangles)."""
        return mesh_volume(self.points, self.triangles)

    @cached_property
    def area(self) -> float:
        """Surface area, mm^2."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    @cached_property
    def columns(self) -> Columns:
        """Triangles sorted for vertical lines."""
        return sort_into_columns(self.points, self.triangles)

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return for each point, shape (n, 3), whether it lies inside."""
        return np.asarray(points_in_mesh(self.columns, as_points(points)))


def points_inside(surface: ClosedSurface, points: ArrayLike) -> NDArray[np.bool_]:
    """Return for each point, shape (n, 3), whether it lies inside the closed surface."""
    return surface.contains(points)


def mesh_volume(points: FloatArray, triangles: IntArray) -> float:
    """Return the signed volume that triangles enclose, mm^3; taken about their middle against round-off."""
    middle = points - points.mean(axis=0)
    a, b, c = (middle[triangles[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def closed_surface(
    points: ArrayLike,
    triangles: ArrayLike,
    *,
    name: str = "surface",
    check_size: bool = True,
    check_crossing: bool = True,
) -> ClosedSurface:
    """Return a checked closed surface from vertices and triangles.

    Parameters
    ----------
    points : array_like, shape (vertices, 3)
        Vertices, mm; repeated ones are merged.
    triangles : array_like, shape (triangles, 3)
        Vertex numbers.
    name : str
        What to call it in messages, usually the file.
    check_size : bool
        Tell a size that speaks for another unit than mm.
    check_crossing : bool
        Look for triangles that cross each other.

    Raises
    ------
    InputFileError
        If there are no triangles, a vertex is not finite, or the surface is open, not manifold, inconsistently
        oriented, inside out, without volume, or crosses itself.
    """
    vertices = np.array(points, dtype=float).reshape(-1, 3)
    faces = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    check_vertices(vertices, faces, name)
    vertices, faces = merge_vertices(vertices, faces)
    check_closed(vertices, faces, name, crossing=check_crossing)
    doubt = doubtful_scale(vertices, name) if check_size else None
    if doubt is not None:
        notice(doubt)
    return ClosedSurface(vertices, faces, name)


def merge_vertices(points: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the mesh with equal vertices merged, triangles collapsed by that and unused vertices dropped.

    STL files repeat each vertex for each triangle. Should exact equality leave open edges, vertices closer than
    1e-6 of the size are merged too, since writers round.
    """
    unique, index = np.unique(points, axis=0, return_inverse=True)
    faces = _without_collapsed(index.reshape(-1)[triangles])
    if _open_edges(faces) > 0:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        pairs = cKDTree(unique).query_pairs(1e-6 * float(np.ptp(unique, axis=0).max()), output_type="ndarray")
        if len(pairs):
            links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(unique), len(unique)))
            count, group = connected_components(links, directed=False)
            first = np.full(count, len(unique))
            np.minimum.at(first, group, np.arange(len(unique)))
            merged = _without_collapsed(group[faces])
            if _open_edges(merged) < _open_edges(faces):
                unique, faces = unique[first], merged
    used, renumbered = np.unique(faces, return_inverse=True)
    return unique[used], renumbered.reshape(-1, 3).astype(np.int64)


def _without_collapsed(triangles: IntArray) -> IntArray:
    """Return the triangles that have three different vertices."""
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def _open_edges(triangles: IntArray) -> int:
    """Return how many edges belong to one triangle only."""
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    if len(edges) == 0:
        return 0
    key = edges[:, 0] * (int(edges.max()) + 1) + edges[:, 1]
    return int(np.sum(np.unique(key, return_counts=True)[1] == 1))


def read_surface(path: str | Path, *, unit: str | None = None, scale: float = 1.0) -> ClosedSurface:
    """Read a closed surface.

    Parameters
    ----------
    path : str or Path
        STL (text or binary), OBJ, PLY or VTU file of triangles or quadrilaterals.
    unit : {"mm", "m", "cm", "um", "inch"}, optional
        Unit of the file's coordinates. Without it mm is taken, and a size that speaks for another unit is told.
    scale : float
        Further factor on the coordinates.

    Returns
    -------
    ClosedSurface
        In mm, checked.

    Raises
    ------
    InputFileError
        If the file is missing, damaged, or not a closed surface; see `closed_surface`.
    """
    path = Path(path)
    points, triangles = read_triangles(path)
    factor = MILLIMETRES[unit or "mm"] * scale
    return closed_surface(points * factor, triangles, name=str(path), check_size=unit is None)
