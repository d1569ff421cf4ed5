"""The papers' five steps: fill one layer of a charge with randomly placed platelets (A, section 4).

1. Begin at a randomly chosen cell that no platelet holds.
2. Draw an angle; near a wall, only angles at which the walls cut off no more than allowed.
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
# Overhang is the share of a 9 x 9 grid of points on the rectangle, corners included, that is outside.
GRID = 9


@njit
def overhang(owner, dx, dy, j0, i0, length, width, cosine, sine):  # type: ignore[no-untyped-def]
    """Return the share of a rectangle round cell (j0, i0) that lies outside the layer."""
    ny, nx = owner.shape
    out = 0
    for a in range(GRID):
        u = length * (a / (GRID - 1) - 0.5)
        for b in range(GRID):
            v = width * (b / (GRID - 1) - 0.5)
            # The tiny shrink keeps a rectangle that just touches a wall inside it.
            i = math.floor(i0 + 0.5 + (u * cosine - v * sine) * (1.0 - 1e-9) / dx)
            j = math.floor(j0 + 0.5 + (u * sine + v * cosine) * (1.0 - 1e-9) / dy)
            if i < 0 or j < 0 or i >= nx or j >= ny or owner[j, i] == OUTSIDE:
                out += 1
    return out / (GRID * GRID)


@njit
def least_overhang_angle(owner, dx, dy, j0, i0, length, width, softness, state):  # type: ignore[no-untyped-def]
    """Return an angle drawn from those, degree by degree, that hang out no more than allowed, or least of all."""
    shares = np.empty(TABLE)
    least = 2.0
    for k in range(TABLE):
        angle = k * math.pi / TABLE
        shares[k] = overhang(owner, dx, dy, j0, i0, length, width, math.cos(angle), math.sin(angle))
        least = min(least, shares[k])
    bound = max(least, softness) + 1e-12
    allowed = 0
    for k in range(TABLE):
        if shares[k] <= bound:
            allowed += 1
    chosen = next_below(state, allowed)
    for k in range(TABLE):
        if shares[k] <= bound:
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
def fill_layer(owner, clearance, dx, dy, lengths, widths, softness, attempts, first_id, state):  # type: ignore[no-untyped-def]
    """Fill a layer with platelets.

    Parameters
    ----------
    owner : ndarray, shape (ny, nx), int64
        FREE, OUTSIDE, ON_EDGE, or a platelet's id; free cells are filled in.
    clearance : ndarray, shape (ny, nx)
        A distance from each cell within which there is no wall.
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
        near_wall = clearance[j0, i0] < 0.5 * math.sqrt(length**2 + width**2)
        fits = False
        for _ in range(DRAWS_OF_AN_ANGLE if near_wall else 1):
            angle = next_uniform(state) * math.pi
            if near_wall:
                share = overhang(owner, dx, dy, j0, i0, length, width, math.cos(angle), math.sin(angle))
            if share <= softness:
                fits = True
                break
        if not fits:
            if not incomplete:
                failures += 1
                incomplete = failures > attempts
                continue
            angle = least_overhang_angle(owner, dx, dy, j0, i0, length, width, softness, state)
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
