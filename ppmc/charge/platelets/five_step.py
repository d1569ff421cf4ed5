"""The papers' five steps: fill one layer of a charge with randomly placed platelets (A, section 4).

1. Begin at a randomly chosen cell that no platelet holds.
2. Draw an angle; near a wall, only angles at which no more cells of the rectangle lie beyond it than allowed. Next to a
   wall there may be none: the angles are then limited to those at which the rectangle extends least far beyond it.
3. Find the cells whose centres lie in the length x width rectangle round that cell.
4. If all of them are free, they become a platelet. Otherwise start over.
5. After many failures in a row, incomplete platelets are allowed: they take the free cells of their rectangle.
"""

from __future__ import annotations

import math

import numpy as np

from ppmc.charge.platelets.random_numbers import next_below, next_uniform
from ppmc.compile_cache import njit

FREE = -1
OUTSIDE = -2
# Cells of platelets that stand on edge are taken, but do not make a neighbour in the layer incomplete.
ON_EDGE = -3

COMPLETE, INCOMPLETE, CUT_BY_WALL = 0, 1, 2

DRAWS_OF_AN_ANGLE = 32
TABLE = 180
# Lengths that differ by less, mm, are equal.
EQUAL = 1e-6
# Points along each side of a rectangle at which its distance from walls is looked up.
POINTS = 17


@njit
def cells_in_row(y, length, width, cosine, sine, dx):  # type: ignore[no-untyped-def]
    """Return the first and last cell, counted from the middle one, with centres in a rectangle; y mm off its middle."""
    low, high = -math.inf, math.inf
    for half, per_x, offset in ((0.5 * length, cosine, y * sine), (0.5 * width, -sine, y * cosine)):
        if abs(per_x) < 1e-12:
            if abs(offset) > half + EQUAL:
                return 1, 0
        else:
            one, other = (-half - EQUAL - offset) / per_x, (half + EQUAL - offset) / per_x
            low, high = max(low, min(one, other)), min(high, max(one, other))
    return math.ceil(low / dx), math.floor(high / dx)


@njit
def rows_above(length, width, cosine, sine, dy):  # type: ignore[no-untyped-def]
    """Return how many rows a rectangle reaches to either side of its middle."""
    return int((0.5 * (length * abs(sine) + width * abs(cosine)) + EQUAL) / dy)


@njit
def overhang(owner, dx, dy, j0, i0, length, width, cosine, sine):  # type: ignore[no-untyped-def]
    """Return the share of the cells in a rectangle round cell (j0, i0) that lie outside the layer."""
    ny, nx = owner.shape
    reach = rows_above(length, width, cosine, sine, dy)
    total, outside = 0, 0
    for j in range(j0 - reach, j0 + reach + 1):
        first, last = cells_in_row((j - j0) * dy, length, width, cosine, sine, dx)
        if last < first:
            continue
        total += last - first + 1
        if j < 0 or j >= ny:
            outside += last - first + 1
            continue
        start, stop = max(0, i0 + first), min(nx, i0 + last + 1)
        outside += last - first + 1 - max(0, stop - start)
        for i in range(start, stop):
            if owner[j, i] == OUTSIDE:
                outside += 1
    return outside / total


@njit
def taken_at_any_angle(owner, dx, dy, j0, i0, width):  # type: ignore[no-untyped-def]
    """Return whether a platelet holds a cell of the circle that fits into a rectangle of this width at any angle."""
    ny, nx = owner.shape
    half = 0.5 * width
    rows = int(half / dy)
    for j in range(max(0, j0 - rows), min(ny, j0 + rows + 1)):
        reach = int(math.sqrt(max(half**2 - ((j - j0) * dy) ** 2, 0.0)) / dx)
        for i in range(max(0, i0 - reach), min(nx, i0 + reach + 1)):
            if owner[j, i] >= 0:
                return True
    return False


@njit
def extent_beyond(beyond, pad, dx, dy, j0, i0, length, width, cosine, sine):  # type: ignore[no-untyped-def]
    """Return how far a rectangle round cell (j0, i0) extends beyond the walls, mm; zero or less if it does not.

    `beyond` is the signed distance from the layer, positive outside, at the cells of a grid that is wider than the
    layer by `pad` cells on all sides; it is interpolated linearly.
    """
    farthest = -math.inf
    for a in range(POINTS):
        u = length * (a / (POINTS - 1) - 0.5)
        # The rim alone: no inner point is farther out.
        for b in range(0, POINTS, 1 if a in (0, POINTS - 1) else POINTS - 1):
            v = width * (b / (POINTS - 1) - 0.5)
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
        if overhang(owner, dx, dy, j0, i0, length, width, cosine, sine) <= softness:
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
    reach = rows_above(length, width, cosine, sine, dy)
    found, blocked = 0, False
    for j in range(max(0, j0 - reach), min(ny, j0 + reach + 1)):
        first, last = cells_in_row((j - j0) * dy, length, width, cosine, sine, dx)
        for i in range(max(0, i0 + first), min(nx, i0 + last + 1)):
            if owner[j, i] == FREE:
                cells[found] = j * nx + i
                found += 1
            elif owner[j, i] >= 0:
                blocked = True
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
        Share of a platelet's cells that walls may cut off; beyond it, an angle is not allowed.
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
        if not incomplete and taken_at_any_angle(owner, dx, dy, j0, i0, min(length, width)):
            failures += 1
            incomplete = failures > attempts
            continue
        angle, share = 0.0, 0.0
        near_wall = -beyond[pad + j0, pad + i0] < 0.5 * math.sqrt(length**2 + width**2) + EQUAL
        fits = False
        for _ in range(DRAWS_OF_AN_ANGLE if near_wall else 1):
            angle = next_uniform(state) * math.pi
            if near_wall:
                share = overhang(owner, dx, dy, j0, i0, length, width, math.cos(angle), math.sin(angle))
            if share <= softness:
                fits = True
                break
        if not fits:
            angle = angle_at_wall(owner, beyond, pad, dx, dy, j0, i0, length, width, softness, state)
            share = overhang(owner, dx, dy, j0, i0, length, width, math.cos(angle), math.sin(angle))
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
