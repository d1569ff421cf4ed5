"""The time at which each place fills."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ppmc.analysis.flow.occupancy import Cells, fill_shares
from ppmc.particles import Particles

CELL_IN_SPACINGS = 1.0
BITS_A_CELL = 2.0
HALF = 0.5


def fill_times(frames: Iterable[tuple[float, Particles]], cells: Cells, last: Particles) -> NDArray[np.float64]:
    """Return the time at which the place of each point of the last state was first filled.

    Parameters
    ----------
    frames : iterable of (float, Particles)
        Times (s, ascending) and states; with the field ``deformation_gradient`` particles count with their deformed
        extent.
    cells : Cells
        Around all frames.
    last : Particles
        The last state, m points.

    Returns
    -------
    ndarray, shape (m,)
        s; as fine as the frames are. A cell is filled once it holds half of what it holds in the end; NaN for places
        that no frame filled.
    """
    level = HALF * fill_shares([last], cells, bits_a_cell=BITS_A_CELL)
    first = np.full(cells.shape, np.nan)
    for time, state in frames:
        filled = fill_shares([state], cells, bits_a_cell=BITS_A_CELL) >= level
        first[filled & (level > 0) & np.isnan(first)] = time
    return np.asarray(first.reshape(-1)[cells.index(last.positions)])
