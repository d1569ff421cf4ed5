"""The round field of view of a scanner: what lies outside of its circle, filled with one value, is no specimen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.volume import Box, Volume

PLANES = 5
"""Planes that are looked at."""
FILLED = 0.9
"""Share of the disc that must differ from the fill value: less is a specimen in an empty background."""
INSIDE = 1.0
"""Voxels by which the mask is smaller than the circle, whose rim is often blurred."""
LEAST = 0.35
"""Smallest radius of a field of view, in edges of the slice: it touches at least two sides, or nearly."""


@dataclass(frozen=True)
class FieldOfView:
    """A cylinder along z.

    Attributes
    ----------
    fill : float
        Grey value outside.
    middle : tuple of float
        Axis (y, x), voxels.
    radius : float
        Voxels.
    """

    fill: float
    middle: tuple[float, float]
    radius: float

    def reader(self, volume: Volume) -> Volume:
        """Return the volume with the cylinder as its mask."""
        reach = (self.radius - INSIDE) ** 2

        def read(box: Box) -> NDArray[np.uint8]:
            y, x = (np.arange(s.start, s.stop) - m for s, m in zip(box[1:], self.middle, strict=True))
            disc = (y[:, None] ** 2 + x**2 <= reach).astype(np.uint8)
            return np.broadcast_to(disc, (box[0].stop - box[0].start, *disc.shape))

        return volume.within(read)


def field_of_view(volume: Volume) -> FieldOfView | None:
    """Return the cylinder outside of which every voxel of some planes has one value, None if there is none.

    The four corners of every plane must have that value to the last bit, the disc must be nearly free of it, and every
    voxel outside of the disc must have it.
    """
    nz, ny, nx = volume.shape
    if min(ny, nx) < 16:
        return None
    differs = np.zeros((ny, nx), bool)
    share = []
    fill: float | None = None
    for z in np.unique(np.linspace(0, nz - 1, PLANES).round().astype(int)):
        plane = volume.read((slice(z, z + 1), slice(0, ny), slice(0, nx)))[0]
        corners = plane[[0, 0, -1, -1], [0, -1, 0, -1]]
        if fill is None:
            fill = float(corners[0])
        if not (corners == fill).all():
            return None
        other = plane != fill
        differs |= other
        share.append(int(other.sum()))
    y, x = np.nonzero(differs)
    if fill is None or y.size == 0:
        return None
    middle = (0.5 * (y.min() + y.max()), 0.5 * (x.min() + x.max()))
    reach = float(np.sqrt(((y - middle[0]) ** 2 + (x - middle[1]) ** 2).max()))
    yy, xx = np.ogrid[:ny, :nx]
    disc = (yy - middle[0]) ** 2 + (xx - middle[1]) ** 2 <= (reach + 0.5) ** 2
    if disc.all() or reach < LEAST * min(ny, nx) or min(share) < FILLED * disc.sum():
        return None
    return FieldOfView(fill, (float(middle[0]), float(middle[1])), reach)
