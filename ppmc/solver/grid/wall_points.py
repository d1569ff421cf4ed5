r"""Points of contact: where the cells of touching particles end on the walls.

The body reaches to the walls, and so do the grid's functions. Its sub-points next to a wall are shared out among the
particles of the cell that have a face there, and a face that touches holds the mean velocity of its feet on the wall,
:math:`n\cdot(\bar v - v_{wall}) \ge -g/\Delta t`, by a penalty that augmented Lagrangian steps make exact. The feet add
up to the same sums as the body behind them: a uniform pressure is in balance with the walls, function by function,
which single points would not be. Friction acts there as the wall's law has it.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.grid.body import Body, nearest_of, rows_around
from ppmc.solver.grid.recover import at_points
from ppmc.solver.grid.shapes import NODES, POINTS, SUB, sub_points
from ppmc.solver.grid.stiffness import Stiffness
from ppmc.solver.walls.contact import FACES, Contacts
from ppmc.solver.walls.contact import places as places_of


@dataclass(frozen=True)
class WallPoints:
    """Parts of walls that belong to a particle's face in a cell.

    Attributes
    ----------
    row, face : ndarray, shape (c,), int64
        Row and column of each in the arrays of :class:`Contacts`.
    position : ndarray, shape (c, 3)
        mm.
    nodes : ndarray, shape (c, 27), int64
    value : ndarray, shape (c, 27)
        Mean of the grid's functions over its feet.
    normal : ndarray, shape (c, 3)
    target : ndarray, shape (c, 3)
        Velocity that a touching face asks for, the way that is left to it included, mm/s.
    wall : ndarray, shape (c, 3)
        Velocity of the face, mm/s.
    area : ndarray, shape (c,)
        mm^2.
    """

    row: np.ndarray
    face: np.ndarray
    position: np.ndarray
    nodes: np.ndarray
    value: np.ndarray
    normal: np.ndarray
    target: np.ndarray
    wall: np.ndarray
    area: np.ndarray

    def velocities(self, nodal: np.ndarray) -> np.ndarray:
        """Velocities (c, 3) of the body at the points for those of the nodes, mm/s."""
        return np.einsum("ca,cad->cd", self.value, nodal[self.nodes])

    def load(self, force: np.ndarray, nodes: int) -> np.ndarray:
        """Load, shape (nodes, 3), of forces (c, 3) at the points."""
        out = np.zeros((nodes, 3))
        np.add.at(out, self.nodes.ravel(), np.einsum("ca,cd->cad", self.value, force).reshape(-1, 3))
        return out

    def departures(self, velocities: np.ndarray, time_step: float) -> np.ndarray:
        """Gap of each at the end of the step, mm, for velocities (c, 3) of the points."""
        return time_step * np.einsum("cd,cd->c", self.normal, velocities - self.target)

    def add_stiffness(self, hold: np.ndarray, stiffness: Stiffness) -> np.ndarray:
        """Blocks of the stiffness with those of the points' `hold`, shape (c, 3, 3), Pa s mm."""
        data = stiffness.data.copy()
        _add_points(self.nodes, self.value, hold, stiffness.indices, stiffness.pointers, data)
        return data


def wall_points(
    body: Body, contacts: Contacts, away: np.ndarray, positions: np.ndarray, inverse_shape: np.ndarray,
    volumes: np.ndarray, time_step: float,
) -> WallPoints:  # fmt: skip
    """Share the walls of each cell out among the particles that have a face near.

    Parameters
    ----------
    body : Body
    contacts : Contacts
    away : ndarray, shape (m, 3)
        Distance of each face from the particle at its position, mm, infinite for none.
    positions : ndarray, shape (n, 3)
        mm.
    inverse_shape : ndarray, shape (n, 6)
        Metric of each particle's lattice.
    volumes : ndarray, shape (n,)
        Present volumes, mm^3.
    time_step : float
        s.
    """
    grid, rows = body.grid, contacts.rows
    place = places_of(rows, len(positions))
    order = rows[np.argsort(body.cell[rows], kind="stable")]
    begin = np.searchsorted(body.cell[order], np.arange(len(grid.site) + 1))
    nearest = np.full(body.share.shape, -1, dtype=np.int64)
    _nearest_rows(
        grid.site, grid.table, grid.low, grid.size, body.share, order, begin, positions, inverse_shape, place, nearest
    )  # fmt: skip
    cell, point = np.nonzero(nearest >= 0)
    local, _ = sub_points()
    size = grid.size[cell]
    at, row = grid.low[cell] + 0.5 * (local[point] + 1.0) * size, nearest[cell, point]
    step = at - positions[rows[row]]
    found = []
    for k in range(FACES):
        normal = contacts.normal[row, k]
        depth = away[row, k] + np.einsum("qc,qc->q", normal, step)
        thick = np.einsum("qc,qc->q", np.abs(normal), size) / SUB
        first = np.flatnonzero(depth < thick)
        foot = at[first] - depth[first, None] * normal[first]
        area = size[first].prod(axis=1) / POINTS / thick[first]
        found.append((cell[first], row[first], np.full(len(first), k), foot, area))
    # Those that no sub-point is nearest to stand on the wall with their own foot.
    rest, face = np.nonzero((contacts.tool >= 0) & contacts.active)
    seen = np.zeros(contacts.tool.shape, dtype=bool)
    for part in found:
        seen[part[1], part[2]] = True
    lone = ~seen[rest, face]
    rest, face = rest[lone], face[lone]
    particle = rows[rest]
    foot = positions[particle] - away[rest, face, None] * contacts.normal[rest, face]
    found.append((body.cell[particle], rest, face, foot, contacts.areas(volumes[rows])[rest, face]))
    cell, row, face, foot, area = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return _gather(body, contacts, cell, row, face, foot, area, time_step)


def _gather(
    body: Body, contacts: Contacts, cell: np.ndarray, row: np.ndarray, face: np.ndarray, foot: np.ndarray,
    area: np.ndarray, time_step: float,
) -> WallPoints:  # fmt: skip
    """Means over the feet of each particle on a face in a cell."""
    keys, number = np.unique((cell * len(contacts.rows) + row) * FACES + face, return_inverse=True)
    count = len(keys)
    value, position = np.zeros((count, NODES)), np.zeros((count, 3))
    total = np.bincount(number, area, count)
    np.add.at(value, number, area[:, None] * at_points(body.grid, cell, foot)[0])
    np.add.at(position, number, area[:, None] * foot)
    row, face, cell = keys // FACES % len(contacts.rows), keys % FACES, keys // FACES // max(len(contacts.rows), 1)
    normal, wall = contacts.normal[row, face], contacts.wall_velocity[row, face]
    return WallPoints(
        row, face, position / total[:, None], body.grid.nodes[cell], value / total[:, None], normal,
        wall - (contacts.gap[row, face] / time_step)[:, None] * normal, wall, total,
    )  # fmt: skip


@njit(cache=True, parallel=True)
def _nearest_rows(site, table, low, size, share, order, begin, x, g, place, nearest):
    for cell in prange(site.shape[0]):
        rows = order[begin[cell] : begin[cell + 1]]
        if len(rows) == 0:
            rows = rows_around(site[cell], table, order, begin)
        if len(rows) == 0:
            continue
        for point in range(POINTS):
            if share[cell, point] < 0:
                continue
            y0 = low[cell, 0] + size[cell, 0] * (point // (SUB * SUB) + 0.5) / SUB
            y1 = low[cell, 1] + size[cell, 1] * (point // SUB % SUB + 0.5) / SUB
            y2 = low[cell, 2] + size[cell, 2] * (point % SUB + 0.5) / SUB
            nearest[cell, point] = place[nearest_of(rows, x, g, y0, y1, y2)]


@njit(cache=True)
def _add_points(nodes, value, hold, indices, pointers, data):
    for point in range(nodes.shape[0]):
        for a in range(NODES):
            row = nodes[point, a]
            begin, end = pointers[row], pointers[row + 1]
            for b in range(NODES):
                column = nodes[point, b]
                if column < row:
                    continue
                slot = begin + np.searchsorted(indices[begin:end], column)
                factor = value[point, a] * value[point, b]
                for c in range(3):
                    for d in range(3):
                        data[slot, c, d] += factor * hold[point, c, d]
