"""The papers' five steps: fill one layer of a charge with randomly placed platelets (A, section 4).

1. Begin at a randomly chosen cell that no platelet holds.
2. Draw an angle; near a wall, only angles at which the walls cut off no more than allowed. Next to a wall there may be
   none: such cells are left to their neighbours' platelets, and at last to those of step 5, which take an angle at
   which they extend least far beyond the wall.
3. Find the cells whose centres lie in the length x width rectangle round that cell.
4. If all of them are free, they become a platelet. Otherwise start over.
5. After many failures in a row, incomplete platelets are allowed: they take the free cells of their rectangle.
"""

from __future__ import annotations

import math

import numpy as np

from ppmc.charge.random_numbers import next_below, next_uniform
from ppmc.compile_cache import njit

FREE = -1
OUTSIDE = -2
# Cells of platelets that stand on edge are taken, but do not make a neighbour in the layer incomplete.
ON_EDGE = -3

COMPLETE, INCOMPLETE, CUT_BY_WALL = 0, 1, 2

DRAWS_OF_AN_ANGLE = 32
TABLE = 180
# Extents beyond a wall that differ by less, mm, are equal.
EQUAL = 1e-6
# Overhang is summed over a grid of points on the rectangle by the trapezoidal rule; edges and corners are on it, so
# that it is zero for rectangles inside, and for these alone.
GRID = 17


@njit
def overhang(owner, dx, dy, j0, i0, length, width, cosine, sine, enough):  # type: ignore[no-untyped-def]
    """Return the share of a rectangle round cell (j0, i0) that lies outside the layer; what is found once > enough."""
    ny, nx = owner.shape
    out = 0.0
    for a in range(GRID):
        u = length * (a / (GRID - 1) - 0.5)
        column = 0.5 if a in (0, GRID - 1) else 1.0
        for b in range(GRID):
            v = width * (b / (GRID - 1) - 0.5)
            # The tiny shrink keeps a rectangle that just touches a wall inside it.
            i = math.floor(i0 + 0.5 + (u * cosine - v * sine) * (1.0 - 1e-9) / dx)
            j = math.floor(j0 + 0.5 + (u * sine + v * cosine) * (1.0 - 1e-9) / dy)
            if i < 0 or j < 0 or i >= nx or j >= ny or owner[j, i] == OUTSIDE:
                out += column * (0.5 if b in (0, GRID - 1) else 1.0)
        if out > enough * (GRID - 1) ** 2:
            break
    return out / (GRID - 1) ** 2


@njit
def extent_beyond(beyond, pad, dx, dy, j0, i0, length, width, cosine, sine):  # type: ignore[no-untyped-def]
    """Return how far a rectangle round cell (j0, i0) extends beyond the walls, mm; zero or less if it does not.

    `beyond` is the signed distance from the layer, positive outside, at the cells of a grid that is wider than the
    layer by `pad` cells on all sides; it is interpolated linearly.
    """
    farthest = -math.inf
    for a in range(GRID):
        u = length * (a / (GRID - 1) - 0.5)
        # The rim alone: no inner point is farther out.
        for b in range(0, GRID, 1 if a in (0, GRID - 1) else GRID - 1):
            v = width * (b / (GRID - 1) - 0.5)
            x, y = pad + i0 + (u * cosine - v * sine) / dx, pad + j0 + (u * sine + v * cosine) / dy
            i, j = math.floor(x), math.floor(y)
            s, t = x - i, y - j
            low = (1.0 - s) * beyond[j, i] + s * beyond[j, i + 1]
            high = (1.0 - s) * beyond[j + 1, i] + s * beyond[j + 1, i + 1]
            farthest = max(farthest, (1.0 - t) * low + t * high)
    return farthest


@njit
def angle_at_wall(owner, beyond, pad, dx, dy, j0, i0, length, width, softness, state):  # type: ignore[no-untyped-def]
    """Return an angle drawn, degree by degree, from those that walls allow; if there are none, that extend least."""
    cost = np.empty(TABLE)
    least = math.inf
    for k in range(TABLE):
        cosine, sine = math.cos(k * math.pi / TABLE), math.sin(k * math.pi / TABLE)
        if overhang(owner, dx, dy, j0, i0, length, width, cosine, sine, softness) <= softness:
            cost[k] = 0.0
        else:
            cost[k] = max(extent_beyond(beyond, pad, dx, dy, j0, i0, length, width, cosine, sine), 2.0 * EQUAL)
        least = min(least, cost[k])
    allowed = 0
    for k in range(TABLE):
        if cost[k] <= least + EQUAL:
            allowed += 1
    chosen = next_below(state, allowed)
    for k in range(TABLE):
        if cost[k] <= least + EQUAL:
            if chosen == 0:
                return k * math.pi / TABLE
            chosen -= 1
    return 0.0


@njit
def collect_cells(owner, dx, dy, j0, i0, length, width, cosine, sine, cells):  # type: ignore[no-untyped-def]
    """Write the free cells of a rectangle to `cells`; return their number and whether other platelets hold some."""
    ny, nx = owner.shape
    half_x = 0.5 * (length * abs(cosine) + width * abs(sine))
    half_y = 0.5 * (length * abs(sine) + width * abs(cosine))
    reach_i, reach_j = int(half_x / dx) + 1, int(half_y / dy) + 1
    found, blocked = 0, False
    for j in range(max(0, j0 - reach_j), min(ny, j0 + reach_j + 1)):
        for i in range(max(0, i0 - reach_i), min(nx, i0 + reach_i + 1)):
            x, y = (i - i0) * dx, (j - j0) * dy
            if abs(x * cosine + y * sine) > 0.5 * length or abs(y * cosine - x * sine) > 0.5 * width:
                continue
            if owner[j, i] == FREE:
                cells[found] = j * nx + i
                found += 1
            elif owner[j, i] >= 0:
                blocked = True
    # A platelet narrower than the lattice still holds the cell it began at.
    if found == 0:
        cells[0] = j0 * nx + i0
        found = 1
    return found, blocked


@njit
def fill_layer(owner, beyond, pad, dx, dy, lengths, widths, softness, attempts, first_id, state):  # type: ignore[no-untyped-def]
    """Fill a layer with platelets.

    Parameters
    ----------
    owner : ndarray, shape (ny, nx), int64
        FREE, OUTSIDE, ON_EDGE, or a platelet's id; free cells are filled in.
    beyond : ndarray, shape (ny + 2 pad, nx + 2 pad)
        Signed distance from the layer, positive outside of it, at the cells of a wider grid, mm.
    pad : int
        How many cells that grid is wider on each side; more than half a platelet's diagonal.
    dx, dy : float
        Cell edges.
    lengths, widths : ndarray, shape (m,)
        Sizes in the order in which platelets are placed; m at least the number of free cells.
    softness : float
        Share of a platelet that walls may cut off; beyond it, an angle is not allowed.
    attempts : int
        Failures in a row after which incomplete platelets are allowed.
    first_id : int
        Id of the first platelet.
    state : ndarray, shape (1,), uint64
        Random state.

    Returns
    -------
    angles : ndarray, shape (k,)
        Fibre angle of each platelet from x1, radians.
    kinds : ndarray, shape (k,), int8
        COMPLETE, CUT_BY_WALL or INCOMPLETE.

    Notes
    -----
    A platelet keeps its size until it finds a place; drawing a new size at each failure would favour small ones.
    """
    ny, nx = owner.shape
    free = np.empty(ny * nx, np.int64)
    place = np.empty(ny * nx, np.int64)
    left = 0
    for c in range(ny * nx):
        if owner[c // nx, c % nx] == FREE:
            free[left], place[c] = c, left
            left += 1
    angles = np.empty(left)
    kinds = np.empty(left, np.int8)
    longest = math.sqrt(lengths.max() ** 2 + widths.max() ** 2)
    cells = np.empty((int(longest / dx) + 4) * (int(longest / dy) + 4), np.int64)
    made, failures, incomplete = 0, 0, False
    while left > 0:
        c = free[next_below(state, left)]
        j0, i0 = c // nx, c % nx
        length, width = lengths[made], widths[made]
        angle, share = 0.0, 0.0
        near_wall = -beyond[pad + j0, pad + i0] < 0.5 * math.sqrt(length**2 + width**2) + EQUAL
        fits = False
        for _ in range(DRAWS_OF_AN_ANGLE if near_wall else 1):
            angle = next_uniform(state) * math.pi
            if near_wall:
                share = overhang(owner, dx, dy, j0, i0, length, width, math.cos(angle), math.sin(angle), softness)
            if share <= softness:
                fits = True
                break
        if not fits:
            if not incomplete:
                failures += 1
                incomplete = failures > attempts
                continue
            angle = angle_at_wall(owner, beyond, pad, dx, dy, j0, i0, length, width, softness, state)
            share = overhang(owner, dx, dy, j0, i0, length, width, math.cos(angle), math.sin(angle), 0.0)
        found, blocked = collect_cells(owner, dx, dy, j0, i0, length, width, math.cos(angle), math.sin(angle), cells)
        if blocked and not incomplete:
            failures += 1
            incomplete = failures > attempts
            continue
        failures = 0
        for k in range(found):
            c = cells[k]
            owner[c // nx, c % nx] = first_id + made
            left -= 1
            free[place[c]] = free[left]
            place[free[left]] = place[c]
        angles[made] = angle
        kinds[made] = INCOMPLETE if blocked else (CUT_BY_WALL if share > 0.0 else COMPLETE)
        made += 1
    return angles[:made], kinds[:made]
