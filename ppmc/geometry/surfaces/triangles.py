"""Distance from a point to a triangle, and crossing of two triangles (kernels)."""

from __future__ import annotations

import math

import numpy as np

from ppmc.compile_cache import njit, prange


@njit
def segment_distance_squared(px, py, pz, a, b):  # type: ignore[no-untyped-def]
    """Return the squared distance of a point from the segment a-b."""
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    dx, dy, dz = px - a[0], py - a[1], pz - a[2]
    length = ex * ex + ey * ey + ez * ez
    t = 0.0
    if length > 0.0:
        t = max(0.0, min(1.0, (dx * ex + dy * ey + dz * ez) / length))
    dx -= t * ex
    dy -= t * ey
    dz -= t * ez
    return dx * dx + dy * dy + dz * dz


@njit
def triangle_distance_squared(px, py, pz, a, b, c):  # type: ignore[no-untyped-def]
    """Return the squared distance of a point from the triangle a-b-c, which may be degenerate."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = px - a[0], py - a[1], pz - a[2]
    nx = uy * vz - uz * vy
    ny = uz * vx - ux * vz
    nz = ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    if nn > 0.0:
        # Barycentric coordinates of the foot on the plane.
        gamma = ((uy * wz - uz * wy) * nx + (uz * wx - ux * wz) * ny + (ux * wy - uy * wx) * nz) / nn
        beta = ((wy * vz - wz * vy) * nx + (wz * vx - wx * vz) * ny + (wx * vy - wy * vx) * nz) / nn
        if gamma >= 0.0 and beta >= 0.0 and beta + gamma <= 1.0:
            h = wx * nx + wy * ny + wz * nz
            return h * h / nn
    d = segment_distance_squared(px, py, pz, a, b)
    d = min(d, segment_distance_squared(px, py, pz, b, c))
    return min(d, segment_distance_squared(px, py, pz, c, a))


@njit
def _volume(a, b, c, d):  # type: ignore[no-untyped-def]
    """Return six times the signed volume of a tetrahedron."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return (uy * vz - uz * vy) * wx + (uz * vx - ux * vz) * wy + (ux * vy - uy * vx) * wz


@njit
def _edge_pierces(p, q, a, b, c, small):  # type: ignore[no-untyped-def]
    """Tell whether segment p-q goes through the inside of triangle a-b-c, by more than the volume `small`."""
    above = _volume(a, b, c, p)
    below = _volume(a, b, c, q)
    if not ((above > small and below < -small) or (above < -small and below > small)):
        return False
    u = _volume(p, q, a, b)
    v = _volume(p, q, b, c)
    w = _volume(p, q, c, a)
    return (u > small and v > small and w > small) or (u < -small and v < -small and w < -small)


@njit(parallel=True)
def first_self_crossing(points, triangles, order, low, high, axis, small):  # type: ignore[no-untyped-def]
    """Return for each triangle (in `order`) a later one that it crosses, or -1: sweep along `axis`.

    Parameters
    ----------
    points, triangles
        The mesh.
    order : ndarray of int64, shape (n,)
        Triangles by ascending lower bound along `axis`.
    low, high : ndarray, shape (n, 3)
        Bounding boxes of the triangles.
    axis : int
        Direction of the sweep.
    small : float
        Volumes below this count as touching, mm^3.
    """
    n = triangles.shape[0]
    partner = np.full(n, -1, dtype=np.int64)
    for i in prange(n):
        s = order[i]
        for j in range(i + 1, n):
            t = order[j]
            if low[t, axis] > high[s, axis]:
                break
            apart = False
            for a in range(3):
                if low[t, a] > high[s, a] or low[s, a] > high[t, a]:
                    apart = True
            if apart:
                continue
            shared = 0
            for a in range(3):
                for b in range(3):
                    if triangles[s, a] == triangles[t, b]:
                        shared += 1
            if shared > 1:
                continue
            crossing = False
            for a in range(3):
                p, q = points[triangles[s, a]], points[triangles[s, (a + 1) % 3]]
                if _edge_pierces(
                    p, q, points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]], small
                ):
                    crossing = True
                p, q = points[triangles[t, a]], points[triangles[t, (a + 1) % 3]]
                if _edge_pierces(
                    p, q, points[triangles[s, 0]], points[triangles[s, 1]], points[triangles[s, 2]], small
                ):
                    crossing = True
            if crossing:
                partner[i] = t
                break
    return partner


@njit(parallel=True)
def mesh_distances(points, triangles, queries):  # type: ignore[no-untyped-def]
    """Return the unsigned distance of each query point from the mesh by trying every triangle; for few points."""
    n = queries.shape[0]
    out = np.empty(n)
    for p in prange(n):
        best = math.inf
        for t in range(triangles.shape[0]):
            best = min(best, triangle_distance_squared(queries[p, 0], queries[p, 1], queries[p, 2],
                points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]))  # fmt: skip
        out[p] = math.sqrt(best)
    return out
