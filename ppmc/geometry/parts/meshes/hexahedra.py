"""Meshes of eight-node bricks for structural analysis, and the closed surface round them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.geometry.surfaces.surface import ClosedSurface, closed_surface

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Faces of a brick in VTK's and Abaqus' node order, anticlockwise from outside.
FACES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])


@dataclass(frozen=True)
class HexMesh:
    """Bricks.

    Attributes
    ----------
    points : ndarray, shape (nodes, 3)
        Nodes, mm.
    bricks : ndarray of int64, shape (bricks, 8)
        Node numbers: bottom face, then top face (C3D8, VTK_HEXAHEDRON).
    """

    points: FloatArray
    bricks: IntArray

    def volumes(self) -> FloatArray:
        """Return the volume of each brick, shape (bricks,), mm^3, by 2 x 2 x 2 Gauss points (exact for bricks)."""
        g = 0.5 / np.sqrt(3.0)
        corners = self.points[self.bricks]
        signs = np.array(
            [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
        )
        total = np.zeros(len(self.bricks))
        for s in signs * 2.0 * g:
            near = 1.0 + signs * s
            slopes = (
                np.stack([signs[:, a] * near[:, (a + 1) % 3] * near[:, (a + 2) % 3] for a in range(3)], axis=1) / 8.0
            )
            total += np.linalg.det(np.einsum("ka,eki->eai", slopes, corners))
        return total

    def centres(self) -> FloatArray:
        """Return the middle of each brick, shape (bricks, 3), mm."""
        return np.asarray(self.points[self.bricks].mean(axis=1))

    def surface(self) -> ClosedSurface:
        """Return the outer surface as triangles."""
        faces = self.bricks[:, FACES].reshape(-1, 4)
        _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        outer = faces[first[counts == 1]]
        triangles = np.concatenate([outer[:, [0, 1, 2]], outer[:, [0, 2, 3]]])
        return closed_surface(self.points, triangles, name="cavity", check_crossing=False, check_size=False)

    def write(self, path: str | Path, ending: str | None = None) -> None:
        """Write the mesh with meshio, such as VTU or Abaqus .inp (C3D8), chosen by `ending` or that of the path."""
        import meshio

        formats = meshio.extension_to_filetypes[(ending or Path(path).suffix).lower()]
        meshio.Mesh(self.points, [("hexahedron", self.bricks)]).write(Path(path), file_format=formats[0])


def swept_bricks(sections: FloatArray, quads: IntArray) -> HexMesh:
    """Return the bricks between successive copies of a quadrilateral mesh.

    Parameters
    ----------
    sections : ndarray, shape (m, k, 3)
        Nodes of each of the m sections, mm.
    quads : ndarray, shape (q, 4)
        Quadrilaterals of a section, anticlockwise seen against the sweep.
    """
    m, k = sections.shape[:2]
    layers = np.arange(m - 1)[:, None, None] * k
    bricks = np.concatenate([quads[None] + layers, quads[None] + layers + k], axis=2).reshape(-1, 8)
    return HexMesh(sections.reshape(-1, 3), bricks)


def joined(meshes: Sequence[HexMesh], tolerance: float = 1e-6) -> HexMesh:
    """Return one mesh, nodes closer than `tolerance` (mm) in every coordinate merged."""
    offsets = np.cumsum([0] + [len(m.points) for m in meshes[:-1]])
    points = np.concatenate([m.points for m in meshes])
    bricks = np.concatenate([m.bricks + o for m, o in zip(meshes, offsets, strict=True)])
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    first = np.arange(len(points))
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    # Pairs join nodes of two meshes, never chains, so the lower number of each pair is enough.
    np.minimum.at(first, pairs.max(axis=1), pairs.min(axis=1)) if len(pairs) else None
    used, renumbered = np.unique(first[bricks], return_inverse=True)
    return HexMesh(points[used], renumbered.reshape(-1, 8).astype(np.int64))


def grid_quads(n: int, m: int, closed: bool = False) -> IntArray:
    """Return the quadrilaterals of a grid of n x m nodes, the second index running fastest.

    With `closed` the last column is joined to the first, as round a ring.
    """
    columns = m if closed else m - 1
    i, j = np.meshgrid(np.arange(n - 1), np.arange(columns), indexing="ij")
    right = (j + 1) % m
    return np.stack([i * m + j, i * m + right, (i + 1) * m + right, (i + 1) * m + j], axis=-1).reshape(-1, 4)


def divided(*breaks: float, size: float) -> FloatArray:
    """Return coordinates from the first to the last break, each break among them, no step longer than `size`."""
    pieces = [
        np.linspace(a, b, max(1, int(np.ceil((b - a) / size - 1e-9))) + 1)[:-1] for a, b in pairwise(breaks) if b > a
    ]
    return np.append(np.concatenate(pieces), breaks[-1])
