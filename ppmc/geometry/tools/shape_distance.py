"""Exact signed distances of single shapes in their own frames, with unit normals (kernels).

Each function returns the distance, negative in the shape, and its gradient: the outward normal at the nearest point
of the surface. Where several points are nearest (an axis, a ridge line) one of them is chosen, always the same.
Distances of the box and of outlines after I. Quilez, "Distance functions"; signs at corners of outlines from the
pseudonormal of Baerentzen and Aanaes, IEEE TVCG 11 (2005) 243, doi:10.1109/TVCG.2005.49.
"""

from __future__ import annotations

import math

from ppmc.compile_cache import njit

TINY = 1e-12


@njit
def box_distance(x, y, z, half_x, half_y, half_z, rounding):  # type: ignore[no-untyped-def]
    """Return distance and normal of a box of half sides (half + rounding) with edges rounded by `rounding`."""
    sx = 1.0 if x >= 0.0 else -1.0
    sy = 1.0 if y >= 0.0 else -1.0
    sz = 1.0 if z >= 0.0 else -1.0
    qx = x * sx - half_x
    qy = y * sy - half_y
    qz = z * sz - half_z
    ax = max(qx, 0.0)
    ay = max(qy, 0.0)
    az = max(qz, 0.0)
    outer = math.sqrt(ax * ax + ay * ay + az * az)
    if outer > TINY:
        return outer - rounding, sx * ax / outer, sy * ay / outer, sz * az / outer
    if qx >= qy and qx >= qz:
        return qx - rounding, sx, 0.0, 0.0
    if qy >= qz:
        return qy - rounding, 0.0, sy, 0.0
    return qz - rounding, 0.0, 0.0, sz


@njit
def rectangle_distance(u, v, half_u, half_v, rounding):  # type: ignore[no-untyped-def]
    """Return distance and normal (2-D) of a rectangle, u >= 0; `half_v` may be infinite."""
    sv = 1.0 if v >= 0.0 else -1.0
    qu = u - half_u
    qv = v * sv - half_v
    au = max(qu, 0.0)
    av = max(qv, 0.0)
    outer = math.sqrt(au * au + av * av)
    if outer > TINY:
        return outer - rounding, au / outer, sv * av / outer
    if qu >= qv:
        return qu - rounding, 1.0, 0.0
    return qv - rounding, 0.0, sv


@njit
def cylinder_distance(x, y, z, radius, half_length, rounding):  # type: ignore[no-untyped-def]
    """Return distance and normal of a cylinder about z, radius and half length before rounding."""
    r = math.sqrt(x * x + y * y)
    phi, nr, nz = rectangle_distance(r, z, radius, half_length, rounding)
    if r > TINY:
        return phi, nr * x / r, nr * y / r, nz
    return phi, nr, 0.0, nz


@njit
def outline_distance(u, v, segments, first, last):  # type: ignore[no-untyped-def]
    """Return distance and normal (2-D) of an outline of straight lines and arcs, rows first..last of `segments`."""
    best = math.inf
    phi = math.inf
    nu = 1.0
    nv = 0.0
    for k in range(first, last):
        x0 = segments[k, 0]
        y0 = segments[k, 1]
        x1 = segments[k, 2]
        y1 = segments[k, 3]
        radius = segments[k, 6]
        end = 0
        if radius == 0.0:
            tx = x1 - x0
            ty = y1 - y0
            length = math.sqrt(tx * tx + ty * ty)
            tx /= length
            ty /= length
            along = (u - x0) * tx + (v - y0) * ty
            if along <= 0.0:
                end = 1
            elif along >= length:
                end = 2
            else:
                across = (u - x0) * ty - (v - y0) * tx
                if abs(across) < best:
                    best = abs(across)
                    phi, nu, nv = across, ty, -tx
        else:
            cx = segments[k, 4]
            cy = segments[k, 5]
            turn = segments[k, 7]
            dx = u - cx
            dy = v - cy
            # An arc of less than a half turn: anticlockwise round the solid (turn = 1), clockwise where it is hollow.
            after_start = turn * ((x0 - cx) * dy - (y0 - cy) * dx)
            before_end = turn * (dx * (y1 - cy) - dy * (x1 - cx))
            if after_start >= 0.0 and before_end >= 0.0:
                r = math.sqrt(dx * dx + dy * dy)
                if abs(r - radius) < best:
                    best = abs(r - radius)
                    phi = turn * (r - radius)
                    if r > TINY:
                        nu, nv = turn * dx / r, turn * dy / r
                    else:
                        mx = 0.5 * (x0 + x1) - cx
                        my = 0.5 * (y0 + y1) - cy
                        r = math.sqrt(mx * mx + my * my)
                        nu, nv = turn * mx / r, turn * my / r
            else:
                d0 = (u - x0) * (u - x0) + (v - y0) * (v - y0)
                d1 = (u - x1) * (u - x1) + (v - y1) * (v - y1)
                end = 1 if d0 <= d1 else 2
        if end > 0:
            px = x0 if end == 1 else x1
            py = y0 if end == 1 else y1
            dx = u - px
            dy = v - py
            d = math.sqrt(dx * dx + dy * dy)
            if d < best:
                best = d
                qx = segments[k, 6 + 2 * end]
                qy = segments[k, 7 + 2 * end]
                sign = 1.0 if dx * qx + dy * qy >= 0.0 else -1.0
                phi = sign * d
                if d > 1e-9:
                    nu, nv = sign * dx / d, sign * dy / d
                else:
                    nu, nv = qx, qy
    return phi, nu, nv


@njit
def segment_foot(u, v, segments, k):  # type: ignore[no-untyped-def]
    """Return whether a point has its foot within row k of an outline, and distance and normal (2-D) there."""
    if segments[k, 6] == 0.0:
        tx = segments[k, 2] - segments[k, 0]
        ty = segments[k, 3] - segments[k, 1]
        length = math.sqrt(tx * tx + ty * ty)
        tx /= length
        ty /= length
        du = u - segments[k, 0]
        dv = v - segments[k, 1]
        along = du * tx + dv * ty
        return -1e-9 <= along <= length + 1e-9, du * ty - dv * tx, ty, -tx
    dx = u - segments[k, 4]
    dy = v - segments[k, 5]
    turn = segments[k, 7]
    after_start = turn * ((segments[k, 0] - segments[k, 4]) * dy - (segments[k, 1] - segments[k, 5]) * dx)
    before_end = turn * (dx * (segments[k, 3] - segments[k, 5]) - dy * (segments[k, 2] - segments[k, 4]))
    r = math.sqrt(dx * dx + dy * dy)
    if after_start < 0.0 or before_end < 0.0 or r <= TINY:
        return False, 0.0, 0.0, 0.0
    return True, turn * (r - segments[k, 6]), turn * dx / r, turn * dy / r


@njit
def extrusion_distance(x, y, z, half_length, segments, first, last):  # type: ignore[no-untyped-def]
    """Return distance and normal of an outline in x, y swept along z, |z| <= half_length (may be infinite)."""
    d, nu, nv = outline_distance(x, y, segments, first, last)
    sz = 1.0 if z >= 0.0 else -1.0
    cap = z * sz - half_length
    if d > 0.0 and cap > 0.0:
        outer = math.sqrt(d * d + cap * cap)
        return outer, nu * d / outer, nv * d / outer, sz * cap / outer
    if d >= cap:
        return d, nu, nv, 0.0
    return cap, 0.0, 0.0, sz


@njit
def revolution_distance(x, y, z, half_spine, segments, first, last):  # type: ignore[no-untyped-def]
    """Return distance and normal of an outline (distance from the spine, height z) swept round a spine along x."""
    px = x - max(-half_spine, min(half_spine, x))
    r = math.sqrt(px * px + y * y)
    d, nr, nz = outline_distance(r, z, segments, first, last)
    if r > TINY:
        return d, nr * px / r, nr * y / r, nz
    # On the axis itself every meridian is as near: take the one along y, which a straight spine has too.
    return d, 0.0, nr, nz


@njit
def grid_distance(x, y, z, shape, origin, spacing, start, values):  # type: ignore[no-untyped-def]
    """Return distance and normal from a grid of nodes, trilinear; beyond the grid a lower bound of the distance."""
    nx = shape[0]
    ny = shape[1]
    nz = shape[2]
    gx = (x - origin[0]) / spacing
    gy = (y - origin[1]) / spacing
    gz = (z - origin[2]) / spacing
    if math.isnan(gx + gy + gz):
        # No cell holds such a point; whoever moves it there has to notice.
        return math.nan, 0.0, 0.0, 1.0
    cx = max(0.0, min(nx - 1.0, gx))
    cy = max(0.0, min(ny - 1.0, gy))
    cz = max(0.0, min(nz - 1.0, gz))
    i = min(int(cx), nx - 2)
    j = min(int(cy), ny - 2)
    k = min(int(cz), nz - 2)
    a = cx - i
    b = cy - j
    c = cz - k
    base = start + (k * ny + j) * nx + i
    v000 = float(values[base])
    v100 = float(values[base + 1])
    v010 = float(values[base + nx])
    v110 = float(values[base + nx + 1])
    base += nx * ny
    v001 = float(values[base])
    v101 = float(values[base + 1])
    v011 = float(values[base + nx])
    v111 = float(values[base + nx + 1])
    x00 = v000 + a * (v100 - v000)
    x10 = v010 + a * (v110 - v010)
    x01 = v001 + a * (v101 - v001)
    x11 = v011 + a * (v111 - v011)
    y0 = x00 + b * (x10 - x00)
    y1 = x01 + b * (x11 - x01)
    phi = y0 + c * (y1 - y0)
    dx = (1 - c) * ((1 - b) * (v100 - v000) + b * (v110 - v010)) + c * ((1 - b) * (v101 - v001) + b * (v111 - v011))
    dy = (1 - c) * (x10 - x00) + c * (x11 - x01)
    dz = y1 - y0
    ox = (gx - cx) * spacing
    oy = (gy - cy) * spacing
    oz = (gz - cz) * spacing
    out = math.sqrt(ox * ox + oy * oy + oz * oz)
    if out > 0.0:
        # The surface lies at least two cells inside the grid; and a distance changes no faster than the point moves.
        return max(out + 2.0 * spacing, phi - out), ox / out, oy / out, oz / out
    norm = math.sqrt(dx * dx + dy * dy + dz * dz)
    if norm > 1e-6 * spacing:
        return phi, dx / norm, dy / norm, dz / norm
    return phi, 0.0, 0.0, 1.0
