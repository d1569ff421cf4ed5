r"""The material in the cells: sub-points, and to which particle each belongs.

A particle is not a point. Sums over particles as points of quadrature lose half of the force as soon as these stand
irregularly in the cells. Each cell is therefore shared out among the particles in it: a sub-point belongs to the
nearest of them in the metric of its lattice, and a particle's strain is the mean over its share. A cell then has as
many fibre strains as particles, wherever these stand.

A sub-point counts as far as the particles' volumes, spread with a kernel, fill it, wholly in the box of a particle of
the lattice, and not at all in the tools that its particle is near. What the rim of the body holds too much in all is
taken off its weights.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.grid.cells import Grid, make_grid, places
from ppmc.solver.grid.shapes import POINTS, SUB
from ppmc.solver.particles.smoothing import SUPPORT, kernel_value

# Filling at which sub-points begin to count, and from which on they count wholly: a half at a plane surface, where a
# quarter of a spacing inside reads .7 and as far outside .3.
BEGINS, WHOLE = 0.25, 0.75
KERNEL = 1.0  # smoothing length of the filling, in spacings
LEAST_FACTOR = 0.7  # by which weights at the rim are brought down to the particles' volumes
LEANING = 0.5  # cosine of a wall to an axis up to which it closes a cell on that side
BEHIND = -2  # owner of a sub-point in a tool
OUT_OF_TOOL = 1e-9  # of a spacing: round-off in what lies on a wall


@dataclass(frozen=True)
class Body:
    """Shares of particles in cells.

    Attributes
    ----------
    grid : Grid
    cell : ndarray, shape (n,), int64
        Cell in which each particle is.
    share : ndarray, shape (cells, points), int32
        Share to which each sub-point belongs, -1 outside the body.
    weight : ndarray, shape (cells, points)
        Volume of each sub-point in the body, mm^3.
    start : ndarray, shape (cells + 1,), int64
        First share of each cell.
    particle : ndarray, shape (shares,), int64
        Whose they are.
    """

    grid: Grid
    cell: np.ndarray
    share: np.ndarray
    weight: np.ndarray
    start: np.ndarray
    particle: np.ndarray


def make_body(
    lines: tuple[np.ndarray, np.ndarray, np.ndarray], positions: np.ndarray, volumes: np.ndarray,
    inverse_shape: np.ndarray, extents: np.ndarray, spacing: float, near: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> Body:  # fmt: skip
    """Find the cells that hold material, and share them out.

    Parameters
    ----------
    lines
        See :class:`Grid`.
    positions : ndarray, shape (n, 3)
        mm.
    volumes : ndarray, shape (n,)
        Present volumes, mm^3.
    inverse_shape : ndarray, shape (n, 6)
        Metric of each particle's lattice.
    extents : ndarray, shape (n, 3)
        Of its cells along the axes, mm.
    spacing : float
        Mean spacing, mm.
    near : rows (m,), normal (m, k, 3), distance (m, k)
        Particles near tools, and the faces there, mm, infinite for none.
    """
    sites, shape = places(lines, positions), tuple(len(line) - 1 for line in lines)
    around = np.array(list(np.ndindex(3, 3, 3))) - 1
    wanted = np.zeros(shape, dtype=bool)
    for step in around:
        there = sites + step
        inside = np.all((there >= 0) & (there < shape), axis=1)
        wanted[tuple(there[inside].T)] = True
    candidates = np.argwhere(wanted)
    table = np.full(shape, -1, dtype=np.int32)
    table[tuple(candidates.T)] = np.arange(len(candidates))
    axes = [line[:-1, None] + np.diff(line)[:, None] * (np.arange(SUB) + 0.5) / SUB for line in lines]
    filling = np.zeros((len(candidates), POINTS))
    _fill(
        positions, volumes, inverse_shape, SUPPORT * KERNEL * extents, KERNEL * spacing,
        axes[0].ravel(), axes[1].ravel(), axes[2].ravel(), table, filling,
    )  # fmt: skip
    occupied = np.zeros(len(candidates), dtype=bool)
    occupied[table[tuple(sites.T)]] = True
    kept = occupied | (filling.max(axis=1) >= BEGINS)
    grid = make_grid(lines, candidates[kept])
    cell = grid.table[tuple(sites.T)].astype(np.int64)
    order = np.argsort(cell, kind="stable")
    begin = np.searchsorted(cell[order], np.arange(len(grid.site) + 1))
    place = np.full(len(positions), -1, dtype=np.int64)
    place[near[0]] = np.arange(len(near[0]))
    owner, part = np.empty((len(grid.site), POINTS), dtype=np.int64), filling[kept]
    _share_out(
        grid.site, grid.table, grid.low, grid.size, order, begin, positions, inverse_shape, part, place,
        near[1], near[2], extents, spacing, owner,
    )  # fmt: skip
    return _gather(grid, cell, owner, part, volumes, _open_cells(grid, cell, owner, near))


def _open_cells(
    grid: Grid, cell: np.ndarray, owner: np.ndarray, near: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> np.ndarray:
    """Whether each cell is at the rim of the body, shape (cells,): air in it, or no cell beside it and no wall."""
    shape, rows, out = grid.table.shape, near[0], np.any(owner == -1, axis=1)
    for c in range(3):
        for sign in (1, -1):
            beside = grid.site.copy()
            beside[:, c] += sign
            there = (beside[:, c] >= 0) & (beside[:, c] < shape[c])
            beside[:, c] = np.clip(beside[:, c], 0, shape[c] - 1)
            alone = ~there | (grid.table[tuple(beside.T)] < 0)
            faces = np.any((-sign * near[1][:, :, c] > LEANING) & np.isfinite(near[2]), axis=1)
            walled = np.zeros(len(out), dtype=bool)
            walled[cell[rows[faces]]] = True
            out |= alone & ~walled
    return out


def _gather(
    grid: Grid, cell: np.ndarray, owner: np.ndarray, part: np.ndarray, volumes: np.ndarray, open_cells: np.ndarray
) -> Body:
    inside = owner >= 0
    at = np.broadcast_to(np.arange(len(owner))[:, None], owner.shape)[inside]
    keys = at * len(volumes) + owner[inside]
    found, number = np.unique(keys, return_inverse=True)
    share = np.full(owner.shape, -1, dtype=np.int32)
    share[inside] = number
    particle = found % len(volumes)
    start = np.searchsorted(found // len(volumes), np.arange(len(owner) + 1))
    weight = np.where(inside, part * grid.size.prod(axis=1)[:, None] / POINTS, 0.0)
    held = np.bincount(owner[inside], weight[inside], len(volumes))
    # One factor for all of the rim: single shares scatter.
    rim = np.zeros(len(volumes), dtype=bool)
    rim[owner[inside & open_cells[:, None]]] = True
    if rim.any():
        factor = np.clip(float(volumes[rim].sum()) / float(held[rim].sum()), LEAST_FACTOR, 1.0)
        weight[inside & rim[np.maximum(owner, 0)]] *= factor
    return Body(grid, cell, share, weight, start, particle)


@njit(cache=True)
def _fill(x, volume, g, reach, h, axis0, axis1, axis2, table, filling):
    for i in range(x.shape[0]):
        a0, a1 = np.searchsorted(axis0, x[i, 0] - reach[i, 0]), np.searchsorted(axis0, x[i, 0] + reach[i, 0])
        b0, b1 = np.searchsorted(axis1, x[i, 1] - reach[i, 1]), np.searchsorted(axis1, x[i, 1] + reach[i, 1])
        c0, c1 = np.searchsorted(axis2, x[i, 2] - reach[i, 2]), np.searchsorted(axis2, x[i, 2] + reach[i, 2])
        for a in range(a0, a1):
            d0 = axis0[a] - x[i, 0]
            for b in range(b0, b1):
                d1 = axis1[b] - x[i, 1]
                for c in range(c0, c1):
                    cell = table[a // SUB, b // SUB, c // SUB]
                    if cell < 0:
                        continue
                    d2 = axis2[c] - x[i, 2]
                    r2 = (
                        g[i, 0] * d0 * d0 + g[i, 1] * d1 * d1 + g[i, 2] * d2 * d2
                        + 2.0 * (g[i, 3] * d0 * d1 + g[i, 4] * d1 * d2 + g[i, 5] * d0 * d2)
                    )  # fmt: skip
                    point = ((a % SUB) * SUB + b % SUB) * SUB + c % SUB
                    filling[cell, point] += volume[i] * kernel_value(r2, h)


@njit(cache=True, parallel=True)
def _share_out(site, table, low, size, order, begin, x, g, filling, place, normal, distance, extent, spacing, owner):
    for cell in prange(site.shape[0]):
        rows = order[begin[cell] : begin[cell + 1]]
        if len(rows) == 0:
            rows = rows_around(site[cell], table, order, begin)
        for point in range(POINTS):
            owner[cell, point] = -1
            y0 = low[cell, 0] + size[cell, 0] * (point // (SUB * SUB) + 0.5) / SUB
            y1 = low[cell, 1] + size[cell, 1] * (point // SUB % SUB + 0.5) / SUB
            y2 = low[cell, 2] + size[cell, 2] * (point % SUB + 0.5) / SUB
            nearest = nearest_of(rows, x, g, y0, y1, y2)
            part = min(max((filling[cell, point] - BEGINS) / (WHOLE - BEGINS), 0.0), 1.0)
            if part < 1.0 and _in_box(nearest, x, g, extent, spacing, y0, y1, y2):
                part = 1.0
            if part == 0.0:
                nearest = -1
            filling[cell, point] = part
            if nearest >= 0 and place[nearest] >= 0:
                at = place[nearest]
                d0, d1, d2 = y0 - x[nearest, 0], y1 - x[nearest, 1], y2 - x[nearest, 2]
                for k in range(normal.shape[1]):
                    n = normal[at, k]
                    if distance[at, k] + n[0] * d0 + n[1] * d1 + n[2] * d2 < -OUT_OF_TOOL * spacing:
                        nearest = BEHIND
                        break
            owner[cell, point] = nearest


@njit(cache=True)
def _in_box(i, x, g, extent, spacing, y0, y1, y2):
    # What the filling rounds off at the corners of a lattice.
    if i < 0:
        return False
    d0, d1, d2 = y0 - x[i, 0], y1 - x[i, 1], y2 - x[i, 2]
    if 2.0 * abs(d0) > extent[i, 0] or 2.0 * abs(d1) > extent[i, 1] or 2.0 * abs(d2) > extent[i, 2]:
        return False
    r2 = (
        g[i, 0] * d0 * d0 + g[i, 1] * d1 * d1 + g[i, 2] * d2 * d2
        + 2.0 * (g[i, 3] * d0 * d1 + g[i, 4] * d1 * d2 + g[i, 5] * d0 * d2)
    )  # fmt: skip
    return r2 < 0.75 * spacing * spacing  # from the middle of a cube to its corners


@njit(cache=True)
def nearest_of(rows, x, g, y0, y1, y2):
    """Nearest of some particles to a point, each in its own metric; -1 for none."""
    nearest, least = -1, np.inf
    for i in rows:
        d0, d1, d2 = y0 - x[i, 0], y1 - x[i, 1], y2 - x[i, 2]
        r2 = (
            g[i, 0] * d0 * d0 + g[i, 1] * d1 * d1 + g[i, 2] * d2 * d2
            + 2.0 * (g[i, 3] * d0 * d1 + g[i, 4] * d1 * d2 + g[i, 5] * d0 * d2)
        )  # fmt: skip
        if r2 < least:
            nearest, least = i, r2
    return nearest


@njit(cache=True)
def rows_around(here, table, order, begin):
    """Particles of the cells next to one."""
    total = 0
    for turn in range(2):
        if turn == 1:
            out = np.empty(total, np.int64)
            total = 0
        for a in range(max(here[0] - 1, 0), min(here[0] + 2, table.shape[0])):
            for b in range(max(here[1] - 1, 0), min(here[1] + 2, table.shape[1])):
                for c in range(max(here[2] - 1, 0), min(here[2] + 2, table.shape[2])):
                    cell = table[a, b, c]
                    if cell < 0:
                        continue
                    for slot in range(begin[cell], begin[cell + 1]):
                        if turn == 1:
                            out[total] = order[slot]
                        total += 1
    return out
