"""The time at which each place fills."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ppmc.analysis.occupancy import Cells

# A cell of two spacings holds a particle wherever there is material, so a filled place has no gaps.
CELL_IN_SPACINGS = 2.0


def fill_times(frames: Iterable[tuple[float, np.ndarray]], cells: Cells, final: np.ndarray) -> np.ndarray:
    """Return the time at which the place of each final point was first reached.

    Parameters
    ----------
    frames : iterable of (float, ndarray of shape (n, 3))
        Times (s, ascending) and positions (mm).
    cells : Cells
        Around all frames.
    final : ndarray, shape (m, 3)
        Places to ask for, mm.

    Returns
    -------
    ndarray, shape (m,)
        s; as fine as the frames are, NaN for places no frame reached.
    """
    first = np.full(int(np.prod(cells.shape)), np.nan)
    for time, positions in frames:
        reached = np.unique(cells.index(positions))
        new = reached[np.isnan(first[reached])]
        first[new] = time
    return first[cells.index(final)]
