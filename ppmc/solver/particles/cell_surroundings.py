"""What lies near the particles of a cell: the runs of cells within reach, then the places in these, one by one."""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit


@njit(cache=True)
def runs_near(home, first, shape, edge, box, runs):
    """Write first and last places of the runs of cells that reach within `box` of a home cell; count both."""
    nx, ny, nz = shape[0], shape[1], shape[2]
    cx, cy, cz = home % nx, (home // nx) % ny, home // (nx * ny)
    reach_x, reach_y, reach_z = reach_of(box[0], edge[0]), reach_of(box[1], edge[1]), reach_of(box[2], edge[2])
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
def reach_of(radius, edge):
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
    more = 1.0 + 1e-9  # places and box are in double precision
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
def places_near(runs, begin, end, points, radius, box, distance2, places):
    """Write the places within `radius`, and `box` along the axes, of the box around the particles `begin` to `end`.

    Return how many, and the middle of that box.
    """
    px, py, pz = points[0], points[1], points[2]
    x, half_x = _middle(px[begin:end])
    y, half_y = _middle(py[begin:end])
    z, half_z = _middle(pz[begin:end])
    limit2, count = (radius * (1.0 + 1e-9)) ** 2, 0
    for r in range(runs.shape[0]):
        a, b = runs[r, 0], runs[r, 1]
        _box_distances(px[a:b], py[a:b], pz[a:b], x, y, z, half_x, half_y, half_z, box, distance2)
        count += _places_within(distance2[: b - a], limit2, a, places[count:])
    return count, x, y, z
