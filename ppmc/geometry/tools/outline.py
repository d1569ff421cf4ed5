"""Closed outlines of straight lines and fillet arcs: the sections of extrusions and bodies of revolution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.errors import SceneError
from ppmc.geometry.tools.packed import SEGMENT_COLUMNS

FloatArray = NDArray[np.float64]


def outline_segments(
    corners: ArrayLike, radii: float | Sequence[float] = 0.0, *, axis_at_zero: bool = False, name: str = "outline"
) -> FloatArray:
    """Return an outline as rows of straight lines and arcs, the solid on their left.

    Parameters
    ----------
    corners : array_like, shape (n, 2)
        Corners of the closed outline in either sense, mm.
    radii : float or sequence of n floats
        Fillet radius at each corner, mm; 0 leaves it sharp.
    axis_at_zero : bool
        The first coordinate is a distance from an axis: edges on the axis are no surface and are left out, and
        corners on it are never filleted.
    name : str
        What to call the outline in messages.

    Returns
    -------
    ndarray, shape (segments, 12)
        As `ppmc.geometry.tools.packed.ToolArrays.segments`.

    Raises
    ------
    SceneError
        If the outline crosses itself, encloses no area, or a fillet does not fit.
    """
    points = np.array(corners, dtype=float)
    radius = np.broadcast_to(np.asarray(radii, dtype=float), (len(points),)).copy()
    _check_simple(points, name)
    doubled = np.sum(points[:, 0] * np.roll(points[:, 1], -1) - np.roll(points[:, 0], -1) * points[:, 1])
    scale = float(np.ptp(points, axis=0).max())
    if abs(doubled) < 1e-12 * scale * scale:
        raise SceneError(f"{name}: the outline encloses no area; give corners that are not on one line")
    if doubled < 0:
        points, radius = points[::-1].copy(), radius[::-1].copy()
    if axis_at_zero:
        radius[points[:, 0] == 0.0] = 0.0
    rows = _lines_and_arcs(points, radius, scale, name)
    if axis_at_zero:
        kept = [row for row in rows if not (row[6] == 0.0 and row[0] == 0.0 and row[2] == 0.0)]
        if not kept:
            raise SceneError(f"{name}: the whole outline lies on the axis")
        rows = kept
    segments = np.array(rows)
    _set_pseudonormals(segments, axis_at_zero)
    return segments


def _lines_and_arcs(points: FloatArray, radius: FloatArray, scale: float, name: str) -> list[list[float]]:
    """Return rows without pseudonormals: each corner's arc, then the line to the next corner."""
    n = len(points)
    edge = np.roll(points, -1, axis=0) - points
    length = np.hypot(edge[:, 0], edge[:, 1])
    tangent = edge / length[:, None]
    before = np.roll(tangent, 1, axis=0)
    turn = before[:, 0] * tangent[:, 1] - before[:, 1] * tangent[:, 0]
    straight = np.sum(before * tangent, axis=1)
    cut = np.where(radius > 0, radius * np.tan(0.5 * np.abs(np.arctan2(turn, straight))), 0.0)
    for k in range(n):
        if cut[k] + cut[(k + 1) % n] > length[k] * (1 + 1e-9):
            raise SceneError(
                f"{name}: the fillets at corners {points[k].tolist()} and {points[(k + 1) % n].tolist()} need "
                f"{cut[k] + cut[(k + 1) % n]:g} mm of an edge of {length[k]:g} mm; use smaller corner_radii"
            )
    rows: list[list[float]] = []
    for k in range(n):
        start = points[k] - cut[k] * before[k]
        end = points[k] + cut[k] * tangent[k]
        if cut[k] > 1e-9 * scale:
            sign = 1.0 if turn[k] > 0 else -1.0
            centre = start + sign * radius[k] * np.array([-before[k, 1], before[k, 0]])
            rows.append([*start, *end, *centre, float(radius[k]), sign])
        target = points[(k + 1) % n] - cut[(k + 1) % n] * tangent[k]
        if length[k] - cut[k] - cut[(k + 1) % n] > 1e-9 * scale:
            rows.append([*end, *target, 0.0, 0.0, 0.0, 0.0])
    return [[*row, *([0.0] * (SEGMENT_COLUMNS - 8))] for row in rows]


def _normal(row: FloatArray, at_end: bool) -> FloatArray:
    """Return the outward normal of a row at its start or end."""
    if row[6] > 0:
        outward = row[7] * (row[2:4] if at_end else row[0:2]) - row[7] * row[4:6]
    else:
        outward = np.array([row[3] - row[1], row[0] - row[2]])
    return outward / np.hypot(*outward)


def _set_pseudonormals(segments: FloatArray, axis_at_zero: bool) -> None:
    """Store at both ends of each row the mean of the normals that meet there; on an axis those of the mirror image."""
    for k in range(len(segments)):
        for at_end, neighbour, column in ((False, k - 1, 8), (True, (k + 1) % len(segments), 10)):
            own = _normal(segments[k], at_end)
            end = segments[k, 2:4] if at_end else segments[k, 0:2]
            mirrored = axis_at_zero and end[0] == 0.0
            other = own * [-1.0, 1.0] if mirrored else _normal(segments[neighbour], not at_end)
            mean = own + other
            size = np.hypot(*mean)
            segments[k, column : column + 2] = mean / size if size > 1e-9 else own


def _check_simple(points: FloatArray, name: str) -> None:
    """Refuse an outline that crosses or touches itself."""
    start, end = points, np.roll(points, -1, axis=0)
    n = len(points)

    def side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
        return np.asarray(
            (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
        )

    a, b, c, d = start[:, None], end[:, None], start[None], end[None]
    crossing = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    if crossing.any():
        i, j = (int(v) for v in np.argwhere(crossing)[0])
        raise SceneError(
            f"{name}: the edge from corner {i} crosses the edge from corner {j}; an outline must not cross itself"
        )
    if n != len(np.unique(points, axis=0)):
        raise SceneError(f"{name}: two corners of the outline are the same point; an outline must not touch itself")


def outline_integrals(segments: FloatArray) -> tuple[float, float]:
    """Return the area (mm^2) and the first moment about u = 0, the integral of u over the area (mm^3).

    Taken as boundary integrals (Green), lines and arcs by Gauss points to round-off.
    """
    node, weight = np.polynomial.legendre.leggauss(24)
    area = moment = 0.0
    for row in segments:
        if row[6] > 0:
            ray0, ray1 = row[0:2] - row[4:6], row[2:4] - row[4:6]
            first = np.arctan2(ray0[1], ray0[0])
            sweep = np.arctan2(ray0[0] * ray1[1] - ray0[1] * ray1[0], ray0 @ ray1)
            angle = first + 0.5 * sweep * (node + 1.0)
            u = row[4] + row[6] * np.cos(angle)
            slope = 0.5 * sweep * row[6] * np.cos(angle)
        else:
            u = row[0] + 0.5 * (row[2] - row[0]) * (node + 1.0)
            slope = np.full_like(u, 0.5 * (row[3] - row[1]))
        area += float(np.sum(weight * u * slope))
        moment += float(np.sum(weight * 0.5 * u * u * slope))
    return area, moment


def outline_bounds(segments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest coordinates of an outline, arcs included (each taken as its chord and bulge)."""
    ends = np.concatenate([segments[:, 0:2], segments[:, 2:4]])
    low, high = ends.min(axis=0), ends.max(axis=0)
    for row in segments[segments[:, 6] > 0]:
        for direction in np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]):
            a, b = row[0:2] - row[4:6], row[2:4] - row[4:6]
            if row[7] * (a[0] * direction[1] - a[1] * direction[0]) >= 0 and (
                row[7] * (direction[0] * b[1] - direction[1] * b[0]) >= 0
            ):
                tip = row[4:6] + row[6] * direction
                low, high = np.minimum(low, tip), np.maximum(high, tip)
    return low, high
