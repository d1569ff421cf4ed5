"""The section of a double dome as a curve by arc length, and the surface it sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ppmc.geometry.tools.outline import outline_segments

if TYPE_CHECKING:
    from ppmc.geometry.parts.double_dome import DoubleDome

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """Curve from the spine outwards over the punch, at a distance above it.

    Attributes
    ----------
    rows : ndarray, shape (m, 12)
        Straight lines and arcs in order from the spine, as `ppmc.geometry.tools.outline.outline_segments` gives them,
        each run through backwards.
    starts : ndarray, shape (m + 1,)
        Arc length at the start of each row, and at the end of the last, mm.
    """

    rows: FloatArray
    starts: FloatArray

    @classmethod
    def of(cls, part: DoubleDome, offset: float) -> Profile:
        """Return the curve `offset` mm above the punch."""
        segments = outline_segments(*part.surface_profile(offset))
        # The outline runs anticlockwise: up the rim, then inwards over the dome to the spine.
        inwards = (segments[:, 2] < segments[:, 0] - 1e-12) & (segments[:, 1] > -1e-9)
        rows = segments[inwards][::-1]
        return cls(rows, np.append(0.0, np.cumsum([_length(row) for row in rows])))

    @property
    def length(self) -> float:
        """Arc length from spine to rim, mm."""
        return float(self.starts[-1])

    def at(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points (distance from spine, height) and outward normals, each shape (n, 2), at arc lengths s."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.length)
        which = np.clip(np.searchsorted(self.starts, s, side="right") - 1, 0, len(self.rows) - 1)
        points, normals = np.empty((len(s), 2)), np.empty((len(s), 2))
        for k, row in enumerate(self.rows):
            mine = which == k
            share = ((s[mine] - self.starts[k]) / (self.starts[k + 1] - self.starts[k]))[:, None]
            a, b = row[2:4], row[0:2]
            if row[6] > 0:
                ray_a, ray_b = a - row[4:6], b - row[4:6]
                sweep = np.arctan2(ray_a[0] * ray_b[1] - ray_a[1] * ray_b[0], ray_a @ ray_b) * share
                ray = (
                    np.hstack([np.cos(sweep), np.sin(sweep)]) * ray_a[0]
                    + np.hstack([-np.sin(sweep), np.cos(sweep)]) * ray_a[1]
                )
                points[mine] = row[4:6] + ray
                normals[mine] = row[7] * ray / row[6]
            else:
                points[mine] = a + share * (b - a)
                normal = np.array([-(b - a)[1], (b - a)[0]])
                normals[mine] = normal / np.hypot(*normal)
        return points, normals


def _length(row: FloatArray) -> float:
    """Return the length of a line or arc."""
    if row[6] == 0:
        return float(np.hypot(*(row[2:4] - row[0:2])))
    a, b = row[0:2] - row[4:6], row[2:4] - row[4:6]
    return float(row[6] * abs(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)))
