"""Where a ball can get from given points, on cells that are looked at only when the flood comes to them (kernels).

A ball a particle spacing across stands for the charge: clearances narrower than a spacing are closed to it, however
long, for no place in them is half a spacing from all walls. A cell belongs to the flood if it holds such a place, and
cells are a third of a spacing wide, so that two neighbours of them never lie on both sides of a wall. What a ball
leaves out, corners and the mouths of clearances, is told apart by pushing a point away from the nearest wall again and
again: from a corner it comes to where the ball has room, in a clearance it is sent to and fro.
"""

from __future__ import annotations

import math

import numpy as np

from ppmc.compile_cache import njit
from ppmc.geometry.tools.distance import distance_bound, tool_distance

BLOCK = 8  # cells along a block, the unit of memory
UNSEEN, TAKEN, CLOSED = range(3)
"""States of a cell: not looked at, a ball gets there, none does."""

PUSHES = 48
# Normals with less than this between them belong to walls that face each other; if their sum is longer than the next
# number (they open by 9 degrees and more), the point slides out along it, so many radii at a time.
FACING, OPENING, SLIDE = -0.5, 0.15, 0.25
# A point that has moved less than this, in radii of the ball, after so many pushes, goes to and fro in a clearance.
STUCK, PUSHES_WATCHED = 0.05, 6
# Where walls meet, a ball counts as in place that is so much too large; it comes nearer by a part of the rest a push.
NEARLY = 0.05
HALF_DIAGONAL = 0.5 * math.sqrt(3.0)


@njit
def nearest_wall(tools, offsets, x, y, z):  # type: ignore[no-untyped-def]
    """Return the least distance over all tools, mm, and the normal (3 floats) of the tool that has it."""
    best = math.inf
    ax, ay, az = 0.0, 0.0, 1.0
    for t in range(tools.kind.shape[0]):
        bound = distance_bound(tools, t, offsets, x, y, z)
        if bound < best:
            d, nx, ny, nz = tool_distance(tools, t, offsets, x, y, z)
            if bound > d:
                # Beyond a mesh's grid, a few cells off its box, only a bound is known: that of the box is closer.
                d = bound
                nx, ny, nz = _from_box(tools, t, offsets, x, y, z)
            if d < best:
                best, ax, ay, az = d, nx, ny, nz
    return best, ax, ay, az


@njit
def _from_box(tools, index, offsets, x, y, z):  # type: ignore[no-untyped-def]
    """Return the unit vector to a point outside of a tool's bounding box from the nearest place of the box."""
    frame = tools.frame[index]
    gx = x - offsets[index, 0] - tools.origin[index, 0]
    gy = y - offsets[index, 1] - tools.origin[index, 1]
    gz = z - offsets[index, 2] - tools.origin[index, 2]
    nx = ny = nz = 0.0
    for a in range(3):
        local = frame[a, 0] * gx + frame[a, 1] * gy + frame[a, 2] * gz
        beyond = max(local - tools.box[index, 1, a], 0.0) - max(tools.box[index, 0, a] - local, 0.0)
        nx, ny, nz = nx + beyond * frame[a, 0], ny + beyond * frame[a, 1], nz + beyond * frame[a, 2]
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / size, ny / size, nz / size


@njit
def push_out(tools, offsets, radius, x, y, z):  # type: ignore[no-untyped-def]
    """Push a point from the nearest wall until a ball about it has room.

    Parameters
    ----------
    tools, offsets
        As in :func:`ppmc.geometry.tools.distance.tool_distance`.
    radius : float
        Of the ball, mm.
    x, y, z : float
        The point, mm.

    Returns
    -------
    tuple
        Whether the ball found room, how often the point was pushed, and where it came to (3 floats, mm).
    """
    enough = radius * (1.0 - NEARLY)
    px, py, pz = x, y, z
    mx, my, mz = x, y, z  # where it was when it was last watched
    free = False
    nx = ny = nz = step = 0.0
    for push in range(PUSHES):
        phi, ax, ay, az = nearest_wall(tools, offsets, x, y, z)
        if phi >= enough:
            return True, push, x, y, z
        # Between walls that face each other: along the way on which they open, if they do.
        sx, sy, sz = 0.0, 0.0, 0.0
        if nx * ax + ny * ay + nz * az < FACING:
            sx, sy, sz = nx + ax, ny + ay, nz + az
            size = math.sqrt(sx * sx + sy * sy + sz * sz)
            along = SLIDE * radius / size if size > OPENING else 0.0
            sx, sy, sz = along * sx, along * sy, along * sz
        if phi < 0.0 and free:
            # Pushed into the wall opposite: only half as far, lest it comes out behind a thin one.
            step *= 0.5
        else:
            free = phi >= 0.0
            px, py, pz, nx, ny, nz = x, y, z, ax, ay, az
            step = radius - phi
        px, py, pz = px + sx, py + sy, pz + sz
        x, y, z = px + step * nx, py + step * ny, pz + step * nz
        if push % PUSHES_WATCHED == PUSHES_WATCHED - 1:
            moved = (px - mx) ** 2 + (py - my) ** 2 + (pz - mz) ** 2
            if moved < (STUCK * radius) ** 2:
                break
            mx, my, mz = px, py, pz
    return False, PUSHES, px, py, pz


@njit
def _room_in_cell(tools, offsets, radius, step, x, y, z):  # type: ignore[no-untyped-def]
    """Return a lower bound of the distance at the middle x, y, z of a cell; -1 if no ball has room in the cell."""
    enough = radius * (1.0 - 1e-6)
    phi, nx, ny, nz = nearest_wall(tools, offsets, x, y, z)
    middle = phi
    px, py, pz = x, y, z
    half = 0.5 * step
    for _ in range(3):
        if phi >= enough:
            return max(middle, 0.0)
        if phi < radius - 2.0 * HALF_DIAGONAL * step:
            return -1.0
        px = min(max(px + (radius - phi) * nx, x - half), x + half)
        py = min(max(py + (radius - phi) * ny, y - half), y + half)
        pz = min(max(pz + (radius - phi) * nz, z - half), z + half)
        phi, nx, ny, nz = nearest_wall(tools, offsets, px, py, pz)
    return max(middle, 0.0) if phi >= enough else -1.0


@njit
def cell_state(table, state, i, j, k):  # type: ignore[no-untyped-def]
    """Return the state of a cell by its number along x, y, z; one outside of the box is not looked at."""
    if i < 0 or j < 0 or k < 0:
        return UNSEEN
    a, b, c = i // BLOCK, j // BLOCK, k // BLOCK
    if a >= table.shape[2] or b >= table.shape[1] or c >= table.shape[0]:
        return UNSEEN
    block = table[c, b, a]
    return UNSEEN if block < 0 else state[block, k % BLOCK, j % BLOCK, i % BLOCK]


@njit
def flood(tools, offsets, low, step, radius, shape, seeds, most, beyond_sides=False):  # type: ignore[no-untyped-def]
    """Flood the cells of a box in which a ball has room, from the cells of given points.

    Parameters
    ----------
    tools, offsets
        As in :func:`ppmc.geometry.tools.distance.tool_distance`.
    low : ndarray, shape (3,)
        Lower corner of the box, mm.
    step, radius : float
        Width of cells and radius of the ball, mm.
    shape : tuple of 3 ints
        Blocks of the box along x, y, z.
    seeds : ndarray, shape (n, 3)
        Where balls with room begin, mm.
    most : int
        Blocks beyond which the flood gives up.
    beyond_sides : bool
        Whether to go on where a side of the box has been reached, for all of the box that is open to the seeds.

    Returns
    -------
    table : ndarray of int32, shape (nz, ny, nx)
        Number of each block, -1 where the flood has not come.
    state : ndarray of uint8, shape (blocks, 8, 8, 8)
        States of the cells of each block.
    sides : ndarray of bool, shape (2, 3)
        Whether the flood came to the lower and upper side of the box along x, y, z; it ends there unless it is
        to go on.
    whole : bool
        Whether it ended before it had more than `most` blocks.
    """
    nx, ny, nz = shape[0] * BLOCK, shape[1] * BLOCK, shape[2] * BLOCK
    table = np.full((shape[2], shape[1], shape[0]), -1, dtype=np.int32)
    state = np.zeros((64, BLOCK, BLOCK, BLOCK), dtype=np.uint8)
    bound = np.zeros((64, BLOCK, BLOCK, BLOCK), dtype=np.float32)
    blocks = 0
    sides = np.zeros((2, 3), dtype=np.bool_)
    stack = np.empty(1024, dtype=np.int64)
    held = 0
    # Seeds come as moves from nowhere; the others as moves from a cell whose distance bounds that of the next.
    for s in range(seeds.shape[0] + 1):
        first = s < seeds.shape[0]
        if first:
            i = math.floor((seeds[s, 0] - low[0]) / step)
            j = math.floor((seeds[s, 1] - low[1]) / step)
            k = math.floor((seeds[s, 2] - low[2]) / step)
            if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
                continue
            stack[held] = (np.int64(k) * ny + j) * nx + i
            held += 1
            a, b, c = i // BLOCK, j // BLOCK, k // BLOCK
            if table[c, b, a] < 0:
                if blocks == state.shape[0]:
                    state, bound = _grown(state), _grown_bound(bound)
                table[c, b, a] = blocks
                blocks += 1
            own = table[c, b, a]
            if state[own, k % BLOCK, j % BLOCK, i % BLOCK] == TAKEN:
                held -= 1
                continue
            state[own, k % BLOCK, j % BLOCK, i % BLOCK] = TAKEN
        while held > 0:
            held -= 1
            code = stack[held]
            i, j, k = code % nx, (code // nx) % ny, code // (nx * ny)
            here = bound[table[k // BLOCK, j // BLOCK, i // BLOCK], k % BLOCK, j % BLOCK, i % BLOCK] - step
            for side in range(6):
                u, v, w = i, j, k
                way = 1 if side % 2 else -1
                if side < 2:
                    u += way
                elif side < 4:
                    v += way
                else:
                    w += way
                if u < 0 or v < 0 or w < 0 or u >= nx or v >= ny or w >= nz:
                    sides[side % 2, side // 2] = True
                    if beyond_sides:
                        continue
                    return table, state[:blocks], sides, True
                a, b, c = u // BLOCK, v // BLOCK, w // BLOCK
                if table[c, b, a] < 0:
                    if blocks >= most:
                        return table, state[:blocks], sides, False
                    if blocks == state.shape[0]:
                        state, bound = _grown(state), _grown_bound(bound)
                    table[c, b, a] = blocks
                    blocks += 1
                block = table[c, b, a]
                p, q, r = w % BLOCK, v % BLOCK, u % BLOCK
                if state[block, p, q, r] != UNSEEN:
                    continue
                room = here
                if room < radius:
                    room = _room_in_cell(
                        tools, offsets, radius, step,
                        low[0] + (u + 0.5) * step, low[1] + (v + 0.5) * step, low[2] + (w + 0.5) * step,
                    )  # fmt: skip
                if room < 0.0:
                    state[block, p, q, r] = CLOSED
                    continue
                state[block, p, q, r] = TAKEN
                bound[block, p, q, r] = room
                if held == stack.shape[0]:
                    longer = np.empty(2 * held, dtype=np.int64)
                    longer[:held] = stack
                    stack = longer
                stack[held] = (np.int64(w) * ny + v) * nx + u
                held += 1
    return table, state[:blocks], sides, True


@njit
def _grown(state):  # type: ignore[no-untyped-def]
    """Return the states with room for twice as many blocks."""
    longer = np.zeros((2 * state.shape[0], BLOCK, BLOCK, BLOCK), dtype=np.uint8)
    longer[: state.shape[0]] = state
    return longer


@njit
def _grown_bound(bound):  # type: ignore[no-untyped-def]
    """Return the bounds with room for twice as many blocks."""
    longer = np.zeros((2 * bound.shape[0], BLOCK, BLOCK, BLOCK), dtype=np.float32)
    longer[: bound.shape[0]] = bound
    return longer
