"""How thick platelets are, seen from how far along their normal the fibre direction lasts.

Two voxels of a platelet have the same p; so along the normal the correlation of p falls in a straight line, to nothing
at one thickness. Across the fibres but in the plane it lasts far longer, which tells platelets from single fibres: of
those both end together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

GONE = 0.1
"""Correlation taken as none."""
PROVEN = 0.6
"""Confidence from which platelets are taken as proven: phantoms of rods give at most 0.4, of plies at least 0.8."""
LEAST_VOXELS = 2.0
"""Thinnest platelets that can be told from noise, voxels."""


@dataclass(frozen=True)
class Thickness:
    """A platelet thickness that the volume suggests.

    Attributes
    ----------
    value : float
        mm; 0 if nothing was found.
    confidence : float
        0 for none to 1: by how much more p lasts in the plane than across it.
    """

    value: float = 0.0
    confidence: float = 0.0


def thickness_of(fields: dict[str, NDArray[Any]], spacing: tuple[float, float, float]) -> Thickness:
    """Return the platelet thickness seen in the orientations of a block.

    Parameters
    ----------
    fields : dict
        ``fibre_direction``, ``platelet_normal``, shape (nz, ny, nx, 3), and ``valid``.
    spacing : tuple of float
        Voxel size (x, y, z), mm.
    """
    p, r = fields["fibre_direction"].astype(float), fields["platelet_normal"].astype(float)
    valid = fields["valid"] > 0
    step = min(spacing)
    most = int(min(n * h for n, h in zip(valid.shape, spacing[::-1], strict=True)) / (3.0 * step))
    if valid.sum() < 1000 or most < 3:
        return Thickness()
    here = p[valid]
    tensor = here.T @ here / len(here)
    random = float((tensor**2).sum())
    if random > 0.95:
        return Thickness()
    across = _correlation(p, r, valid, spacing, most, random)
    beside = _correlation(p, np.cross(r, p), valid, spacing, most, random)
    gone = np.flatnonzero(across < GONE)
    end = int(gone[0]) if gone.size else 0
    if end == 0:
        return Thickness()
    # a triangle of height one has twice the area as its base
    value = 2.0 * (0.5 + float(across[1:end].sum())) * step
    if value < LEAST_VOXELS * step:
        return Thickness()
    # looked at where the straight line has fallen by half
    at = min(max(round(0.5 * value / step), 1), most)
    return Thickness(value, float(np.clip(beside[min(2 * at, most)] - max(across[min(2 * at, most)], 0.0), 0.0, 1.0)))


def _correlation(
    p: NDArray[np.float64], along: NDArray[np.float64], valid: NDArray[np.bool_], spacing: tuple[float, float, float],
    most: int, random: float,
) -> NDArray[np.float64]:  # fmt: skip
    """Return how alike p is at 0, 1, ... ``most`` smallest voxel edges along a direction, 1 for equal, 0 at random."""
    at = np.argwhere(valid)
    direction = along[valid][:, ::-1] * min(spacing) / np.array(spacing[::-1])
    here = p[valid]
    out = [1.0]
    for k in range(1, most + 1):
        there = np.rint(at + k * direction).astype(int)
        inside = ((there >= 0) & (there < valid.shape)).all(axis=1)
        place = tuple(there[inside].T)
        good = valid[place]
        same = np.sum(here[inside][good] * p[place][good], axis=1) ** 2
        out.append((float(same.mean()) - random) / (1.0 - random) if same.size else 0.0)
    return np.array(out)
