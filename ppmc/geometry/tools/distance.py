"""Signed distance of moving tools, positive outside a tool; the gradient points to where material may be (kernels)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit, prange
from ppmc.geometry.tools.packed import BOX, CYLINDER, EXTRUSION, PLANE, REVOLUTION, ToolArrays
from ppmc.geometry.tools.shape_distance import (
    box_distance,
    cylinder_distance,
    extrusion_distance,
    grid_distance,
    revolution_distance,
)


@njit
def tool_distance(tools, index, offsets, x, y, z):  # type: ignore[no-untyped-def]
    """Return the signed distance of one tool and its unit normal, for use inside kernels.

    Parameters
    ----------
    tools : ToolArrays
        All tools.
    index : int
        Which tool.
    offsets : ndarray, shape (tools, 3)
        Present displacement of every tool from its drawn position, mm.
    x, y, z : float
        The point, mm.

    Returns
    -------
    tuple of 4 floats
        phi (mm, positive outside the tool), and the unit normal (nx, ny, nz) out of the tool.
    """
    frame = tools.frame[index]
    gx = x - offsets[index, 0] - tools.origin[index, 0]
    gy = y - offsets[index, 1] - tools.origin[index, 1]
    gz = z - offsets[index, 2] - tools.origin[index, 2]
    kind = tools.kind[index]
    if kind == PLANE:
        nx, ny, nz = frame[2, 0], frame[2, 1], frame[2, 2]
        return gx * nx + gy * ny + gz * nz, nx, ny, nz
    lx = frame[0, 0] * gx + frame[0, 1] * gy + frame[0, 2] * gz
    ly = frame[1, 0] * gx + frame[1, 1] * gy + frame[1, 2] * gz
    lz = frame[2, 0] * gx + frame[2, 1] * gy + frame[2, 2] * gz
    size = tools.size[index]
    if kind == BOX:
        phi, mx, my, mz = box_distance(lx, ly, lz, size[0], size[1], size[2], size[3])
    elif kind == CYLINDER:
        phi, mx, my, mz = cylinder_distance(lx, ly, lz, size[0], size[1], size[3])
    elif kind == EXTRUSION:
        first, last = tools.segment_start[index], tools.segment_start[index + 1]
        phi, mx, my, mz = extrusion_distance(lx, ly, lz, size[0], tools.segments, first, last)
    elif kind == REVOLUTION:
        first, last = tools.segment_start[index], tools.segment_start[index + 1]
        phi, mx, my, mz = revolution_distance(lx, ly, lz, size[0], tools.segments, first, last)
    else:
        phi, mx, my, mz = grid_distance(
            lx,
            ly,
            lz,
            tools.grid_shape[index],
            tools.grid_origin[index],
            tools.grid_spacing[index],
            tools.grid_start[index],
            tools.grid_values,
        )
    side = tools.side[index]
    return (
        side * phi,
        side * (frame[0, 0] * mx + frame[1, 0] * my + frame[2, 0] * mz),
        side * (frame[0, 1] * mx + frame[1, 1] * my + frame[2, 1] * mz),
        side * (frame[0, 2] * mx + frame[1, 2] * my + frame[2, 2] * mz),
    )


@njit
def distance_bound(tools, index, offsets, x, y, z):  # type: ignore[no-untyped-def]
    """Return a cheap lower bound of a tool's distance: that of its bounding box; -inf where the box says nothing."""
    if tools.side[index] < 0.0 or tools.kind[index] == PLANE:
        return -math.inf
    frame = tools.frame[index]
    gx = x - offsets[index, 0] - tools.origin[index, 0]
    gy = y - offsets[index, 1] - tools.origin[index, 1]
    gz = z - offsets[index, 2] - tools.origin[index, 2]
    total = 0.0
    for a in range(3):
        local = frame[a, 0] * gx + frame[a, 1] * gy + frame[a, 2] * gz
        beyond = max(tools.box[index, 0, a] - local, local - tools.box[index, 1, a], 0.0)
        total += beyond * beyond
    return math.sqrt(total) if total > 0.0 else -math.inf


@njit(parallel=True)
def signed_distances(tools, offsets, points):  # type: ignore[no-untyped-def]
    """Return the distance of every tool from every point.

    Parameters
    ----------
    tools : ToolArrays
        All tools.
    offsets : ndarray, shape (tools, 3)
        Displacement of every tool from its drawn position, mm.
    points : ndarray, shape (n, 3)
        Points, mm.

    Returns
    -------
    phi : ndarray, shape (tools, n)
        Signed distances, mm, positive outside the tool.
    normals : ndarray, shape (tools, n, 3)
        Unit normals out of the tool.
    """
    count = tools.kind.shape[0]
    n = points.shape[0]
    phi = np.empty((count, n))
    normals = np.empty((count, n, 3))
    for p in prange(n):
        for t in range(count):
            d, nx, ny, nz = tool_distance(tools, t, offsets, points[p, 0], points[p, 1], points[p, 2])
            phi[t, p] = d
            normals[t, p, 0] = nx
            normals[t, p, 1] = ny
            normals[t, p, 2] = nz
    return phi, normals


@njit(parallel=True)
def nearest_tools(tools, offsets, points):  # type: ignore[no-untyped-def]
    """Return each point's smallest distance over all tools and the tool that has it.

    Returns
    -------
    phi : ndarray, shape (n,)
        Distance to the nearest tool, mm; negative in a tool.
    index : ndarray, shape (n,)
        That tool.
    """
    n = points.shape[0]
    phi = np.empty(n)
    index = np.empty(n, dtype=np.int64)
    for p in prange(n):
        best = math.inf
        which = -1
        for t in range(tools.kind.shape[0]):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            if distance_bound(tools, t, offsets, x, y, z) >= best:
                continue
            d, _, _, _ = tool_distance(tools, t, offsets, x, y, z)
            if d < best:
                best = d
                which = t
        phi[p] = best
        index[p] = which
    return phi, index


def no_offsets(tools: ToolArrays) -> NDArray[np.float64]:
    """Return zero displacements: the drawn position."""
    return np.zeros((len(tools.kind), 3))
