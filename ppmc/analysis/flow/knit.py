"""Knit lines without an eye: where material from far apart has met, and how much reinforcement crosses there.

The papers see a knit line as low A and high N across it (J section IV). Particles carry more: neighbours at a knit
line were not neighbours at the start. A neighbour j of i is foreign if its place at the start is not where i's
deformation gradient would have it, |X_j − X_i − F_i⁻¹(x_j − x_i)| being more than some spacings. The direction across
the line is that in which the foreign neighbours lie; the strength is the share of fibres along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEIGHBOURS = 20
FOREIGN_SPACINGS = 4.0
LEAST_SHARE = 0.15
LEAST_NEIGHBOURS = 6
REACH_SPACINGS = 3.0


@dataclass(frozen=True)
class KnitLine:
    """Particles at knit lines, m of n.

    Attributes
    ----------
    index : ndarray, shape (m,)
        Which particles.
    share : ndarray, shape (n,)
        Share of foreign neighbours of every particle, 0 to 1.
    across : ndarray, shape (m, 3)
        Unit direction across the line.
    crossing : ndarray, shape (m,)
        A_cc = <(p·c)²> of the particles around: 0 if no fibre crosses, 1/3 in the isotropic case, 1 if all do.
    normal_across : ndarray, shape (m,)
        N_cc = <(r·c)²>, near 1 where platelets stand back to back; NaN if r is not known.
    """

    index: np.ndarray
    share: np.ndarray
    across: np.ndarray
    crossing: np.ndarray
    normal_across: np.ndarray

    def __len__(self) -> int:
        return len(self.index)


def find_knit_lines(
    positions: np.ndarray,
    reference: np.ndarray,
    spacing: float,
    fibre_direction: np.ndarray,
    platelet_normal: np.ndarray | None = None,
    deformation_gradient: np.ndarray | None = None,
    volume: np.ndarray | None = None,
) -> KnitLine:
    """Find knit lines and measure what crosses them.

    Parameters
    ----------
    positions, reference : ndarray, shape (n, 3)
        Places now and at the start, mm.
    spacing : float
        Distance of neighbours, mm.
    fibre_direction, platelet_normal : ndarray, shape (n, 3)
        p and r.
    deformation_gradient : ndarray, shape (n, 9) or (n, 3, 3), optional
        F. Without it the raw distance at the start decides, which takes large stretches for knit lines.
    volume : ndarray, shape (n,), optional
        Weights of the averages around; equal if left out.
    """
    from scipy.spatial import cKDTree

    n = len(positions)
    k = min(NEIGHBOURS + 1, n)
    if n <= LEAST_NEIGHBOURS:
        empty = np.empty(0)
        return KnitLine(np.empty(0, dtype=np.int64), np.zeros(n), np.empty((0, 3)), empty, empty)
    tree = cKDTree(positions)
    # Neighbours count within a reach only: at a free surface the twentieth nearest may be far away.
    _, near = tree.query(positions, k=k, distance_upper_bound=2.5 * spacing)
    present = near[:, 1:] < n
    others = np.where(present, near[:, 1:], 0)
    now = positions[others] - positions[:, None]
    start = reference[others] - reference[:, None]
    if deformation_gradient is not None:
        F = np.asarray(deformation_gradient, dtype=float).reshape(n, 3, 3)
        start = start - np.einsum("nij,nkj->nki", np.linalg.inv(F), now)
    else:
        start = start - now
    foreign = present & (np.linalg.norm(start, axis=2) > FOREIGN_SPACINGS * spacing)
    count = present.sum(axis=1)
    share = foreign.sum(axis=1) / np.maximum(count, 1)
    index = np.flatnonzero((share >= LEAST_SHARE) & (count >= LEAST_NEIGHBOURS))
    if not len(index):
        empty = np.empty(0)
        return KnitLine(index, share, np.empty((0, 3)), empty, empty)
    across = _directions(now[index], foreign[index], present[index])
    around = tree.query_ball_point(positions[index], REACH_SPACINGS * spacing)
    weights = np.ones(n) if volume is None else volume

    def share_across(directions: np.ndarray) -> np.ndarray:
        pairs = zip(around, across, strict=True)
        return np.array([np.average((directions[a] @ c) ** 2, weights=weights[a]) for a, c in pairs])

    crossing, normal = share_across(fibre_direction), np.full(len(index), np.nan)
    if platelet_normal is not None:
        normal = share_across(platelet_normal)
    return KnitLine(index, share, across, crossing, normal)


def _directions(now: np.ndarray, foreign: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the direction from a particle's own neighbours towards its foreign ones, shape (m, 3)."""
    own = present & ~foreign

    def mean(mask: np.ndarray) -> np.ndarray:
        return np.asarray((now * mask[:, :, None]).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)[:, None])

    step = mean(foreign) - mean(own)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(np.divide(step, length, out=np.zeros_like(step), where=length > 0))
