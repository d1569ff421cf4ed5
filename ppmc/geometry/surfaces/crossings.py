"""Where a vertical line crosses a closed triangle mesh: inside or outside, without doubt at edges (kernels).

Triangles are sorted into columns of a grid over x, y. A line through a shared edge or vertex must count once: the
side of an edge is always computed from its lower to its higher vertex, so both neighbours see the same number, and an
exact zero is decided by an infinitesimal shift of the line (simulation of simplicity, Edelsbrunner and Muecke, ACM TOG
9 (1990) 66, doi:10.1145/77635.77639). A line that still counts an uneven number of crossings is moved a little.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit, prange

MOST_CROSSINGS = 512


class Columns(NamedTuple):
    """Triangles of a mesh sorted into the columns of a grid over x and y.

    Attributes
    ----------
    points : ndarray, shape (vertices, 3)
        Vertices, mm.
    triangles : ndarray of int64, shape (triangles, 3)
        Vertex numbers.
    low : ndarray, shape (2,)
        Lower corner of the grid.
    pitch : ndarray, shape (2,)
        Width of a column along x and y.
    cells : ndarray of int64, shape (2,)
        Columns along x and y.
    start : ndarray of int64, shape (columns + 1,)
        First entry of each column in `members`.
    members : ndarray of int64
        Triangle numbers.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    low: NDArray[np.float64]
    pitch: NDArray[np.float64]
    cells: NDArray[np.int64]
    start: NDArray[np.int64]
    members: NDArray[np.int64]


def sort_into_columns(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> Columns:
    """Return the triangles sorted into about as many columns as there are triangles, at most 512 x 512."""
    low = points.min(axis=0)[:2]
    size = np.maximum(np.ptp(points, axis=0)[:2], 1e-12)
    side = np.sqrt(size[0] * size[1] / max(len(triangles), 16))
    cells = np.clip(np.ceil(size / side), 1, 512).astype(np.int64)
    pitch = size * (1 + 1e-9) / cells
    start, members = _fill_columns(points, triangles, low, pitch, cells)
    return Columns(points, triangles, low, pitch, cells, start, members)


@njit
def _fill_columns(points, triangles, low, pitch, cells):  # type: ignore[no-untyped-def]
    """Return starts and members of the columns: a counting sort."""
    n = triangles.shape[0]
    span = np.empty((n, 4), dtype=np.int64)
    start = np.zeros(cells[0] * cells[1] + 1, dtype=np.int64)
    for t in range(n):
        for a in range(2):
            u = points[triangles[t, 0], a]
            v = points[triangles[t, 1], a]
            w = points[triangles[t, 2], a]
            span[t, 2 * a] = max(0, min(cells[a] - 1, int((min(u, v, w) - low[a]) / pitch[a] - 1e-6)))
            span[t, 2 * a + 1] = max(0, min(cells[a] - 1, int((max(u, v, w) - low[a]) / pitch[a] + 1e-6)))
        for j in range(span[t, 2], span[t, 3] + 1):
            for i in range(span[t, 0], span[t, 1] + 1):
                start[j * cells[0] + i + 1] += 1
    for c in range(cells[0] * cells[1]):
        start[c + 1] += start[c]
    members = np.empty(start[-1], dtype=np.int64)
    fill = start[:-1].copy()
    for t in range(n):
        for j in range(span[t, 2], span[t, 3] + 1):
            for i in range(span[t, 0], span[t, 1] + 1):
                c = j * cells[0] + i
                members[fill[c]] = t
                fill[c] += 1
    return start, members


@njit
def _side_of_edge(points, a, b, x, y):  # type: ignore[no-untyped-def]
    """Return on which side of edge a-b (seen from above) the line passes, and twice the area it spans."""
    sign = 1.0
    if a > b:
        a, b = b, a
        sign = -1.0
    ex = points[b, 0] - points[a, 0]
    ey = points[b, 1] - points[a, 1]
    area = ex * (y - points[a, 1]) - ey * (x - points[a, 0])
    decide = area
    if decide == 0.0:
        decide = -ey
        if decide == 0.0:
            decide = ex
    side = 0
    if decide > 0.0:
        side = 1
    elif decide < 0.0:
        side = -1
    return side * int(sign), area * sign


@njit
def _crossing(columns, t, x, y):  # type: ignore[no-untyped-def]
    """Return (direction, height) at which the line crosses triangle t; direction 0 if it does not."""
    points = columns.points
    a = columns.triangles[t, 0]
    b = columns.triangles[t, 1]
    c = columns.triangles[t, 2]
    s0, w2 = _side_of_edge(points, a, b, x, y)
    s1, w0 = _side_of_edge(points, b, c, x, y)
    if s0 == 0 or s1 != s0:
        return 0, 0.0
    s2, w1 = _side_of_edge(points, c, a, x, y)
    if s2 != s0:
        return 0, 0.0
    total = w0 + w1 + w2
    if total == 0.0:
        return s0, (points[a, 2] + points[b, 2] + points[c, 2]) / 3.0
    return s0, (w0 * points[a, 2] + w1 * points[b, 2] + w2 * points[c, 2]) / total


@njit
def _column_of(columns, x, y):  # type: ignore[no-untyped-def]
    """Return the column of a point, -1 outside the grid."""
    u = (x - columns.low[0]) / columns.pitch[0]
    v = (y - columns.low[1]) / columns.pitch[1]
    if not (u >= 0.0 and v >= 0.0 and u < columns.cells[0] and v < columns.cells[1]):
        return -1
    return int(v) * columns.cells[0] + int(u)


@njit
def line_crossings(columns, x, y, heights):  # type: ignore[no-untyped-def]
    """Write the ascending heights at which a vertical line crosses the mesh; return how many, -1 if too many."""
    shift_x = columns.pitch[0] * 1e-7
    shift_y = columns.pitch[1] * 1.618e-7
    count = 0
    for attempt in range(8):
        column = _column_of(columns, x + attempt * shift_x, y + attempt * shift_y)
        if column < 0:
            return 0
        count = 0
        balance = 0
        for m in range(columns.start[column], columns.start[column + 1]):
            t = columns.members[m]
            direction, height = _crossing(columns, t, x + attempt * shift_x, y + attempt * shift_y)
            if direction != 0:
                if count == heights.shape[0]:
                    return -1
                place = count
                while place > 0 and heights[place - 1] > height:
                    heights[place] = heights[place - 1]
                    place -= 1
                heights[place] = height
                count += 1
                balance += direction
        if balance == 0 and count % 2 == 0:
            return count
    return count


@njit(parallel=True)
def points_in_mesh(columns, points):  # type: ignore[no-untyped-def]
    """Return for each point, shape (n, 3), whether it lies in the closed mesh: uneven crossings above it."""
    n = points.shape[0]
    inside = np.zeros(n, dtype=np.bool_)
    blocks = (n + 255) // 256
    for block in prange(blocks):
        heights = np.empty(MOST_CROSSINGS)
        for p in range(256 * block, min(256 * (block + 1), n)):
            count = line_crossings(columns, points[p, 0], points[p, 1], heights)
            above = 0
            for c in range(count):
                if heights[c] > points[p, 2]:
                    above += 1
            inside[p] = above % 2 == 1
    return inside
