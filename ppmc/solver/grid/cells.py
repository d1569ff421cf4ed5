"""Where the lines of the grid lie, and which of its cells hold material.

A cell is two particles wide, so that it holds eight: as many fibre strains as its functions can obey and still let
layers slide. Where lattices are drawn out along an axis of the grid or pressed flat, the lines follow: their density at
a coordinate is the mean of what the particles there ask for. The outermost lie where the outermost particles end.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.errors import NumericalError
from ppmc.solver.particles.cells import MAX_CELLS

WIDTH = 2.0  # of a cell, in extents of the particles' cells
ACROSS = 0.99  # cosine from which on a wall counts as across an axis
SMOOTHED = 2.0  # length, in the same, over which the wanted density of lines is averaged


@dataclass(frozen=True)
class Grid:
    """Cells that hold material, a part of a box of cells between lines.

    Attributes
    ----------
    lines : tuple of three ndarray, shape (k + 1,)
        mm, ascending.
    site : ndarray, shape (cells, 3), int64
        Place of each cell in the box.
    table : ndarray, shape (k1, k2, k3), int32
        Number of the cell at a place, -1 for none.
    nodes : ndarray, shape (cells, 27), int64
        Nodes of each cell.
    node_count : int
    """

    lines: tuple[np.ndarray, np.ndarray, np.ndarray]
    site: np.ndarray
    table: np.ndarray
    nodes: np.ndarray
    node_count: int

    @property
    def low(self) -> np.ndarray:
        """Low corner of each cell, shape (cells, 3), mm."""
        return np.stack([self.lines[c][self.site[:, c]] for c in range(3)], axis=1)

    @property
    def size(self) -> np.ndarray:
        """Size of each cell, shape (cells, 3), mm."""
        return np.stack([np.diff(self.lines[c])[self.site[:, c]] for c in range(3)], axis=1)


def lay_lines(
    positions: np.ndarray, extents: np.ndarray, near: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lines of the grid along the axes, mm, for particles at positions (n, 3) whose cells have `extents` (n, 3), mm.

    Where a particle is at a wall across an axis, its cell ends there: `near` are rows (m,), normals (m, k, 3) and
    distances (m, k) of faces.

    Raises
    ------
    NumericalError
        If the particles are spread over an implausible number of cells.
    """
    below, above = 0.5 * extents, 0.5 * extents
    rows, normal, distance = near
    for face in range(normal.shape[1]):
        for c in range(3):
            for half, sign in ((below, 1.0), (above, -1.0)):
                on = (sign * normal[:, face, c] > ACROSS) & np.isfinite(distance[:, face])
                half[rows[on], c] = np.minimum(half[rows[on], c], np.maximum(distance[on, face], 0.0))
    low, high = (positions - below).min(axis=0), (positions + above).max(axis=0)
    typical = np.median(extents, axis=0)
    if not np.prod((high - low) / (WIDTH * typical) + 1.0) < MAX_CELLS:
        raise NumericalError(
            f"particles are spread over {low} to {high} mm: some have been lost; take smaller steps"
            " (solver.max_strain_increment) or look for gaps in the tooling"
        )
    x1, x2, x3 = (_lines(positions[:, c], extents[:, c], low[c], high[c]) for c in range(3))
    return x1, x2, x3


def _lines(x: np.ndarray, extent: np.ndarray, low: float, high: float) -> np.ndarray:
    bins = max(4, int(np.ceil(4.0 * (high - low) / np.median(extent))))
    edges = np.linspace(low, high, bins + 1)
    at = np.clip(((x - low) / (high - low) * bins).astype(np.int64), 0, bins - 1)
    number, sums = np.bincount(at, minlength=bins), np.bincount(at, 1.0 / (WIDTH * extent), bins)
    # Means over a window, empty stretches included in it.
    window = np.ones(2 * round(2.0 * SMOOTHED) + 1)
    count, wanted = np.convolve(number, window, "same"), np.convolve(sums, window, "same")
    mean = 1.0 / (WIDTH * float(np.median(extent)))
    density = np.where(count > 0, wanted / np.maximum(count, 1), mean)
    total = np.append(0.0, np.cumsum(density) * (edges[1] - edges[0]))
    cells = max(1, round(float(total[-1])))
    lines = np.interp(np.linspace(0.0, total[-1], cells + 1), total, edges)
    lines[0], lines[-1] = low, high
    return np.asarray(lines)


def places(lines: tuple[np.ndarray, np.ndarray, np.ndarray], positions: np.ndarray) -> np.ndarray:
    """Place (n, 3) in the box of cells of positions (n, 3), that of the nearest cell for those outside."""
    columns = [
        np.clip(np.searchsorted(lines[c], positions[:, c], "right") - 1, 0, len(lines[c]) - 2) for c in range(3)
    ]  # fmt: skip
    return np.stack(columns, axis=1)


def make_grid(lines: tuple[np.ndarray, np.ndarray, np.ndarray], site: np.ndarray) -> Grid:
    """Grid of the cells at given places (cells, 3)."""
    shape = tuple(len(line) - 1 for line in lines)
    table = np.full(shape, -1, dtype=np.int32)
    table[tuple(site.T)] = np.arange(len(site))
    around = np.array(list(np.ndindex(3, 3, 3)))
    fine = tuple(2 * k + 1 for k in shape)
    numbers = np.ravel_multi_index(tuple((2 * site[:, None] + around).transpose(2, 0, 1)), fine)
    used, nodes = np.unique(numbers, return_inverse=True)
    return Grid(lines, site, table, nodes.reshape(-1, 27), len(used))
