"""The space that tools leave free: its volume at a time, and whether it is closed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.compile_cache import njit, prange
from ppmc.errors import SceneError
from ppmc.geometry.distance import as_points, distance_bound, tool_distance
from ppmc.geometry.toolset import ToolSet

FloatArray = NDArray[np.float64]

MOST_CELLS = 6_000_000
CELLS_ALONG = 128
COARSE_CELLS_ALONG = 40
GROWTHS = 11
PARTS = 4


@dataclass(frozen=True)
class Cavity:
    """Free space between tools, connected to given points.

    Attributes
    ----------
    volume : float
        Its volume, mm^3; if it is open, of the part within `bounds`.
    closed : bool
        Whether tools bound it on all sides.
    bounds : tuple of two ndarrays of shape (3,)
        Box that was searched, mm.
    spacing : float
        Size of the cells, mm; the volume is accurate to about its square.
    """

    volume: float
    closed: bool
    bounds: tuple[FloatArray, FloatArray]
    spacing: float


def cavity_volume(
    tools: ToolSet,
    seeds: ArrayLike,
    time: float = 0.0,
    *,
    spacing: float | None = None,
    offsets: FloatArray | None = None,
) -> Cavity:
    """Return the volume of the free space that contains the seeds.

    Cells wholly free count fully; cells near a wall are divided in 4 x 4 x 4 parts, each filled in proportion to the
    distances of its middle. The box of the seeds is widened until the free space ends inside it; where it never does,
    the cavity is open. Tools thinner than 1/40 of the cavity may be overlooked in that.

    Parameters
    ----------
    tools : ToolSet
        The tools.
    seeds : array_like, shape (n, 3)
        Points of the charge (its particles, or the corners of its box pulled in a little), mm.
    time : float
        When, s.
    spacing : float, optional
        Size of the cells, mm; by default 1/128 of the longest side of the cavity. An open one has coarser cells.
    offsets : ndarray, shape (tools, 3), optional
        Displacements to use in place of the prescribed ones at `time`, mm.

    Raises
    ------
    SceneError
        If no seed lies in free space.
    """
    points = as_points(seeds)
    shift = tools.offsets(time) if offsets is None else offsets
    low, high, ends = _bounding_box(tools, points, shift, time)
    step = float(np.max(high - low)) / CELLS_ALONG if spacing is None else float(spacing)
    if not ends:
        # Of a space without end no volume is wanted, and its box is large.
        step = max(step, float(np.max(high - low)) / COARSE_CELLS_ALONG)
    step = max(step, float(np.prod(high - low) / MOST_CELLS) ** (1 / 3))
    low, high = low - step, high + step
    share, inside = _free_space(tools, points, shift, low, high, step, time)
    volume = float(np.sum(share, where=inside)) * step**3
    cells = np.array(share.shape[::-1])
    return Cavity(volume, not _open_sides(inside).any(), (low, low + step * cells), step)


def _bounding_box(
    tools: ToolSet, points: FloatArray, shift: FloatArray, time: float
) -> tuple[FloatArray, FloatArray, bool]:
    """Return a box around the free space and whether that ends in it; found on coarse cells, grown a few times."""
    low, high = points.min(axis=0), points.max(axis=0)
    pad = max(0.05 * float(np.max(high - low)), 1.0)
    low, high = low - pad, high + pad
    for _ in range(GROWTHS):
        longest = float(np.max(high - low))
        step = longest / COARSE_CELLS_ALONG
        _, inside = _free_space(tools, points, shift, low, high, step, time)
        sides = _open_sides(inside)
        if not sides.any():
            filled = np.argwhere(inside)[:, ::-1]
            return low + step * (filled.min(axis=0) - 1), low + step * (filled.max(axis=0) + 2), True
        low, high = low - 0.5 * longest * sides[0], high + 0.5 * longest * sides[1]
    return low, high, False


def _open_sides(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return, shape (2, 3), whether free cells touch the lower and upper end of the box along x, y, z."""
    ends = [[inside[..., e].any(), inside[:, e].any(), inside[e].any()] for e in (0, -1)]
    return np.array(ends)


def _free_space(
    tools: ToolSet, points: FloatArray, shift: FloatArray, low: FloatArray, high: FloatArray, step: float, time: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the free share of each cell of a box, and the cells joined to the points."""
    cells = np.maximum(np.ceil((high - low) / step), 1).astype(np.int64)
    share = _free_share(tools.arrays, shift, low, step, cells)
    inside = _connected(share, points, low, step)
    if inside is None:
        raise SceneError(
            f"tooling: at t = {time:g} s none of {len(points):,} points of the charge lies in free space; "
            "move the charge or the tools"
        )
    return share, inside


def _connected(share: FloatArray, points: FloatArray, low: FloatArray, step: float) -> NDArray[np.bool_] | None:
    """Return the free cells that are joined face to face with a cell that holds a point; None if there is none."""
    from scipy.ndimage import label

    label_of, _ = label(share > 0.0)
    index = np.floor((points - low) / step).astype(int)
    # Tools that have moved can leave points of the charge far outside of what is free by now.
    index = index[np.all((index >= 0) & (index < label_of.shape[::-1]), axis=1)]
    found = np.unique(label_of[index[:, 2], index[:, 1], index[:, 0]])
    found = found[found > 0]
    if len(found) == 0:
        return None
    return np.isin(label_of, found)


@njit
def _clearance(tools, offsets, x, y, z):  # type: ignore[no-untyped-def]
    """Return the least distance over all tools."""
    best = math.inf
    for t in range(tools.kind.shape[0]):
        if distance_bound(tools, t, offsets, x, y, z) < best:
            d, _, _, _ = tool_distance(tools, t, offsets, x, y, z)
            best = min(best, d)
    return best


@njit
def _part_share(tools, offsets, x, y, z, part):  # type: ignore[no-untyped-def]
    """Return the free share of a small cube: each wall cuts it in proportion to the distance of its middle.

    The two nearest tools are combined by the angle between them: facing walls leave what neither takes, walls at an
    angle the product of their shares, walls side by side the lesser share.
    """
    d0 = d1 = math.inf
    ax = ay = az = bx = by = bz = 0.0
    for t in range(tools.kind.shape[0]):
        if distance_bound(tools, t, offsets, x, y, z) >= d1:
            continue
        d, nx, ny, nz = tool_distance(tools, t, offsets, x, y, z)
        if d < d0:
            d1, bx, by, bz = d0, ax, ay, az
            d0, ax, ay, az = d, nx, ny, nz
        elif d < d1:
            d1, bx, by, bz = d, nx, ny, nz
    first = max(0.0, min(1.0, 0.5 + d0 / (part * (abs(ax) + abs(ay) + abs(az)))))
    if d1 >= part or first == 0.0:
        return first
    second = max(0.0, min(1.0, 0.5 + d1 / (part * (abs(bx) + abs(by) + abs(bz)))))
    cosine = ax * bx + ay * by + az * bz
    if cosine < -0.5:
        return max(0.0, first + second - 1.0)
    if cosine > 0.5:
        return min(first, second)
    return first * second


@njit
def _cell_share(tools, offsets, x, y, z, step):  # type: ignore[no-untyped-def]
    """Return the free share of the cell with its middle at x, y, z."""
    reach = 0.5 * math.sqrt(3.0) * step
    phi = _clearance(tools, offsets, x, y, z)
    if phi >= reach:
        return 1.0
    if not phi > -reach:
        return 0.0
    part = step / PARTS
    total = 0.0
    for c in range(PARTS):
        for b in range(PARTS):
            for a in range(PARTS):
                px = x + (a + 0.5) * part - 0.5 * step
                py = y + (b + 0.5) * part - 0.5 * step
                pz = z + (c + 0.5) * part - 0.5 * step
                total += _part_share(tools, offsets, px, py, pz, part)
    return total / PARTS**3


@njit(parallel=True)
def _free_share(tools, offsets, low, step, cells):  # type: ignore[no-untyped-def]
    """Return the free share of each cell of a grid, shape (nz, ny, nx)."""
    share = np.empty((cells[2], cells[1], cells[0]))
    for k in prange(cells[2]):
        for j in range(cells[1]):
            for i in range(cells[0]):
                x = low[0] + (i + 0.5) * step
                y = low[1] + (j + 0.5) * step
                z = low[2] + (k + 0.5) * step
                share[k, j, i] = _cell_share(tools, offsets, x, y, z, step)
    return share
