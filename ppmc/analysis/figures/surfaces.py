"""Closed surfaces that split a part by the axis its fibres favour, as in A's Fig 4.5."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.analysis.flow.occupancy import cells_around
from ppmc.particles import Particles

CELL_IN_SPACINGS = 1.0
SMOOTHING_CELLS = 1.0
EDGE_CELLS = 3
FILLED_FROM = 0.5


@dataclass(frozen=True)
class Surface:
    """A triangulated surface with a value a vertex.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        mm.
    triangles : ndarray, shape (m, 3)
    values : ndarray, shape (n,)
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    values: NDArray[np.float64]


def dominant_surfaces(samples: Particles, spacing: float) -> list[Surface]:
    """Return three surfaces around the pieces of the part in which A11, A22, A33 is the largest of the three.

    Parameters
    ----------
    samples : Particles
        With fibre directions.
    spacing : float
        Distance of neighbours, mm; A is smoothed over about two of them.

    Returns
    -------
    list of Surface
        Values are the component that dominates. Empty where no piece favours that axis.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates
    from skimage.measure import marching_cubes

    p = samples.fibre_direction
    nothing = Surface(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), np.empty(0))
    if p is None or not len(samples) or not spacing > 0:
        return [nothing] * 3
    cells = cells_around([samples.positions], EDGE_CELLS * spacing, CELL_IN_SPACINGS * spacing)
    index, weight = cells.index(samples.positions), samples.volume / samples.volume.mean()

    def smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
        total = np.bincount(index, weights=values, minlength=int(np.prod(cells.shape))).reshape(cells.shape)
        return np.asarray(gaussian_filter(total.astype(float), SMOOTHING_CELLS))

    mass = smooth(weight)
    A = [smooth(weight * p[:, i] ** 2) / np.maximum(mass, 1e-12) for i in range(3)]
    # Volume conserved, a cell of the undeformed spacing's size holds one particle where it is full.
    filled = mass * (spacing / cells.size) ** 3 - FILLED_FROM
    out = []
    for i in range(3):
        lead = A[i] - np.maximum(A[(i + 1) % 3], A[(i + 2) % 3])
        inside = np.minimum(lead, filled)
        if not inside.max() > 0:
            out.append(nothing)
            continue
        vertices, triangles, _, _ = marching_cubes(inside, 0.0)
        values = map_coordinates(A[i], vertices.T, order=1)
        points = cells.origin + (vertices + 0.5) * cells.size
        out.append(Surface(points, triangles.astype(np.int64), values))
    return out
