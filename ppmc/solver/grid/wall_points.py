r"""Points of contact: where the cells of touching particles end on the walls.

The body reaches to the walls, and so do the grid's functions. A face that touches holds the body's velocity at the
particle's foot on it, :math:`n\cdot(v(x_c) - v_{wall}) \ge -g/\Delta t`, by a penalty on the particle's part of the
face that augmented Lagrangian steps make exact. Friction acts there as the wall's law has it.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit
from ppmc.solver.grid.body import Body
from ppmc.solver.grid.cells import places
from ppmc.solver.grid.recover import at_points
from ppmc.solver.grid.shapes import NODES
from ppmc.solver.grid.stiffness import Stiffness
from ppmc.solver.walls.contact import Contacts


@dataclass(frozen=True)
class WallPoints:
    """Feet of particles on faces.

    Attributes
    ----------
    row, face : ndarray, shape (c,), int64
        Row and column of each in the arrays of :class:`Contacts`.
    position : ndarray, shape (c, 3)
        mm.
    nodes : ndarray, shape (c, 27), int64
    value : ndarray, shape (c, 27)
        Of the grid's functions there.
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
    body: Body, contacts: Contacts, positions: np.ndarray, velocities: np.ndarray, volumes: np.ndarray, ahead: float,
    time_step: float,
) -> WallPoints:  # fmt: skip
    """Find the feet of all particles on the faces near them.

    Parameters
    ----------
    body : Body
    contacts : Contacts
    positions : ndarray, shape (n, 3)
        Those predicted for `ahead` (s) after the step begins, mm.
    velocities : ndarray, shape (n, 3)
        With which they were predicted, mm/s.
    volumes : ndarray, shape (n,)
        Present volumes, mm^3.
    ahead, time_step : float
        s.
    """
    row, face = np.nonzero(contacts.tool >= 0)
    particle = contacts.rows[row]
    normal, wall = contacts.normal[row, face], contacts.wall_velocity[row, face]
    gap, width = contacts.gap[row, face], contacts.half_width[row, face]
    away = gap + width + ahead * np.einsum("cd,cd->c", normal, velocities[particle] - wall)
    position = positions[particle] - away[:, None] * normal
    grid = body.grid
    lines = grid.lines
    inside = np.all(
        [(position[:, c] >= lines[c][0]) & (position[:, c] <= lines[c][-1]) for c in range(3)], axis=0
    )  # fmt: skip
    there = grid.table[tuple(places(lines, position).T)].astype(np.int64)
    cell = np.where(inside & (there >= 0), there, body.cell[particle])
    value, _ = at_points(grid, cell, position)
    return WallPoints(
        row, face, position, grid.nodes[cell], value, normal, wall - (gap / time_step)[:, None] * normal, wall,
        contacts.areas(volumes[contacts.rows])[row, face],
    )  # fmt: skip


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
