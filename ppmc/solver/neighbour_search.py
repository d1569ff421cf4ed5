"""Search of a cell grid for all particles within a radius.

Cell by cell, everything that can be near its particles is copied side by side, so that the loops over it are long and
plain; each particle then takes its neighbours from that. Rows depend on the particles alone: cells are visited in one
order, and particles inside a cell ascend. Distances are taken in single precision from the middle of the cell, twice
as many at a time, which moves the edge of the list by less than its skin by far.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.cells import Cells

CHUNK = 64  # particles that share their buffers
EDGE = 5e-5  # of a distance, by which single precision may be wrong
SPARE = 50  # of an array's length, added in case a later list is longer


def find_neighbours(
    cells: Cells, radius: float, box: np.ndarray, cutoff: float, inverse_shape: np.ndarray,
    room: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Rows of all particles nearer than `cutoff`, and perhaps of a few beyond it by less than a thousandth.

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
        Metric of each particle; that of a pair is the mean of both.
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
    metric = _in_places(inverse_shape, cells)
    arguments = (
        metric, cells.order, cells.cell, cells.points, cells.first, cells.shape, cells.edge, radius,
        box[cells.axes], np.float32((cutoff * (1.0 + EDGE)) ** 2),
    )  # fmt: skip
    counts, start = np.empty(n, dtype=np.int64), np.zeros(n + 1, dtype=np.int64)
    _list(*arguments, False, start, np.empty(0, dtype=np.int32), counts)
    np.cumsum(counts, out=start[1:])
    index = room_for(int(start[-1]), np.int32, room)
    _list(*arguments, True, start, index, counts)
    return start, index


def room_for(count: int, dtype: type, last: np.ndarray | None) -> np.ndarray:
    """Return `count` values, not set, in the room of an array made here before if it has enough.

    Lists are most of what a run holds, and fresh memory costs as much time as filling it; a little is added so that
    the next list may be longer.
    """
    room = None if last is None else last.base
    if not isinstance(room, np.ndarray) or len(room) < count:
        room = np.empty(count + count // SPARE, dtype=dtype)
    return room[:count]


def _in_places(metric: np.ndarray, cells: Cells) -> np.ndarray:
    """Half of XX, YY, ZZ, then XY, YZ, XZ of tensors along the axes as the cells count them; (6, n), by places."""
    axes = cells.axes
    place = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])[np.ix_(axes, axes)]
    out = np.empty((6, len(metric)), dtype=np.float32)
    if len(metric) > 0:
        _take_components(metric, cells.order, place[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]], out)
    return out


@njit(cache=True, parallel=True)
def _take_components(metric, order, component, out):
    for slot in prange(order.shape[0]):
        for c in range(6):
            out[c, slot] = (0.5 if c < 3 else 1.0) * metric[order[slot], component[c]]


@njit(cache=True)
def _runs_near(home, first, shape, edge, box, runs):
    """Write first and last places of the runs of cells that reach within `box` of a home cell; count both."""
    nx, ny, nz = shape[0], shape[1], shape[2]
    cx, cy, cz = home % nx, (home // nx) % ny, home // (nx * ny)
    reach_x, reach_y, reach_z = _reach_of(box[0], edge[0]), _reach_of(box[1], edge[1]), _reach_of(box[2], edge[2])
    count, places = 0, 0
    for kz in range(max(cz - reach_z, 0), min(cz + reach_z + 1, nz)):
        for ky in range(max(cy - reach_y, 0), min(cy + reach_y + 1, ny)):
            row = (kz * ny + ky) * nx
            begin, end = first[row + max(cx - reach_x, 0)], first[row + min(cx + reach_x + 1, nx)]
            if end > begin:
                runs[count, 0], runs[count, 1] = begin, end
                count += 1
                places += end - begin
    return count, places


@njit(cache=True)
def _reach_of(radius, edge):
    """Whole cells that a radius may reach beyond the home cell, whatever the rounding."""
    return int(radius / edge + 1.0 - 1e-6)


@njit(cache=True)
def _middle(p):
    low, high = p[0], p[0]
    for k in range(p.shape[0]):
        low, high = min(low, p[k]), max(high, p[k])
    return 0.5 * (low + high), 0.5 * (high - low)


@njit(cache=True)
def _box_distances(px, py, pz, x, y, z, half_x, half_y, half_z, box, distance2):
    more = 1.0 + EDGE
    box_x, box_y, box_z = more * box[0], more * box[1], more * box[2]
    for k in range(px.shape[0]):
        dx, dy, dz = abs(px[k] - x) - half_x, abs(py[k] - y) - half_y, abs(pz[k] - z) - half_z
        dx, dy, dz = dx if dx > 0.0 else 0.0, dy if dy > 0.0 else 0.0, dz if dz > 0.0 else 0.0
        squared = dx * dx + dy * dy + dz * dz
        squared = squared if dx < box_x else np.inf
        squared = squared if dy < box_y else np.inf
        distance2[k] = squared if dz < box_z else np.inf


@njit(cache=True)
def _places_within(distance2, limit2, base, places):
    # Every place is written, and overwritten by the next one if it was too far: a loop without branches flows.
    count = 0
    for k in range(distance2.shape[0]):
        places[count] = base + k
        count += 1 if distance2[k] < limit2 else 0
    return count


@njit(cache=True)
def _places_near(runs, begin, end, points, radius, box, distance2, places):
    """Write the places within `radius`, and `box` along the axes, of the box around the particles `begin` to `end`.

    Return how many, and the middle of that box.
    """
    px, py, pz = points[0], points[1], points[2]
    x, half_x = _middle(px[begin:end])
    y, half_y = _middle(py[begin:end])
    z, half_z = _middle(pz[begin:end])
    limit2, count = (radius * (1.0 + EDGE)) ** 2, 0
    for r in range(runs.shape[0]):
        a, b = runs[r, 0], runs[r, 1]
        _box_distances(px[a:b], py[a:b], pz[a:b], x, y, z, half_x, half_y, half_z, box, distance2)
        count += _places_within(distance2[: b - a], limit2, a, places[count:])
    return count, x, y, z


@njit(cache=True)
def _distances(px, py, pz, x, y, z, distance2):
    for k in range(px.shape[0]):
        dx, dy, dz = px[k] - x, py[k] - y, pz[k] - z
        distance2[k] = dx * dx + dy * dy + dz * dz


@njit(cache=True)
def _metric_distances(px, py, pz, xx, yy, zz, xy, yz, xz, x, y, z, a, b, c, d, e, f, distance2):
    # One array a component, each known to be contiguous, or the loop does not vectorise.
    for k in range(px.shape[0]):
        dx, dy, dz = px[k] - x, py[k] - y, pz[k] - z
        distance2[k] = (
            (a + xx[k]) * (dx * dx)
            + (b + yy[k]) * (dy * dy)
            + (c + zz[k]) * (dz * dz)
            + (d + xy[k]) * (dx * dy)
            + (e + yz[k]) * (dy * dz)
            + (f + xz[k]) * (dx * dz)
        )


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
def _list(g, order, cell, points, first, shape, edge, radius, box, cutoff2, fill, start, index, counts):
    n = order.shape[0]
    sphere = g.shape[1] == 0
    most_runs = (2 * _reach_of(box[1], edge[1]) + 1) * (2 * _reach_of(box[2], edge[2]) + 1)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        runs = np.empty((most_runs, 2), dtype=np.int64)
        room = 0
        near, metric, distance2, away2 = (
            np.empty((3, room), np.float32), np.empty((6, room), np.float32), np.empty(room, np.float32),
            np.empty(room),
        )  # fmt: skip
        name, found = np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32)
        slot, last = chunk * CHUNK, min(n, (chunk + 1) * CHUNK)
        while slot < last:
            home = cell[order[slot]]
            begin, end = slot, first[home + 1]
            slot = end
            if begin > first[home]:
                continue  # the chunk before has this cell
            n_runs, most = _runs_near(home, first, shape, edge, box, runs)
            if most > room:
                room = 2 * most
                near, metric, distance2, away2 = (
                    np.empty((3, room), np.float32), np.empty((6, room), np.float32), np.empty(room, np.float32),
                    np.empty(room),
                )  # fmt: skip
                name, found = np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32)
            # All that can be near the cell's particles, side by side, so that the loops over it are long and plain.
            m, x0, y0, z0 = _places_near(runs[:n_runs], begin, end, points, radius, box, away2, found)
            own = 0
            for k in range(m):
                place = found[k]
                own = k if place == begin else own
                name[k] = order[place]
                near[0, k], near[1, k], near[2, k] = points[0, place] - x0, points[1, place] - y0, points[2, place] - z0
            if not sphere:
                for k in range(m):
                    place = np.uint32(found[k])
                    metric[0, k], metric[1, k], metric[2, k] = g[0, place], g[1, place], g[2, place]
                    metric[3, k], metric[4, k], metric[5, k] = g[3, place], g[4, place], g[5, place]
            for place in range(begin, end):
                i = order[place]
                mine = own + place - begin
                x, y, z = near[0, mine], near[1, mine], near[2, mine]
                if sphere:
                    _distances(near[0, :m], near[1, :m], near[2, :m], x, y, z, distance2)
                else:
                    _metric_distances(
                        near[0, :m], near[1, :m], near[2, :m], metric[0, :m], metric[1, :m], metric[2, :m],
                        metric[3, :m], metric[4, :m], metric[5, :m], x, y, z, metric[0, mine], metric[1, mine],
                        metric[2, mine], metric[3, mine], metric[4, mine], metric[5, mine], distance2,
                    )  # fmt: skip
                distance2[mine] = np.inf
                if fill:
                    count = _names_within(distance2[:m], cutoff2, name, found)
                    row = index[start[i] : start[i + 1]]
                    for k in range(count):
                        row[k] = found[k]
                else:
                    counts[i] = _count_within(distance2[:m], cutoff2)
