"""The space that tools leave free: its volume at a time, and whether it is closed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.compile_cache import njit, prange
from ppmc.errors import SceneError
from ppmc.geometry.cavity.flood import BLOCK, HALF_DIAGONAL, TAKEN, cell_state, flood, nearest_wall, push_out
from ppmc.geometry.cavity.search_box import search_box
from ppmc.geometry.points import as_points
from ppmc.geometry.tools.distance import distance_bound, tool_distance
from ppmc.geometry.tools.packed import MESH
from ppmc.geometry.tools.toolset import ToolSet

FloatArray = NDArray[np.float64]

CELLS_A_SPACING = 3
# Diameter of the ball in spacings: a place exactly a spacing wide is open. In the corner of a clearance there is more
# room than beside it (1.17 times in a square one); where the first ball gets out, the second is tried.
BALLS = 0.95, 1.2
SPACINGS_ALONG = 40  # where no spacing is given
PARTS = 3
# Of a charge pressed thinner than a spacing so much lies where no ball has room; the ball is then halved, so often.
CRAMPED, HALVINGS = 0.2, 4
MOST_BLOCKS = 60_000  # 31 million cells
OPEN_BLOCKS = 4_000  # of an open cavity that are searched for tools in one another's place
MOST_TABLE = 40_000_000
# Cells within so many of the flood may belong to the cavity: the tips of corners of 45 degrees and more.
NEAR = 4


@dataclass(frozen=True)
class Cavity:
    """Free space between tools, connected to given points.

    Attributes
    ----------
    volume : float
        Its volume, mm^3; infinite if it is open.
    closed : bool
        Whether tools bound it on all sides.
    bounds : tuple of two ndarrays of shape (3,)
        Box around it, mm; if it is open, the box that was searched.
    clearance : float
        Clearances narrower than this, mm, were taken as closed.
    rim : ndarray, shape (n, 3)
        Places at its edge, a ball's radius from the walls, mm; none if it is open and no tool comes from a file.
    """

    volume: float
    closed: bool
    bounds: tuple[FloatArray, FloatArray]
    clearance: float
    rim: FloatArray


def cavity_volume(
    tools: ToolSet,
    seeds: ArrayLike,
    time: float = 0.0,
    *,
    spacing: float | None = None,
    offsets: FloatArray | None = None,
) -> Cavity:
    """Return the volume of the free space that contains the seeds.

    A ball of about a spacing across floods it (:mod:`ppmc.geometry.cavity.flood`), so that clearances below a spacing
    are closed, and corners are added to what the ball reaches. Cells where walls meet are divided in 3 x 3 x 3 parts;
    each is filled in proportion to the distances of its middle, so that the volume has no steps of whole cells.

    Parameters
    ----------
    tools : ToolSet
        The tools.
    seeds : array_like, shape (n, 3)
        Points of the charge (its particles, or the corners of its box pulled in a little), mm.
    time : float
        When, s.
    spacing : float, optional
        The particle spacing, mm; by default 1/40 of the longest side of the seeds' box. Where the charge itself has
        been pressed thinner than that it is halved, and where the cavity would take too much memory it is doubled.
    offsets : ndarray, shape (tools, 3), optional
        Displacements to use in place of the prescribed ones at `time`, mm.

    Raises
    ------
    SceneError
        If no seed lies in free space.
    """
    points = as_points(seeds)
    shift = tools.offsets(time) if offsets is None else offsets
    width = spacing or max(float(np.max(np.ptp(points, axis=0))), 1.0) / SPACINGS_ALONG
    for _ in range(HALVINGS):
        room, free = _places_with_room(tools, points, shift, BALLS[0] * width)
        if len(room) >= (1.0 - CRAMPED) * free:
            break
        width *= 0.5
    if len(room) == 0:
        raise SceneError(
            f"tooling: at t = {time:g} s none of {len(points):,} points of the charge lies in free space; "
            "move the charge or the tools"
        )
    while True:
        for ball in BALLS:
            cavity = _flooded(tools, points, shift, width, ball * width)
            if cavity is not None and cavity.closed:
                return cavity
        if cavity is not None:
            # Bodies drawn in files may leave the cavity open because they are in one another's place.
            drawn = bool((tools.arrays.kind == MESH).any())
            return replace(cavity, rim=_open_rim(tools, points, shift, width, cavity)) if drawn else cavity
        width *= 2.0


def _flooded(tools: ToolSet, points: FloatArray, shift: FloatArray, spacing: float, ball: float) -> Cavity | None:
    """Return the cavity that a ball `ball` wide floods, on cells of a third of the spacing; None if it is too large."""
    low, high = search_box(tools, points, shift, 2.0 * ball)
    step, radius = spacing / CELLS_A_SPACING, 0.5 * ball
    blocks_along = _blocks_along(low, high, step)
    room, _ = _places_with_room(tools, points, shift, ball)
    # Of the box only what the flood comes to is looked at, but it must be numbered.
    if math.prod(blocks_along) > MOST_TABLE:
        return None
    table, state, sides, whole = flood(tools.arrays, shift, low, step, radius, blocks_along, room, MOST_BLOCKS)
    if not whole:
        return None
    if sides.any() or len(room) == 0:
        return Cavity(math.inf, False, (low, high), ball, np.zeros((0, 3)))
    blocks = _blocks_to_fill(table)
    rim = _rim(table, state, blocks)
    near = _near(rim, blocks, table.shape)
    volumes, lowest, highest = _fill(tools.arrays, shift, low, step, radius, table, state, blocks, near)
    bounds = low + step * lowest.min(axis=0), low + step * (highest.max(axis=0) + 1)
    return Cavity(float(volumes.sum()), True, bounds, ball, low + step * (rim + 0.5))


def _open_rim(tools: ToolSet, points: FloatArray, shift: FloatArray, spacing: float, cavity: Cavity) -> FloatArray:
    """Return the edge, shape (n, 3), mm, of what a ball floods of an open cavity, within `OPEN_BLOCKS`."""
    (low, high), ball, step = cavity.bounds, cavity.clearance, spacing / CELLS_A_SPACING
    room, _ = _places_with_room(tools, points, shift, ball)
    along = _blocks_along(low, high, step)
    table, state, _, _ = flood(tools.arrays, shift, low, step, 0.5 * ball, along, room, OPEN_BLOCKS, True)
    return np.asarray(low + step * (_rim(table, state, _blocks_to_fill(table)) + 0.5))


def _blocks_along(low: FloatArray, high: FloatArray, step: float) -> tuple[int, int, int]:
    """Return how many blocks of cells hold a box along x, y, z."""
    x, y, z = (np.ceil((high - low) / (BLOCK * step)).astype(np.int64) + 1).tolist()
    return x, y, z


def _places_with_room(tools: ToolSet, points: FloatArray, shift: FloatArray, width: float) -> tuple[FloatArray, int]:
    """Return where balls `width` wide about the free points find room, shape (n, 3), and how many points are free."""
    places, free = _push_all(tools.arrays, shift, 0.5 * width, points)
    return places[~np.isnan(places[:, 0])], int(free.sum())


@njit(parallel=True)
def _push_all(tools, offsets, radius, points):  # type: ignore[no-untyped-def]
    """Return where each point, shape (n, 3), is pushed to, NaN where a ball finds no room, and whether it is free."""
    places = np.full(points.shape, np.nan)
    free = np.zeros(len(points), dtype=np.bool_)
    for n in prange(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        phi, _, _, _ = nearest_wall(tools, offsets, x, y, z)
        free[n] = phi > 0.0
        if free[n]:
            found, _, x, y, z = push_out(tools, offsets, radius, x, y, z)
            if found:
                places[n] = x, y, z
    return places, free


def _blocks_to_fill(table: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the blocks of the flood and those next to them, shape (n, 3), numbers along x, y, z."""
    from scipy.ndimage import binary_dilation

    return np.argwhere(binary_dilation(table >= 0, np.ones((3, 3, 3))))[:, ::-1].astype(np.int64)


@njit
def _rim(table, state, blocks):  # type: ignore[no-untyped-def]
    """Return the flooded cells that have a neighbour which is not, shape (n, 3), numbers along x, y, z."""
    rim = np.empty((1024, 3), dtype=np.int64)
    count = 0
    for n in range(len(blocks)):
        own = table[blocks[n, 2], blocks[n, 1], blocks[n, 0]]
        if own < 0:
            continue
        for cell in range(BLOCK**3):
            a, b, c = cell % BLOCK, (cell // BLOCK) % BLOCK, cell // BLOCK**2
            if state[own, c, b, a] != TAKEN:
                continue
            i, j, k = blocks[n, 0] * BLOCK + a, blocks[n, 1] * BLOCK + b, blocks[n, 2] * BLOCK + c
            if (
                cell_state(table, state, i - 1, j, k) == TAKEN
                and cell_state(table, state, i + 1, j, k) == TAKEN
                and cell_state(table, state, i, j - 1, k) == TAKEN
                and cell_state(table, state, i, j + 1, k) == TAKEN
                and cell_state(table, state, i, j, k - 1) == TAKEN
                and cell_state(table, state, i, j, k + 1) == TAKEN
            ):
                continue
            if count == rim.shape[0]:
                longer = np.empty((2 * count, 3), dtype=np.int64)
                longer[:count] = rim
                rim = longer
            rim[count, 0], rim[count, 1], rim[count, 2] = i, j, k
            count += 1
    return rim[:count]


@njit
def _near(rim, blocks, shape):  # type: ignore[no-untyped-def]
    """Return for the cells of each block, shape (blocks, 8, 8, 8), whether a cell of the rim is near."""
    numbers = np.full(shape, -1, dtype=np.int32)
    for n in range(len(blocks)):
        numbers[blocks[n, 2], blocks[n, 1], blocks[n, 0]] = n
    near = np.zeros((len(blocks), BLOCK, BLOCK, BLOCK), dtype=np.bool_)
    for n in range(len(rim)):
        for k in range(rim[n, 2] - NEAR, rim[n, 2] + NEAR + 1):
            for j in range(rim[n, 1] - NEAR, rim[n, 1] + NEAR + 1):
                for i in range(rim[n, 0] - NEAR, rim[n, 0] + NEAR + 1):
                    if i < 0 or j < 0 or k < 0:
                        continue
                    a, b, c = i // BLOCK, j // BLOCK, k // BLOCK
                    if a < shape[2] and b < shape[1] and c < shape[0] and numbers[c, b, a] >= 0:
                        near[numbers[c, b, a], k % BLOCK, j % BLOCK, i % BLOCK] = True
    return near


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
def _comes_to_flood(tools, offsets, low, step, radius, table, state, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether a point, pushed from the walls, comes to the flood, and after how many pushes."""
    found, pushes, x, y, z = push_out(tools, offsets, radius, x, y, z)
    if found:
        i = math.floor((x - low[0]) / step)
        j = math.floor((y - low[1]) / step)
        k = math.floor((z - low[2]) / step)
        for c in range(k - 1, k + 2):
            for b in range(j - 1, j + 2):
                for a in range(i - 1, i + 2):
                    if cell_state(table, state, a, b, c) == TAKEN:
                        return True, pushes
    return False, pushes


@njit
def _cell_share(tools, offsets, low, step, radius, table, state, i, j, k):  # type: ignore[no-untyped-def]
    """Return the share of a cell that belongs to the cavity."""
    x, y, z = low[0] + (i + 0.5) * step, low[1] + (j + 0.5) * step, low[2] + (k + 0.5) * step
    reach = HALF_DIAGONAL * step
    phi, _, _, _ = nearest_wall(tools, offsets, x, y, z)
    if not phi > -reach:
        return 0.0
    joined, pushes = _comes_to_flood(tools, offsets, low, step, radius, table, state, x, y, z)
    if joined and pushes <= 1:
        # A ball that rests on one wall above the middle covers the whole cell.
        return 1.0 if phi >= reach else _part_share(tools, offsets, x, y, z, step)
    part = step / PARTS
    total = 0.0
    for c in range(PARTS):
        for b in range(PARTS):
            for a in range(PARTS):
                px = x + (a + 0.5) * part - 0.5 * step
                py = y + (b + 0.5) * part - 0.5 * step
                pz = z + (c + 0.5) * part - 0.5 * step
                share = _part_share(tools, offsets, px, py, pz, part)
                if share > 0.0:
                    joined, _ = _comes_to_flood(tools, offsets, low, step, radius, table, state, px, py, pz)
                    if joined:
                        total += share
    return total / PARTS**3


@njit(parallel=True)
def _fill(tools, offsets, low, step, radius, table, state, blocks, near):  # type: ignore[no-untyped-def]
    """Return the volume of the cavity in each block, and its first and last cells along x, y, z."""
    volumes = np.zeros(len(blocks))
    lowest = np.full((len(blocks), 3), 2.0**31)
    highest = np.full((len(blocks), 3), -1.0)
    for n in prange(len(blocks)):
        total = 0.0
        for cell in range(BLOCK**3):
            a, b, c = cell % BLOCK, (cell // BLOCK) % BLOCK, cell // BLOCK**2
            i, j, k = blocks[n, 0] * BLOCK + a, blocks[n, 1] * BLOCK + b, blocks[n, 2] * BLOCK + c
            if near[n, c, b, a]:
                share = _cell_share(tools, offsets, low, step, radius, table, state, i, j, k)
            else:
                # The rim of the flood is a ball's radius from all walls, and the cells within are wholly free.
                share = 1.0 if cell_state(table, state, i, j, k) == TAKEN else 0.0
            if share > 0.0:
                total += share
                lowest[n, 0], highest[n, 0] = min(lowest[n, 0], i), max(highest[n, 0], i)
                lowest[n, 1], highest[n, 1] = min(lowest[n, 1], j), max(highest[n, 1], j)
                lowest[n, 2], highest[n, 2] = min(lowest[n, 2], k), max(highest[n, 2], k)
        volumes[n] = total * step**3
    return volumes, lowest, highest
