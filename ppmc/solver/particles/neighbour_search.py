"""Search of a cell grid for all particles within a radius.

Cell by cell, everything that can be near its particles is copied side by side, so that the loops over it are long and
plain; each particle then takes its neighbours from that. Rows depend on the particles alone: cells are visited in one
order, and particles inside a cell ascend.

Distances are taken in single precision from the middle of the cell, twice as many at a time. Where that could decide
wrongly, because a distance is as close to the cutoff as rounding can take it, the row is decided in double precision.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.cell_surroundings import places_near, reach_of, runs_near
from ppmc.solver.particles.cells import Cells

CHUNK = 64  # particles that share their buffers
PORTION = 16384  # particles whose rows are found before they are moved to where they belong
SPARE = 50  # of an array's length, added in case a later list is longer
# Largest error of a squared distance in single precision, in parts of the metric's largest entry times the square of
# the length that places are told over. With u = 2^-24, differences of places are wrong by 3 u a component, which makes
# 31 u; and the sum of six terms, no larger than three together, by 10 u from the metric, the products and the sum.
ROUNDING = 64.0 * 2.0**-24


def find_neighbours(
    cells: Cells, radius: float, box: np.ndarray, cutoff: float, inverse_shape: np.ndarray, longest: int = 0,
    room: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Rows of all particles nearer than `cutoff`.

    Parameters
    ----------
    cells : Cells
    radius : float
        Distance beyond which nothing is within the cutoff, whatever the metric, mm.
    box : ndarray, shape (3,)
        The same along each axis, mm.
    cutoff : float
        mm, in the metric.
    inverse_shape : ndarray, shape (n, 6), or (0, 6) for spheres
        Metric of each particle, in which its own row is listed: i may see j where j does not see i.
    longest : int
        Length that rows are likely not to exceed; the search is done twice where one does.
    room : ndarray, optional
        An index that nobody needs any more, to be overwritten.

    Returns
    -------
    start : ndarray, shape (n + 1,), int64
        First slot of each row.
    index : ndarray, shape (pairs,), int32
        Particle numbers, itself left out.
    """
    n = len(cells.order)
    axes, (metric, largest) = cells.axes, _in_places(inverse_shape, cells)
    span = radius + float(cells.edge.max())
    band = np.array([cutoff**2, ROUNDING * largest * span**2])
    counts, start = np.empty(n, dtype=np.int64), np.zeros(n + 1, dtype=np.int64)
    index = room_for(0, np.int32, room)
    # Portion by portion, so that rows are still at hand when it is known where they belong.
    found = np.empty(0, dtype=np.int32)
    for begin, end in _portions(cells):
        while True:
            found = found if len(found) >= (end - begin) * longest else np.empty((end - begin) * longest, np.int32)
            _search(
                metric, inverse_shape, cells.order, cells.cell, cells.points, axes, cells.first, cells.shape,
                cells.edge, radius, box[axes], band, begin, end, longest, found, counts,
            )  # fmt: skip
            most = int(counts[begin:end].max(initial=0))
            if most <= longest:
                break
            longest = most
        np.cumsum(counts[begin:end], out=start[begin + 1 : end + 1])
        start[begin + 1 : end + 1] += start[begin]
        index = _longer(index, int(start[begin]), int(start[end]), n / end)
        _take_rows(cells.order, cells.cell, cells.first, begin, end, longest, found, start, index)
    return start, index[: start[-1]]


def _portions(cells: Cells) -> list[tuple[int, int]]:
    """First and last places of portions of whole cells: one of all where rows do not follow in the order of places."""
    n = len(cells.order)
    if not cells.in_order:
        return [(0, n)]
    begin = np.unique(np.append(cells.first[cells.cell[::PORTION]], n))
    return list(zip(begin[:-1].tolist(), begin[1:].tolist(), strict=True))


def _longer(index: np.ndarray, used: int, needed: int, share: float) -> np.ndarray:
    """Room for the `needed` values of so many portions, in a longer array if need be, with those `used` kept."""
    room = index if index.base is None else index.base
    if len(room) >= needed:
        return room
    longer = np.empty(int(needed * share * (1.0 + 1.0 / SPARE)) + 1, dtype=index.dtype)
    longer[:used] = room[:used]
    return longer


def room_for(count: int, dtype: type, last: np.ndarray | None) -> np.ndarray:
    """Return `count` values, not set, in the room of an array made here before if it has enough.

    Lists are most of what a run holds, and fresh memory costs as much time as filling it; a little is added so that
    the next list may be longer.
    """
    room = None if last is None else last.base
    if not isinstance(room, np.ndarray) or len(room) < count:
        room = np.empty(count + count // SPARE, dtype=dtype)
    return room[:count]


def _in_places(metric: np.ndarray, cells: Cells) -> tuple[np.ndarray, float]:
    """XX, YY, ZZ, then twice XY, YZ, XZ of tensors along the axes as the cells count them, and the largest entry.

    Shape (6, n), by places.
    """
    axes = cells.axes
    place = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])[np.ix_(axes, axes)]
    out = np.empty((6, len(metric)), dtype=np.float32)
    if len(metric) == 0:
        return out, 1.0
    _take_components(metric, cells.order, place[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]], out)
    return out, float(out[:3].max())


@njit(cache=True, parallel=True)
def _take_components(metric, order, component, out):
    for slot in prange(order.shape[0]):
        for c in range(6):
            out[c, slot] = (1.0 if c < 3 else 2.0) * metric[order[slot], component[c]]


@njit(cache=True)
def _distances(px, py, pz, x, y, z, distance2):
    for k in range(px.shape[0]):
        dx, dy, dz = px[k] - x, py[k] - y, pz[k] - z
        distance2[k] = dx * dx + dy * dy + dz * dz


@njit(cache=True)
def _metric_distances(px, py, pz, x, y, z, xx, yy, zz, xy, yz, xz, distance2):
    for k in range(px.shape[0]):
        dx, dy, dz = px[k] - x, py[k] - y, pz[k] - z
        distance2[k] = dx * (xx * dx + xy * dy + xz * dz) + dy * (yy * dy + yz * dz) + zz * dz * dz


@njit(cache=True)
def _names_within(distance2, cutoff2, name, found):
    count = 0
    for k in range(distance2.shape[0]):
        found[count] = name[k]
        count += 1 if distance2[k] < cutoff2 else 0
    return count


@njit(cache=True, fastmath={"reassoc"})
def _count_within(distance2, cutoff2):
    # Counted in the numbers that are compared, or the loop takes fewer at a time; a sum of ones may take any order.
    count = np.float32(0.0)
    for k in range(distance2.shape[0]):
        count += np.float32(1.0) if distance2[k] < cutoff2 else np.float32(0.0)
    return int(count)


@njit(cache=True, parallel=True)
def _search(
    g, exact, order, cell, points, axes, first, shape, edge, radius, box, band, low, high, longest, found, counts
):  # fmt: skip
    """Write the rows of places from `low` to `high`, those of a chunk one after the other.

    They begin at `longest` times the chunk's first place; rows longer than that are counted only.
    """
    sphere = g.shape[1] == 0
    inner2, outer2 = np.float32(band[0] - band[1]), np.float32(band[0] + band[1])
    most_runs = (2 * reach_of(box[1], edge[1]) + 1) * (2 * reach_of(box[2], edge[2]) + 1)
    for chunk in prange((high - low + CHUNK - 1) // CHUNK):
        runs = np.empty((most_runs, 2), dtype=np.int64)
        room = 0
        near, distance2, away2 = np.empty((3, room), np.float32), np.empty(room, np.float32), np.empty(room)
        places, name, row = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.int32)
        slot, last = low + chunk * CHUNK, min(high, low + (chunk + 1) * CHUNK)
        used = np.int64(-1)
        while slot < last:
            home = cell[order[slot]]
            begin, end = slot, first[home + 1]
            slot = end
            if begin > first[home]:
                continue  # the chunk before has this cell
            if used < 0:
                used = (begin - low) * longest
            n_runs, most = runs_near(home, first, shape, edge, box, runs)
            if most > room:
                room = 2 * most
                near, distance2, away2 = np.empty((3, room), np.float32), np.empty(room, np.float32), np.empty(room)
                places, name, row = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.int32)
            # All that can be near the cell's particles, side by side, so that the loops over it are long and plain.
            m, x0, y0, z0 = places_near(runs[:n_runs], begin, end, points, radius, box, away2, places)
            own = 0
            for k in range(m):
                place = places[k]
                own = k if place == begin else own
                name[k] = order[place]
                near[0, k], near[1, k], near[2, k] = points[0, place] - x0, points[1, place] - y0, points[2, place] - z0
            for place in range(begin, end):
                i = order[place]
                mine = own + place - begin
                x, y, z = near[0, mine], near[1, mine], near[2, mine]
                if sphere:
                    _distances(near[0, :m], near[1, :m], near[2, :m], x, y, z, distance2)
                else:
                    _metric_distances(
                        near[0, :m], near[1, :m], near[2, :m], x, y, z, g[0, place], g[1, place], g[2, place],
                        g[3, place], g[4, place], g[5, place], distance2,
                    )  # fmt: skip
                distance2[mine] = np.inf
                count = _names_within(distance2[:m], outer2, name, row)
                if count != _count_within(distance2[:m], inner2):
                    count = _names_within_exactly(
                        place, points, axes, exact, order, places[:m], distance2[:m], band[0], outer2, row
                    )  # fmt: skip
                counts[i] = count
                if count <= longest:
                    for k in range(count):
                        found[used + k] = row[k]
                    used += count


@njit(cache=True)
def _names_within_exactly(place, points, axes, g, order, places, distance2, cutoff2, outer2, row):
    """Do the same as `_names_within`, with what single precision leaves open decided in double precision."""
    i, count, d = order[place], 0, np.empty(3)
    for k in range(places.shape[0]):
        if not distance2[k] < outer2:
            continue
        j = order[places[k]]
        for c in range(3):
            d[axes[c]] = points[c, places[k]] - points[c, place]
        if g.shape[0] == 0:
            squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        else:
            squared = g[i, 0] * d[0] * d[0] + g[i, 1] * d[1] * d[1] + g[i, 2] * d[2] * d[2]
            squared += 2.0 * (g[i, 3] * d[0] * d[1] + g[i, 4] * d[1] * d[2] + g[i, 5] * d[0] * d[2])
        if squared < cutoff2:
            row[count] = j
            count += 1
    return count


@njit(cache=True, parallel=True)
def _take_rows(order, cell, first, low, high, longest, found, start, index):
    for chunk in prange((high - low + CHUNK - 1) // CHUNK):
        slot, last = low + chunk * CHUNK, min(high, low + (chunk + 1) * CHUNK)
        home = cell[order[slot]]
        slot = slot if first[home] == slot else first[home + 1]  # the chunk before has a cell that it began
        used = (slot - low) * longest
        last = first[cell[order[last - 1]] + 1] if slot < last else slot
        for place in range(slot, last):
            i = order[place]
            row = index[start[i] : start[i + 1]]
            for k in range(row.shape[0]):
                row[k] = found[used + k]
            used += row.shape[0]
