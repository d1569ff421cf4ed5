"""Signed distance of a closed mesh on a regular grid: made once, then interpolated while tools move.

Near the surface each node takes the least distance over all triangles near it, layer by layer (a layer is written by
one thread only, so the result does not depend on their number). Further off, nodes try the nearest triangles of their
neighbours (fast sweeping), where the distance may be too large by a fifth of the spacing. The sign comes from the
crossings of the node's vertical line with the mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit, prange
from ppmc.errors import InputFileError
from ppmc.geometry.surfaces.crossings import MOST_CROSSINGS, line_crossings
from ppmc.geometry.surfaces.triangles import triangle_distance_squared

if TYPE_CHECKING:
    from ppmc.geometry.surfaces.surface import ClosedSurface

DEFAULT_NODES_ALONG = 150
MOST_NODES = 64_000_000
PAD_CELLS = 3
BAND_CELLS = 2.9


@dataclass(frozen=True)
class DistanceGrid:
    """Signed distances at nodes.

    Attributes
    ----------
    values : ndarray of float32, shape (nz, ny, nx)
        Distance, mm, negative inside the surface.
    origin : ndarray, shape (3,)
        Position x, y, z of the first node, mm.
    spacing : float
        Distance between nodes, mm.
    """

    values: NDArray[np.float32]
    origin: NDArray[np.float64]
    spacing: float

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along x, y, z."""
        nz, ny, nx = self.values.shape
        return nx, ny, nz


def distance_grid(surface: ClosedSurface, spacing: float | None = None) -> DistanceGrid:
    """Return the signed distance grid of a closed surface.

    Parameters
    ----------
    surface : ClosedSurface
        A checked surface.
    spacing : float, optional
        Distance between nodes, mm; by default 1/150 of the longest side. Edges are rounded by about a fifth of it.

    Raises
    ------
    InputFileError
        If the grid would have more than 64 million nodes.
    """
    low, high = surface.bounds
    step = float(np.max(high - low)) / DEFAULT_NODES_ALONG if spacing is None else float(spacing)
    cells = np.ceil((high - low) / step)
    shape = cells.astype(np.int64) + 1 + 2 * PAD_CELLS
    if float(np.prod(cells + 1 + 2 * PAD_CELLS)) > MOST_NODES:
        coarser = step * (float(np.prod(cells + 7)) / MOST_NODES) ** (1 / 3)
        raise InputFileError(
            f"{surface.name}: a distance grid of spacing {step:g} mm would have {np.prod(cells + 7):.3g} nodes "
            f"(at most {MOST_NODES:.3g}); set grid_spacing to {coarser:.2g} mm or more"
        )
    origin = 0.5 * (low + high) - 0.5 * step * (shape - 1)
    corners = surface.points[surface.triangles]
    squared, nearest = _near_distances(corners, corners.min(axis=1), corners.max(axis=1), origin, step, shape)
    _sweep(squared, nearest, corners, origin, step)
    values = _with_sign(squared, surface.columns, origin, step)
    return DistanceGrid(values, origin, step)


@njit(parallel=True)
def _near_distances(corners, low, high, origin, step, shape):  # type: ignore[no-untyped-def]
    """Return squared distances and nearest triangles of the nodes in the band; infinite and -1 elsewhere."""
    nx, ny, nz = shape[0], shape[1], shape[2]
    band = BAND_CELLS * step
    squared = np.full((nz, ny, nx), math.inf)
    nearest = np.full((nz, ny, nx), -1, dtype=np.int32)
    for k in prange(nz):
        z = origin[2] + k * step
        for t in range(corners.shape[0]):
            if z < low[t, 2] - band or z > high[t, 2] + band:
                continue
            a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
            # Nodes further than the band from the triangle's plane are passed over quickly.
            mx = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
            my = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
            mz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            limit = band * math.sqrt(mx * mx + my * my + mz * mz)
            i0 = max(0, math.ceil((low[t, 0] - band - origin[0]) / step))
            i1 = min(nx - 1, math.floor((high[t, 0] + band - origin[0]) / step))
            j0 = max(0, math.ceil((low[t, 1] - band - origin[1]) / step))
            j1 = min(ny - 1, math.floor((high[t, 1] + band - origin[1]) / step))
            for j in range(j0, j1 + 1):
                y = origin[1] + j * step
                for i in range(i0, i1 + 1):
                    x = origin[0] + i * step
                    plane = (x - a[0]) * mx + (y - a[1]) * my + (z - a[2]) * mz
                    if abs(plane) > limit:
                        continue
                    d = triangle_distance_squared(x, y, z, a, b, c)
                    if d < squared[k, j, i]:
                        squared[k, j, i] = d
                        nearest[k, j, i] = t
    return squared, nearest


@njit
def _sweep(squared, nearest, corners, origin, step):  # type: ignore[no-untyped-def]
    """Fill nodes outside the band from their neighbours' nearest triangles: eight sweeps, in place."""
    nz, ny, nx = squared.shape
    fixed = squared <= (BAND_CELLS * step) ** 2
    for sweep in range(8):
        di = 1 if sweep & 1 else -1
        dj = 1 if sweep & 2 else -1
        dk = 1 if sweep & 4 else -1
        for kk in range(nz):
            k = kk if dk > 0 else nz - 1 - kk
            for jj in range(ny):
                j = jj if dj > 0 else ny - 1 - jj
                for ii in range(nx):
                    i = ii if di > 0 else nx - 1 - ii
                    if fixed[k, j, i]:
                        continue
                    tried = nearest[k, j, i]
                    for a in range(3):
                        u = i - di if a == 0 else i
                        v = j - dj if a == 1 else j
                        w = k - dk if a == 2 else k
                        if u < 0 or v < 0 or w < 0 or u >= nx or v >= ny or w >= nz:
                            continue
                        t = nearest[w, v, u]
                        if t < 0 or t == tried:
                            continue
                        tried = t
                        d = triangle_distance_squared(
                            origin[0] + i * step,
                            origin[1] + j * step,
                            origin[2] + k * step,
                            corners[t, 0],
                            corners[t, 1],
                            corners[t, 2],
                        )
                        if d < squared[k, j, i]:
                            squared[k, j, i] = d
                            nearest[k, j, i] = t


@njit(parallel=True)
def _with_sign(squared, columns, origin, step):  # type: ignore[no-untyped-def]
    """Return the distances with the sign that the crossings of each vertical line give."""
    nz, ny, nx = squared.shape
    values = np.empty((nz, ny, nx), dtype=np.float32)
    for j in prange(ny):
        heights = np.empty(MOST_CROSSINGS)
        for i in range(nx):
            count = line_crossings(columns, origin[0] + i * step, origin[1] + j * step, heights)
            passed = 0
            for k in range(nz):
                z = origin[2] + k * step
                while passed < count and heights[passed] <= z:
                    passed += 1
                sign = -1.0 if passed % 2 == 1 else 1.0
                values[k, j, i] = sign * math.sqrt(squared[k, j, i])
    return values
