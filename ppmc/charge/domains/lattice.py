"""Regular lattices of particles: a box, an extrusion, the inside of any closed surface.

A lattice fills the bounding box of its domain with equal cells, one particle in the middle of each, and keeps the
cells whose centre lies inside. Layers are counted along x3; x1 runs fastest, so that a layer is contiguous.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import SceneError

Array = NDArray[np.floating]
Inside = Callable[[Array], NDArray[np.bool_]]

MOST_PARTICLES = 50_000_000
# A lattice whose cells add up to a volume this far from the domain's does not resolve its shape.
WORST_VOLUME_RATIO = 0.25


@dataclass(frozen=True)
class Lattice:
    """Particles on a regular lattice.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        Particle centres, mm.
    volumes : ndarray, shape (n,)
        Particle volumes, mm^3; they add up to the domain's volume.
    spacing : tuple of 3 floats
        Distance between neighbours along x1, x2, x3, mm.
    cells : ndarray, shape (n,), int64
        Flat index of each particle's cell in the full lattice, C order of `shape`.
    shape : tuple (n3, n2, n1)
        Number of cells along x3, x2, x1.
    volume_scale : float
        Particle volume over cell volume; 1 for a box.
    """

    positions: Array
    volumes: Array
    spacing: tuple[float, float, float]
    cells: NDArray[np.int64]
    shape: tuple[int, int, int]
    volume_scale: float = 1.0

    @property
    def n(self) -> int:
        """Number of particles."""
        return len(self.positions)

    @property
    def layer(self) -> NDArray[np.int64]:
        """Layer of each particle, shape (n,), from 0 at the least x3."""
        return self.cells // (self.shape[1] * self.shape[2])


def cell_counts(
    size: Sequence[float], spacing: Sequence[float], layers: int | None = None
) -> tuple[tuple[int, int, int], tuple[float, float, float]]:
    """Return how many cells fit along x1, x2, x3, and their exact edge lengths.

    Parameters
    ----------
    size, spacing : three floats
        Edge lengths of the box and wanted cell edges along x1, x2, x3, mm.
    layers : int, optional
        Number of cells along x3, instead of the third spacing.

    Raises
    ------
    SceneError
        If a spacing is larger than twice the edge it divides, or the lattice exceeds `MOST_PARTICLES`.
    """
    counts = []
    for axis, (length, step) in enumerate(zip(size, spacing, strict=True)):
        if axis == 2 and layers is not None:
            counts.append(layers)
            continue
        if not (step > 0 and np.isfinite(step)):
            raise SceneError(f"charge.spacing: must be a positive length, got {step:g} mm along x{axis + 1}")
        if step > 2.0 * length:
            raise SceneError(
                f"charge.spacing: {step:g} mm does not fit the domain's extent of {length:g} mm along x{axis + 1}; "
                "give a smaller spacing, or a list of three"
            )
        # Just below a half rounds up, so that 93.5 / 0.5 in floating point is 187 and 2.5 means 3 cells, not 2.
        counts.append(max(1, int(np.floor(length / step + 0.5 + 1e-9))))
    n1, n2, n3 = counts
    total = n1 * n2 * n3
    if total > MOST_PARTICLES:
        raise SceneError(
            f"charge.spacing: {n1} x {n2} x {n3} = {total:,} particles, more than the limit of {MOST_PARTICLES:,}; "
            "give a larger spacing"
        )
    return (n1, n2, n3), (size[0] / n1, size[1] / n2, size[2] / n3)


def box_lattice(
    origin: Sequence[float], size: Sequence[float], spacing: Sequence[float], layers: int | None = None
) -> Lattice:
    """Return the lattice of a box; the particles' volumes add up to the box's to rounding.

    Parameters
    ----------
    origin : three floats
        Corner of least coordinates, mm.
    size : three floats
        Edge lengths, mm.
    spacing : three floats
        Wanted distance between particles along x1, x2, x3, mm; adjusted to divide the edges evenly.
    layers : int, optional
        Number of layers along x3, instead of the third spacing.

    Notes
    -----
    The bracket charge of J is ``box_lattice((0, 0, 0), (93.5, 34, 6), (0.5, 0.5, 0.5), layers=12)``:
    12 layers of 187 x 68 = 12,716 particles.
    """
    (n1, n2, n3), steps = cell_counts(size, spacing, layers)
    x1, x2, x3 = ((np.arange(n) + 0.5) * h + o for n, h, o in zip((n1, n2, n3), steps, origin, strict=True))
    positions = np.empty((n3, n2, n1, 3))
    positions[..., 0] = x1
    positions[..., 1] = x2[:, None]
    positions[..., 2] = x3[:, None, None]
    n = n1 * n2 * n3
    volumes = np.full(n, float(size[0]) * float(size[1]) * float(size[2]) / n)
    return Lattice(positions.reshape(-1, 3), volumes, steps, np.arange(n, dtype=np.int64), (n3, n2, n1))


def filled_lattice(
    lower: Array,
    upper: Array,
    volume: float,
    inside: Inside,
    spacing: Sequence[float],
    layers: int | None = None,
    *,
    what: str = "the domain",
) -> Lattice:
    """Return the lattice of any closed shape; the particles' volumes add up to the shape's.

    Parameters
    ----------
    lower, upper : ndarray, shape (3,)
        Bounding box of the shape, mm. The outermost cells touch it, so flat faces along the axes are met exactly.
    volume : float
        Exact volume of the shape, mm^3; every particle gets an equal share.
    inside : callable
        Maps points, shape (m, 3), to booleans, shape (m,). Called for about a million points at a time.
    spacing, layers
        As in `box_lattice`.
    what : str
        Names the shape in messages.

    Raises
    ------
    SceneError
        If no cell centre, or far too few or many, lie inside.
    """
    size = upper - lower
    if not (np.isfinite(volume) and volume > 0):
        raise SceneError(f"charge.domain: {what} has the volume {volume:g} mm^3; it must be positive")
    (n1, n2, n3), steps = cell_counts(size.tolist(), spacing, layers)
    x1, x2 = (lower[a] + (np.arange(n) + 0.5) * steps[a] for a, n in ((0, n1), (1, n2)))
    plane = np.stack([np.tile(x1, n2), np.repeat(x2, n1)], axis=1)
    layers_at_once = max(1, 1_000_000 // len(plane))
    kept_points, kept_cells = [], []
    for first in range(0, n3, layers_at_once):
        ks = np.arange(first, min(first + layers_at_once, n3))
        x3 = lower[2] + (ks + 0.5) * steps[2]
        points = np.column_stack([np.tile(plane, (len(ks), 1)), np.repeat(x3, len(plane))])
        keep = np.asarray(inside(points), dtype=bool)
        kept_points.append(points[keep])
        kept_cells.append(np.flatnonzero(keep) + first * len(plane))
    positions = np.concatenate(kept_points)
    cells = np.concatenate(kept_cells).astype(np.int64)
    filled = len(positions) * float(np.prod(steps))
    if len(positions) == 0:
        raise SceneError(f"charge.spacing: no particle of a lattice of {steps} mm lies inside {what}; make it finer")
    scale = volume / filled
    if abs(filled / volume - 1.0) > WORST_VOLUME_RATIO:
        raise SceneError(
            f"charge.spacing: the cells inside {what} hold {filled:.4g} mm^3 but it has {volume:.4g} mm^3; "
            "the lattice is too coarse for this shape, give a smaller spacing"
        )
    return Lattice(positions, np.full(len(positions), volume / len(positions)), steps, cells, (n3, n2, n1), scale)
