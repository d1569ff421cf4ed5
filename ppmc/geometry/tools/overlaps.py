"""Tools that overlap where the charge can get to: at the edge of a cavity, and in the walls right behind it.

Two signed distances whose sum is negative prove an overlap at least that deep, whatever the shapes, for a ball about
the point that lies in the one tool reaches into the other. Idealised tools overlap on purpose (a plane runs through
side walls, a block reaches into a frame), and there only faces that close on one another count; a body read from a
file is meant as it is drawn, and counts wherever a tool that slides along it cuts into it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit, prange
from ppmc.geometry.surfaces.surface import ClosedSurface
from ppmc.geometry.surfaces.triangles import triangle_distance_squared
from ppmc.geometry.tools.checks import ALONG, OPPOSED
from ppmc.geometry.tools.distance import signed_distances
from ppmc.geometry.tools.packed import MESH, PLANE
from ppmc.geometry.tools.toolset import ToolSet

FloatArray = NDArray[np.float64]

# Depth in spacings that is let pass: round walls are faceted, files rounded, and no particle notices.
TOLERANCE = 0.05
MOST_PLACES = 8000
# Places looked at, in spacings from the rim of what a ball of half a spacing reaches: on the walls and behind them.
DISTANCES = (0.5, 1.0, 1.5)
NEAR = 3.0
VERIFIED = 128  # candidates of a pair that are measured against the triangles themselves


@dataclass(frozen=True)
class Overlap:
    """Two tools that take the same place.

    Attributes
    ----------
    first, second : str
        Names of the tools.
    depth : float
        How far they overlap at least, mm.
    point : ndarray, shape (3,)
        Where, mm.
    apart : bool
        Whether they move against one another; if not, one may be set into the other.
    closing : bool
        Whether the motion itself drives the one into the other; if not, they slide along one another.
    """

    first: str
    second: str
    depth: float
    point: FloatArray
    apart: bool
    closing: bool


def overlaps(tools: ToolSet, rim: FloatArray, spacing: float, offsets: FloatArray, ways: FloatArray) -> list[Overlap]:
    """Return the overlaps of tools near a cavity, at most one a pair, the deepest.

    Parameters
    ----------
    tools : ToolSet
    rim : ndarray, shape (n, 3)
        Places at the edge of the cavity, mm; see :class:`ppmc.geometry.cavity.cavity.Cavity`.
    spacing : float
        Particle spacing, mm.
    offsets : ndarray, shape (tools, 3)
        Displacements of the tools at that time, mm.
    ways : ndarray, shape (tools, 3)
        Displacements over the whole motion, mm: which tools move against one another, and along what.
    """
    points = _places(rim, spacing)
    if len(points) == 0:
        return []
    phi, normals = signed_distances(tools.arrays, offsets, points)
    near = np.abs(phi) < NEAR * spacing
    found = []
    for i in range(len(tools)):
        for j in range(i + 1, len(tools)):
            both = near[i] & near[j]
            way = ways[i] - ways[j]
            apart = bool(np.linalg.norm(way) > 0.0)
            drawn = _is_drawn(tools, i, j)
            if not both.any() or not (apart or drawn):
                continue
            at = np.flatnonzero(both)
            opposed = np.einsum("nc,nc->n", normals[i, at], normals[j, at]) < OPPOSED
            closing = opposed & (np.abs(normals[i, at] @ way) > ALONG * float(np.linalg.norm(way))) & apart
            depth = np.where(closing | (opposed & drawn), -(phi[i, at] + phi[j, at]), -math.inf)
            if drawn:
                depth = np.maximum(depth, np.minimum(-phi[i, at], -phi[j, at]))
            candidates = np.flatnonzero(depth > TOLERANCE * spacing)
            if len(candidates) == 0:
                continue
            order = candidates[np.argsort(-depth[candidates], kind="stable")]
            order = np.unique(np.concatenate([order[:VERIFIED], order[:: 1 + len(order) // VERIFIED]]))
            exact = _proved_depth(tools, i, j, offsets, points[at[order]])
            worst = int(np.argmax(exact))
            if exact[worst] > TOLERANCE * spacing:
                chosen = order[worst]
                found.append(
                    Overlap(
                        tools.names[i], tools.names[j], float(exact[worst]), points[at[chosen]], apart,
                        bool(closing[chosen]),
                    )
                )  # fmt: skip
    return found


def _places(rim: FloatArray, spacing: float) -> FloatArray:
    """Return places around the rim, shape (n, 3), mm: at it, on the walls and behind them."""
    some = rim[:: 1 + len(rim) // MOST_PLACES]
    ways = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij")).reshape(3, -1).T
    length = np.linalg.norm(ways, axis=1)
    ways = ways[length > 0.0] / length[length > 0.0, None]
    steps = np.concatenate([np.zeros((1, 3)), *(d * spacing * ways for d in DISTANCES)])
    return np.ascontiguousarray((some[:, None] + steps).reshape(-1, 3))


def _is_drawn(tools: ToolSet, i: int, j: int) -> bool:
    """Tell whether two tools are bodies as drawn, at least one from a file: nothing endless, which must overlap."""
    kinds = tools.arrays.kind[[i, j]]
    ends = np.isfinite(tools.arrays.box[[i, j]]).all(axis=(1, 2)) | (tools.arrays.side[[i, j]] < 0.0)
    return bool((kinds == MESH).any() and (kinds != PLANE).all() and ends.all())


def _proved_depth(tools: ToolSet, i: int, j: int, offsets: FloatArray, points: FloatArray) -> FloatArray:
    """Return how deep the tools overlap at points at least, mm: surfaces from files by their triangles."""
    distances = []
    all_phi, _ = signed_distances(tools.arrays, offsets, np.ascontiguousarray(points))
    for t in (i, j):
        surface = tools.surfaces[t]
        if surface is None:
            distances.append(all_phi[t])
        else:
            local = (points - offsets[t] - tools.arrays.origin[t]) @ tools.arrays.frame[t].T
            distances.append(tools.arrays.side[t] * surface_distance(surface, local))
    first, second = distances
    return np.maximum(-(first + second), np.minimum(-first, -second))


def surface_distance(surface: ClosedSurface, points: FloatArray) -> FloatArray:
    """Return the signed distance of points, shape (n, 3), from all triangles, negative inside, shape (n,), mm."""
    corners = surface.points[surface.triangles]
    distance = _least_distance(np.ascontiguousarray(points), corners)
    return np.asarray(np.where(surface.contains(points), -distance, distance))


@njit(parallel=True)
def _least_distance(points, corners):  # type: ignore[no-untyped-def]
    """Return the distance of each point from the nearest of all triangles."""
    least = np.empty(len(points))
    for n in prange(len(points)):
        best = math.inf
        for t in range(corners.shape[0]):
            d = triangle_distance_squared(
                points[n, 0], points[n, 1], points[n, 2], corners[t, 0], corners[t, 1], corners[t, 2]
            )
            best = min(best, d)
        least[n] = math.sqrt(best)
    return least
