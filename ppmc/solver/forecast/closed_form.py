"""Closed forms of a homogeneous squeeze between slip plates: stretches, orientation, stress.

The stress factors are those of J5 in such flows: -sigma33 = factor x eta23 x closing rate, and the press force is that
stress on the area V / h. See docs/theory.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def free_squeeze(ratio: float, compression: float, collimated: bool) -> tuple[float, float, float]:
    """Return the stretches along and across the fibres, and the stress factor, with free sides.

    Parameters
    ----------
    ratio : float
        R; with 1 the fluid is Newtonian.
    compression : float
        h0 / h.
    collimated : bool
        Whether all fibres lie in one direction; else they are planar random.
    """
    if collimated:
        return compression ** (0.5 / ratio), compression ** (1.0 - 0.5 / ratio), 4.0 - 1.0 / ratio
    return math.sqrt(compression), math.sqrt(compression), ratio + 2.0


def walled_squeeze(ratio: float, compression: float, share_along: float | None) -> tuple[float, float]:
    """Return A11 and the stress factor of a squeeze between side walls, along which all flow goes (direction 1).

    Parameters
    ----------
    ratio, compression : float
        R and h0 / h.
    share_along : float or None
        1 for collimated fibres along the walls, 0 for fibres across them, None for fibres that were planar random.
    """
    along, fourth = share_along, share_along
    if along is None or fourth is None:
        along = compression / (1.0 + compression)
        fourth = compression * (2.0 * compression + 1.0) / (2.0 * (1.0 + compression) ** 2)
    return along, 4.0 * (ratio - 1.0) * fourth + 4.0


@dataclass(frozen=True)
class Case:
    """What is squeezed, and how its sides are held.

    Attributes
    ----------
    axis : int
        Axis of the squeeze.
    channel : int or None
        Axis across which side walls stand.
    fibres : ndarray, shape (3,), or "planar" or None
        Direction of all fibres in the plane, planar random ones, or any others.
    acting : {"newtonian", "planar", "collimated"}
        What the viscosity is that of.
    ratio : float
        R.
    """

    axis: int
    channel: int | None
    fibres: Array | str | None
    acting: str
    ratio: float

    @property
    def plane(self) -> list[int]:
        """The other two axes, the one of free flow first."""
        plane = [a for a in range(3) if a != self.axis]
        return plane[::-1] if plane[0] == self.channel else plane

    @property
    def _share_along(self) -> float | None:
        return float(self.fibres[self.plane[0]] ** 2) if isinstance(self.fibres, np.ndarray) else None

    def factor(self, compression: float) -> float:
        """Return the stress factor."""
        if self.channel is None:
            return free_squeeze(self.ratio, compression, self.acting == "collimated")[2]
        return walled_squeeze(self.ratio, compression, self._share_along)[1]

    def stretch(self, compression: float) -> Array:
        """Return the deformation gradient, shape (3, 3)."""
        out = np.eye(3)
        out[self.axis, self.axis] = 1.0 / compression
        if self.channel is not None:
            out[self.plane[0], self.plane[0]] = compression
            return out
        along, across, _ = free_squeeze(self.ratio, compression, self.acting == "collimated")
        p = self.fibres if isinstance(self.fibres, np.ndarray) else np.eye(3)[self.plane[0]]
        sideways = np.cross(np.eye(3)[self.axis], p)
        return np.asarray(out + (along - 1.0) * np.outer(p, p) + (across - 1.0) * np.outer(sideways, sideways))

    def orientation(self, compression: float) -> Array | None:
        """Return the diagonal of A, shape (3,), if it is known."""
        if self.fibres is None:
            return None
        if isinstance(self.fibres, np.ndarray):
            return self.fibres**2
        share = 0.5 if self.channel is None else walled_squeeze(self.ratio, compression, None)[0]
        out = np.zeros(3)
        out[self.plane] = share, 1.0 - share
        return out

    def named_stretches(self, compression: float) -> dict[str, float]:
        """Return the principal stretches by direction."""
        stretch = self.stretch(compression)
        named = {f"x{a + 1}": float(stretch[a, a]) for a in sorted(self.plane)}
        if self.acting == "collimated" and self.channel is None:
            along, across, _ = free_squeeze(self.ratio, compression, True)
            named = {"along the fibres": along, "across them": across}
        return {**named, f"x{self.axis + 1}": float(stretch[self.axis, self.axis])}
