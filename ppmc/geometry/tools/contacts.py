"""Walls within reach of a point: up to three from one tool, so that concave edges and corners hold (kernels).

The distance field of a tool knows the nearest wall only. In a concave edge two walls bear on a particle at once, in a
corner three. Each face of a cavity, and each line and arc of an outline on which the point has its foot, is a wall of
its own; distances and normals are exact. In a mesh further walls are found by lifting the point off the known ones
until another is nearer; its tangent plane counts if it touches the surface below the point.
"""

from __future__ import annotations

import math

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.geometry.tools.distance import distance_bound, tool_distance
from ppmc.geometry.tools.packed import BOX, CYLINDER, EXTRUSION, MESH, REVOLUTION
from ppmc.geometry.tools.shape_distance import segment_foot

SAME_WALL = 0.94
"""Cosine of the angle (20 degrees) below which two normals are taken as one smooth wall."""

MOST_CONTACTS = 6
"""Most walls kept for a point, the nearest ones."""

NO_WALLS = (0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@njit
def tool_contacts(tools, index, offsets, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Return the distinct walls of one tool within `reach` of a point.

    Parameters
    ----------
    tools, index, offsets, x, y, z
        As `ppmc.geometry.tools.distance.tool_distance`.
    reach : float
        Walls further away are left out, mm; two or three particle spacings.

    Returns
    -------
    tuple
        (count, phi0, n0x, n0y, n0z, phi1, n1x, n1y, n1z, phi2, n2x, n2y, n2z); entries beyond `count` are zero. A
        point behind two walls of a concave edge gets its depth below each.
    """
    if distance_bound(tools, index, offsets, x, y, z) > reach:
        return NO_WALLS
    phi, nx, ny, nz = tool_distance(tools, index, offsets, x, y, z)
    if not phi <= reach:
        return NO_WALLS
    walls = (1, phi, nx, ny, nz, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if tools.convex[index]:
        return walls
    if tools.kind[index] == MESH:
        return _mesh_walls(tools, index, offsets, x, y, z, reach, walls)
    # A point in the tool sees all walls from where it would come out; its nearest point may be their common edge.
    out = max(-phi, 0.0)
    nearest = walls
    if phi < 0.0 and tools.size[index, 3] == 0.0:
        walls = NO_WALLS
    gx = x + out * nx - offsets[index, 0] - tools.origin[index, 0]
    gy = y + out * ny - offsets[index, 1] - tools.origin[index, 1]
    gz = z + out * nz - offsets[index, 2] - tools.origin[index, 2]
    frame = tools.frame[index]
    lx = frame[0, 0] * gx + frame[0, 1] * gy + frame[0, 2] * gz
    ly = frame[1, 0] * gx + frame[1, 1] * gy + frame[1, 2] * gz
    lz = frame[2, 0] * gx + frame[2, 1] * gy + frame[2, 2] * gz
    shift = (out * nx, out * ny, out * nz)
    size = tools.size[index]
    kind = tools.kind[index]
    side = tools.side[index]
    if kind == BOX:
        for axis in range(3):
            local = lx if axis == 0 else ly if axis == 1 else lz
            walls = _flat_ends(walls, frame[axis], local, size[axis] + size[3], shift, reach)
    elif kind == CYLINDER:
        r = math.sqrt(lx * lx + ly * ly)
        if r > 1e-12:
            walls = _with_local(walls, frame, size[0] + size[3] - r, -lx / r, -ly / r, 0.0, shift, reach)
        walls = _flat_ends(walls, frame[2], lz, size[1] + size[3], shift, reach)
    elif kind == EXTRUSION:
        beside = abs(lz) <= size[0] + 1e-9
        if beside:
            for k in range(tools.segment_start[index], tools.segment_start[index + 1]):
                foot, d, nu, nv = segment_foot(lx, ly, tools.segments, k)
                if foot and side * d >= -1e-9:
                    walls = _with_local(walls, frame, side * d, side * nu, side * nv, 0.0, shift, reach)
        if side < 0.0:
            walls = _flat_ends(walls, frame[2], lz, size[0], shift, reach)
    elif kind == REVOLUTION:
        px = lx - max(-size[0], min(size[0], lx))
        r = math.sqrt(px * px + ly * ly)
        if r > 1e-12:
            for k in range(tools.segment_start[index], tools.segment_start[index + 1]):
                foot, d, nr, nh = segment_foot(r, lz, tools.segments, k)
                if foot and side * d >= -1e-9:
                    walls = _with_local(
                        walls, frame, side * d, side * nr * px / r, side * nr * ly / r, side * nh, shift, reach
                    )
    return walls if walls[0] > 0 else nearest


@njit
def _flat_ends(walls, axis, local, half, shift, reach):  # type: ignore[no-untyped-def]
    """Add the two flat walls across `axis` of a cavity at local coordinates -half and half."""
    if half < math.inf:
        walls = _with_wall(walls, half - local, -axis[0], -axis[1], -axis[2], shift, reach)
        walls = _with_wall(walls, half + local, axis[0], axis[1], axis[2], shift, reach)
    return walls


@njit
def _with_local(walls, frame, phi, mx, my, mz, shift, reach):  # type: ignore[no-untyped-def]
    """Add a wall whose normal is given in the tool's frame."""
    nx = frame[0, 0] * mx + frame[1, 0] * my + frame[2, 0] * mz
    ny = frame[0, 1] * mx + frame[1, 1] * my + frame[2, 1] * mz
    nz = frame[0, 2] * mx + frame[1, 2] * my + frame[2, 2] * mz
    return _with_wall(walls, phi, nx, ny, nz, shift, reach)


@njit
def _with_wall(walls, phi, nx, ny, nz, shift, reach):  # type: ignore[no-untyped-def]
    """Add a wall seen from the point moved by `shift`, unless it is out of reach, known already, or the fourth."""
    n, p0, ax, ay, az, p1, bx, by, bz, p2, cx, cy, cz = walls
    phi -= nx * shift[0] + ny * shift[1] + nz * shift[2]
    if phi > reach or n == 3:
        return walls
    if n == 0:
        return 1, phi, nx, ny, nz, p1, bx, by, bz, p2, cx, cy, cz
    if nx * ax + ny * ay + nz * az > SAME_WALL:
        if phi < p0:
            return n, phi, nx, ny, nz, p1, bx, by, bz, p2, cx, cy, cz
        return walls
    if n == 1:
        return 2, p0, ax, ay, az, phi, nx, ny, nz, p2, cx, cy, cz
    if nx * bx + ny * by + nz * bz > SAME_WALL:
        if phi < p1:
            return n, p0, ax, ay, az, phi, nx, ny, nz, p2, cx, cy, cz
        return walls
    return 3, p0, ax, ay, az, p1, bx, by, bz, phi, nx, ny, nz


@njit
def _mesh_walls(tools, index, offsets, x, y, z, reach, nearest):  # type: ignore[no-untyped-def]
    """Return the walls of a mesh near a point: each is seen from a probe that lies clearly nearer to it.

    Probes are the point itself; the point lifted off the first wall, and off the first two; and, where the
    interpolated gradient is the mixture of two walls (it is then too small), six points around.
    """
    _, phi, nx, ny, nz, _, _, _, _, _, _, _, _ = nearest
    step = tools.grid_spacing[index]
    above, _, _, _ = tool_distance(tools, index, offsets, x + step * nx, y + step * ny, z + step * nz)
    below, _, _, _ = tool_distance(tools, index, offsets, x - step * nx, y - step * ny, z - step * nz)
    walls = NO_WALLS
    if above - below > 1.95 * step:
        walls = nearest
    else:
        for side in range(6):
            s = 1.5 * step if side % 2 == 0 else -1.5 * step
            sx = s if side // 2 == 0 else 0.0
            sy = s if side // 2 == 1 else 0.0
            sz = s if side // 2 == 2 else 0.0
            walls = _probe(tools, index, offsets, x, y, z, sx, sy, sz, reach, walls)
    for attempt in range(4):
        n, _, ax, ay, az, _, bx, by, bz, _, _, _, _ = walls
        if n == 0 or n == 3:
            break
        lift = max(-phi, 0.0) + reach * (1.0 if attempt % 2 == 0 else 0.5)
        cosine = ax * bx + ay * by + az * bz
        s = lift if n == 1 or cosine < -0.9 else lift / (1.0 + cosine)
        if cosine < -0.9:
            bx, by, bz = 0.0, 0.0, 0.0
        walls = _probe(tools, index, offsets, x, y, z, s * (ax + bx), s * (ay + by), s * (az + bz), reach, walls)
    return walls if walls[0] > 0 else nearest


@njit
def _probe(tools, index, offsets, x, y, z, sx, sy, sz, reach, walls):  # type: ignore[no-untyped-def]
    """Add the wall nearest to the point moved by (sx, sy, sz), its normal taken close above its surface."""
    d, nx, ny, nz = tool_distance(tools, index, offsets, x + sx, y + sy, z + sz)
    step = tools.grid_spacing[index]
    for _ in range(2):
        down = d - step
        sx -= down * nx
        sy -= down * ny
        sz -= down * nz
        d, nx, ny, nz = tool_distance(tools, index, offsets, x + sx, y + sy, z + sz)
    phi = d - (nx * sx + ny * sy + nz * sz)
    # Going down between two walls does not reach the surface: the normal there belongs to neither.
    if phi > reach or abs(d - step) > 0.2 * step:
        return walls
    # The tangent plane of an edge seen from the side hangs in the air below the point: no wall.
    below, _, _, _ = tool_distance(tools, index, offsets, x - phi * nx, y - phi * ny, z - phi * nz)
    if below > 0.3 * step:
        return walls
    return _with_wall(walls, phi, nx, ny, nz, (0.0, 0.0, 0.0), reach)


@njit
def _fill_row(tools, offsets, point, reach, tool, phi, normal):  # type: ignore[no-untyped-def]
    """Write the walls of all tools near a point, ascending in distance, into one row; return how many."""
    tool[:] = -1
    phi[:] = math.inf
    normal[:] = 0.0
    found = 0
    for t in range(tools.kind.shape[0]):
        n, d0, ax, ay, az, d1, bx, by, bz, d2, cx, cy, cz = tool_contacts(
            tools, t, offsets, point[0], point[1], point[2], reach
        )
        for k in range(n):
            value, nx, ny, nz = d0, ax, ay, az
            if k == 1:
                value, nx, ny, nz = d1, bx, by, bz
            elif k == 2:
                value, nx, ny, nz = d2, cx, cy, cz
            if value >= phi[MOST_CONTACTS - 1]:
                continue
            found = min(found + 1, MOST_CONTACTS)
            place = found - 1
            while place > 0 and phi[place - 1] > value:
                phi[place] = phi[place - 1]
                tool[place] = tool[place - 1]
                for a in range(3):
                    normal[place, a] = normal[place - 1, a]
                place -= 1
            phi[place] = value
            tool[place] = t
            normal[place, 0] = nx
            normal[place, 1] = ny
            normal[place, 2] = nz
    return found


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
    count = np.empty(n, dtype=np.int64)
    tool = np.empty((n, MOST_CONTACTS), dtype=np.int64)
    phi = np.empty((n, MOST_CONTACTS))
    normal = np.empty((n, MOST_CONTACTS, 3))
    for p in prange(n):
        count[p] = _fill_row(tools, offsets, points[p], reach, tool[p], phi[p], normal[p])
    return count, tool, phi, normal
