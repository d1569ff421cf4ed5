"""Kernels of the region averages: sort points into cells, then sum moments region by region.

Layout of a region's sums: 0 count, 1 Σw, 2 Σw², 3:6 Σw x, then for p: 6 Σw of points with a known p, 7:13 second order
(XX, YY, ZZ, XY, YZ, XZ), 13:28 fourth order (`averages.FOURTH`); then the same 22
numbers for r from 28; 50 is the sum over platelets of (Σw of the platelet)², zero where platelets are not known.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit, prange

N_SUMS = 51
POINTS_PER_CELL = 12
MOST_CELLS = 2_000_000
PARALLEL_FROM = 200_000
MOST_PLATELETS = 200_000  # beyond that the tally a region would cost more than the sums

Array = NDArray[Any]


@njit
def _cells_of(positions: Array, low: Array, inverse: Array, shape: Array) -> Array:
    cells = np.empty(positions.shape[0], dtype=np.int64)
    for i in range(positions.shape[0]):
        c = 0
        for d in range(3):
            k = int((positions[i, d] - low[d]) * inverse[d])
            k = min(max(k, 0), shape[d] - 1)
            c = c * shape[d] + k
        cells[i] = c
    return cells


@njit
def _counting_sort(cells: Array, n_cells: int) -> tuple[Array, Array]:
    start = np.zeros(n_cells + 1, dtype=np.int64)
    for c in cells:
        start[c + 1] += 1
    for c in range(n_cells):
        start[c + 1] += start[c]
    fill = start[:-1].copy()
    order = np.empty(cells.shape[0], dtype=np.int64)
    for i in range(cells.shape[0]):
        order[fill[cells[i]]] = i
        fill[cells[i]] += 1
    return start, order


@njit
def _gather(order: Array, positions: Array, volume: Array, p: Array, r: Array) -> Array:
    """Return rows (x, y, z, w, p, r) in cell order; unknown directions become zero vectors."""
    n = order.shape[0]
    rows = np.zeros((n, 10))
    for k in range(n):
        i = order[k]
        for d in range(3):
            rows[k, d] = positions[i, d]
        rows[k, 3] = volume[i]
        if p.shape[0] > 0:
            s = p[i, 0] * p[i, 0] + p[i, 1] * p[i, 1] + p[i, 2] * p[i, 2]
            if s > 0.25 and s < 4.0:
                for d in range(3):
                    rows[k, 4 + d] = p[i, d]
        if r.shape[0] > 0:
            s = r[i, 0] * r[i, 0] + r[i, 1] * r[i, 1] + r[i, 2] * r[i, 2]
            if s > 0.25 and s < 4.0:
                for d in range(3):
                    rows[k, 7 + d] = r[i, d]
    return rows


@njit
def _inside(kind: int, u: float, v: float, w: float, low: Array, high: Array) -> bool:
    if kind == 0:
        return low[0] <= u < high[0] and low[1] <= v < high[1] and low[2] <= w < high[2]
    if kind == 2:
        radius = np.sqrt(u * u + v * v + w * w)
        return low[0] <= radius < high[0]
    if not (low[2] <= w < high[2]):
        return False
    radius = np.hypot(u, v)
    if not (low[0] <= radius < high[0]):
        return False
    span = high[1] - low[1]
    if span >= 2.0 * np.pi - 1e-12:
        return True
    angle = (np.arctan2(v, u) - low[1]) % (2.0 * np.pi)
    return angle < span


@njit
def _add_moments(s: Array, at: int, w: float, x: float, y: float, z: float) -> None:
    xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
    s[at] += w
    s[at + 1] += w * xx
    s[at + 2] += w * yy
    s[at + 3] += w * zz
    s[at + 4] += w * xy
    s[at + 5] += w * yz
    s[at + 6] += w * xz
    s[at + 7] += w * xx * xx
    s[at + 8] += w * xx * xy
    s[at + 9] += w * xx * xz
    s[at + 10] += w * xx * yy
    s[at + 11] += w * xx * yz
    s[at + 12] += w * xx * zz
    s[at + 13] += w * xy * yy
    s[at + 14] += w * xy * yz
    s[at + 15] += w * xy * zz
    s[at + 16] += w * xz * zz
    s[at + 17] += w * yy * yy
    s[at + 18] += w * yy * yz
    s[at + 19] += w * yy * zz
    s[at + 20] += w * yz * zz
    s[at + 21] += w * zz * zz


@njit
def _sum_region(
    rows: Array,
    platelet: Array,
    n_platelets: int,
    start: Array,
    low: Array,
    inverse: Array,
    shape: Array,
    kind: int,
    origin: Array,
    axes: Array,
    lower: Array,
    upper: Array,
    box: Array,
) -> Array:
    """Return the sums of one region, shape (N_SUMS,), in the fixed order of the cells."""
    s = np.zeros(N_SUMS)
    share = np.zeros(n_platelets)
    first = np.zeros(3, dtype=np.int64)
    last = np.zeros(3, dtype=np.int64)
    for d in range(3):
        # Compare as floats first: an infinite bound has no integer.
        a = (box[0, d] - low[d]) * inverse[d]
        b = (box[1, d] - low[d]) * inverse[d]
        first[d] = int(min(max(a - 1e-6, 0.0), shape[d] - 1.0))
        last[d] = int(min(max(b + 1e-6, -1.0), shape[d] - 1.0)) if b >= -1e-6 else -1
        if a - 1e-6 >= shape[d]:
            # Beyond the last cell; points on the grid's upper face are clamped into it, so allow the round-off.
            last[d] = -1
    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            row = (i * shape[1] + j) * shape[2]
            for k in range(start[row + first[2]], start[row + last[2] + 1] if last[2] >= first[2] else 0):
                x = rows[k, 0] - origin[0]
                y = rows[k, 1] - origin[1]
                z = rows[k, 2] - origin[2]
                u = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
                v = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
                t = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
                if not _inside(kind, u, v, t, lower, upper):
                    continue
                w = rows[k, 3]
                s[0] += 1.0
                s[1] += w
                s[2] += w * w
                if n_platelets > 0:
                    share[platelet[k]] += w
                s[3] += w * rows[k, 0]
                s[4] += w * rows[k, 1]
                s[5] += w * rows[k, 2]
                if rows[k, 4] != 0.0 or rows[k, 5] != 0.0 or rows[k, 6] != 0.0:
                    _add_moments(s, 6, w, rows[k, 4], rows[k, 5], rows[k, 6])
                if rows[k, 7] != 0.0 or rows[k, 8] != 0.0 or rows[k, 9] != 0.0:
                    _add_moments(s, 28, w, rows[k, 7], rows[k, 8], rows[k, 9])
    for c in range(n_platelets):
        s[50] += share[c] * share[c]
    return s


@njit(parallel=True)
def _sum_regions_in_parallel(
    rows: Array,
    platelet: Array,
    n_platelets: int,
    start: Array,
    low: Array,
    inverse: Array,
    shape: Array,
    kinds: Array,
    origins: Array,
    axes: Array,
    lower: Array,
    upper: Array,
    boxes: Array,
) -> Array:
    """Return sums (m, N_SUMS); each region is owned by one thread, so the order of summation is fixed."""
    sums = np.zeros((kinds.shape[0], N_SUMS))
    for g in prange(kinds.shape[0]):
        sums[g] = _sum_region(
            rows, platelet, n_platelets, start, low, inverse, shape,
            kinds[g], origins[g], axes[g], lower[g], upper[g], boxes[g],
        )  # fmt: skip
    return sums


def sum_regions(binned: tuple[Any, ...], packed: tuple[Array, ...]) -> Array:
    """Return the sums of every region, shape (m, N_SUMS).

    Parameters
    ----------
    binned : tuple
        From `bin_points`.
    packed : tuple
        From `regions.pack`.

    Notes
    -----
    Few points are summed by one thread: the parallel loop takes seconds to compile. Both ways give the same bits.
    """
    if len(binned[0]) > PARALLEL_FROM:
        return np.asarray(_sum_regions_in_parallel(*binned, *packed))
    sums = [_sum_region(*binned, *region) for region in zip(*packed, strict=True)]
    return np.array(sums).reshape(-1, N_SUMS)


@njit
def _sum_owned(rows: Array, owner: Array, sums: Array) -> None:
    for k in range(rows.shape[0]):
        s, w = sums[owner[k]], rows[k, 3]
        s[0] += 1.0
        s[1] += w
        s[2] += w * w
        for d in range(3):
            s[3 + d] += w * rows[k, d]
        if rows[k, 4] != 0.0 or rows[k, 5] != 0.0 or rows[k, 6] != 0.0:
            _add_moments(s, 6, w, rows[k, 4], rows[k, 5], rows[k, 6])
        if rows[k, 7] != 0.0 or rows[k, 8] != 0.0 or rows[k, 9] != 0.0:
            _add_moments(s, 28, w, rows[k, 7], rows[k, 8], rows[k, 9])


def sum_owned(
    positions: np.ndarray,
    volume: np.ndarray,
    fibre_direction: np.ndarray | None,
    platelet_normal: np.ndarray | None,
    owner: np.ndarray,
    count: int,
) -> Array:
    """Return the sums of each of `count` owners, shape (count, N_SUMS), where point k belongs to ``owner[k]``.

    Platelets are not told apart (entry 50 stays zero).
    """
    order = np.arange(len(positions))
    rows = _gather(order, positions.astype(float), volume.astype(float), *_directions(fibre_direction, platelet_normal))
    sums = np.zeros((count, N_SUMS))
    _sum_owned(rows, np.asarray(owner, dtype=np.int64), sums)
    return sums


def bin_points(
    positions: np.ndarray,
    volume: np.ndarray,
    fibre_direction: np.ndarray | None,
    platelet_normal: np.ndarray | None,
    platelet_id: np.ndarray | None = None,
) -> tuple[Any, ...]:
    """Sort points into a grid of cells.

    Returns
    -------
    rows : ndarray, shape (n, 10)
        Position, volume, p, r in cell order.
    platelet : ndarray, shape (n,) or (0,)
        Platelets numbered from zero, in cell order; points of none are platelets of their own.
    n_platelets : int
        How many; zero where they are not known.
    start : ndarray
        First row of each cell (C order) and one past the last.
    low, inverse, shape : ndarray, shape (3,)
        Lowest corner (mm), cells per mm, number of cells.
    """
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    low, high = positions.min(axis=0), positions.max(axis=0)
    extent = np.maximum(high - low, 1e-9 * max(1.0, float(np.abs(high).max())))
    flat = extent < 1e-6 * extent.max()
    wanted = min(max(len(positions) // POINTS_PER_CELL, 1), MOST_CELLS)
    solid = extent[~flat]
    size = (np.prod(solid) / wanted) ** (1.0 / len(solid))
    shape = np.where(flat, 1, np.clip(np.ceil(extent / size), 1, 1000)).astype(np.int64)
    inverse = shape / extent
    cells = _cells_of(positions, low, inverse, shape)
    start, order = _counting_sort(cells, int(np.prod(shape)))
    p, r = _directions(fibre_direction, platelet_normal)
    rows = _gather(order, positions, np.ascontiguousarray(volume, dtype=np.float64), p, r)
    platelet, n_platelets = _numbered(platelet_id, order)
    return rows, platelet, n_platelets, start, low, inverse, shape


def _directions(
    fibre_direction: np.ndarray | None, platelet_normal: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return both as contiguous arrays, empty where not known, as kernels take them."""
    none = np.empty((0, 3))
    p = none if fibre_direction is None else np.ascontiguousarray(fibre_direction, dtype=np.float64)
    r = none if platelet_normal is None else np.ascontiguousarray(platelet_normal, dtype=np.float64)
    return p, r


def _numbered(platelet_id: np.ndarray | None, order: np.ndarray) -> tuple[np.ndarray, int]:
    if platelet_id is None or not (platelet_id >= 0).any():
        return np.empty(0, dtype=np.int64), 0
    ids = platelet_id.astype(np.int64)
    none = ids < 0
    if none.any():
        ids = np.where(none, ids.max() + 1 + np.arange(len(ids)), ids)
    names, numbers = np.unique(ids, return_inverse=True)
    if len(names) > MOST_PLATELETS:
        return np.empty(0, dtype=np.int64), 0
    return numbers.reshape(-1)[order].astype(np.int64), len(names)
