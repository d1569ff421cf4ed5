"""Walls within reach of a point: up to three from one tool, so that concave edges and corners hold (kernels).

The distance field of a tool knows the nearest wall only. In a concave edge two walls bear on a particle at once, in a
corner three. They are found by lifting the point off the walls already known, by `reach` along their normals, until
another wall is nearer; its tangent plane gives the distance at the original point. For plane walls this is exact.
"""

from __future__ import annotations

import math

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.geometry.distance import distance_bound, tool_distance

SAME_WALL = 0.94
"""Cosine of the angle (20 degrees) below which two normals are taken as one smooth wall."""

MOST_CONTACTS = 6
"""Most walls kept for a point, the nearest ones."""


@njit
def tool_contacts(tools, index, offsets, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Return the distinct walls of one tool within `reach` of a point.

    Parameters
    ----------
    tools, index, offsets, x, y, z
        As `ppmc.geometry.distance.tool_distance`.
    reach : float
        Walls further away are left out, mm; two or three particle spacings.

    Returns
    -------
    tuple
        (count, phi0, n0x, n0y, n0z, phi1, n1x, n1y, n1z, phi2, n2x, n2y, n2z), the nearest wall first; entries
        beyond `count` are zero.
    """
    if distance_bound(tools, index, offsets, x, y, z) > reach:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    p0, ax, ay, az = tool_distance(tools, index, offsets, x, y, z)
    if not p0 <= reach:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count = 1
    p1 = bx = by = bz = 0.0
    p2 = cx = cy = cz = 0.0
    # From inside the tool the lift must first bring the point back out.
    lift = reach + max(-p0, 0.0)
    d, nx, ny, nz = tool_distance(tools, index, offsets, x + lift * ax, y + lift * ay, z + lift * az)
    cosine = nx * ax + ny * ay + nz * az
    value = d - lift * cosine
    if cosine < SAME_WALL and value <= reach:
        count = 2
        p1, bx, by, bz = value, nx, ny, nz
        if cosine > -0.9:
            # The lift that leaves both walls at the same rate.
            lift = reach + max(-p0, -p1, 0.0)
            s = lift / (1.0 + cosine)
            mx, my, mz = s * (ax + bx), s * (ay + by), s * (az + bz)
        else:
            mx, my, mz = lift * ax, lift * ay, lift * az
        d, nx, ny, nz = tool_distance(tools, index, offsets, x + mx, y + my, z + mz)
        value = d - (nx * mx + ny * my + nz * mz)
        apart = nx * ax + ny * ay + nz * az < SAME_WALL and nx * bx + ny * by + nz * bz < SAME_WALL
        if apart and value <= reach:
            count = 3
            p2, cx, cy, cz = value, nx, ny, nz
    return count, p0, ax, ay, az, p1, bx, by, bz, p2, cx, cy, cz


@njit
def _keep(slot, phi, tool, normal, n, value, index, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Insert a wall into row `slot`, ascending in distance, dropping the furthest when the row is full."""
    most = phi.shape[1]
    if n == most and value >= phi[slot, most - 1]:
        return n
    place = min(n, most - 1)
    while place > 0 and phi[slot, place - 1] > value:
        phi[slot, place] = phi[slot, place - 1]
        tool[slot, place] = tool[slot, place - 1]
        for a in range(3):
            normal[slot, place, a] = normal[slot, place - 1, a]
        place -= 1
    phi[slot, place] = value
    tool[slot, place] = index
    normal[slot, place, 0] = nx
    normal[slot, place, 1] = ny
    normal[slot, place, 2] = nz
    return min(n + 1, most)


@njit(parallel=True)
def find_contacts(tools, offsets, points, reach):  # type: ignore[no-untyped-def]
    """Return all walls within reach of each point, the nearest first.

    Parameters
    ----------
    tools : ToolArrays
        All tools.
    offsets : ndarray, shape (tools, 3)
        Displacement of every tool, mm.
    points : ndarray, shape (n, 3)
        Points, mm.
    reach : float
        Walls further away are left out, mm.

    Returns
    -------
    count : ndarray of int64, shape (n,)
        Walls found for each point, at most 6.
    tool : ndarray of int64, shape (n, 6)
        Tool of each wall, -1 beyond `count`.
    phi : ndarray, shape (n, 6)
        Distance to the wall, mm; infinite beyond `count`.
    normal : ndarray, shape (n, 6, 3)
        Unit normal of the wall, into the material.
    """
    n = points.shape[0]
    count = np.zeros(n, dtype=np.int64)
    tool = np.full((n, MOST_CONTACTS), -1, dtype=np.int64)
    phi = np.full((n, MOST_CONTACTS), math.inf)
    normal = np.zeros((n, MOST_CONTACTS, 3))
    for p in prange(n):
        found = 0
        for t in range(tools.kind.shape[0]):
            walls, d0, ax, ay, az, d1, bx, by, bz, d2, cx, cy, cz = tool_contacts(
                tools, t, offsets, points[p, 0], points[p, 1], points[p, 2], reach
            )
            if walls > 0:
                found = _keep(p, phi, tool, normal, found, d0, t, ax, ay, az)
            if walls > 1:
                found = _keep(p, phi, tool, normal, found, d1, t, bx, by, bz)
            if walls > 2:
                found = _keep(p, phi, tool, normal, found, d2, t, cx, cy, cz)
        count[p] = found
    return count, tool, phi, normal
