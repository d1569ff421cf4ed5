"""From particles or voxels to the elements of a structural mesh: nearest neighbour, or averages over the elements.

Nearest neighbour is the papers' way (J section IV, A section 4): vectors have no average. The average gives every
particle wholly to one element, so that volumes add up; it yields tensors, and their principal axes as directions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.analysis.averages.averages import RegionAverages, RegionSums
from ppmc.analysis.averages.moments import N_SUMS, sum_owned
from ppmc.errors import InputFileError
from ppmc.orientation import normalise
from ppmc.particles import Particles

EQUALLY_NEAR = 1e-5
"""Relative difference of distances below which the digits of a mesh file decide, not the mesh."""
MOST_TIED = 8
"""Points that are equally near at most: the corners of a cell of the particles' lattice."""

Array = NDArray[np.float64]
Owners = Callable[[Array], NDArray[np.int64]]


@dataclass(frozen=True)
class MappedElements:
    """What each of m elements received.

    Attributes
    ----------
    fibre_direction, in_plane_direction, platelet_normal : ndarray, shape (m, 3)
        p, q = r × p, r; orthonormal. NaN where nothing is known.
    fibre_tensor, normal_tensor : ndarray, shape (m, 3, 3)
        A and N: of the one nearest point, or averages.
    fibre_tensor4, normal_tensor4 : ndarray, shape (m, 3, 3, 3, 3)
        𝔸 and ℕ, likewise.
    fibre_spread, normal_spread : ndarray, shape (m, 3, 3)
        Standard deviation of p_i p_j and r_i r_j over the element; zero for a single point.
    distance : ndarray, shape (m,)
        From the element's centre to the nearest point, mm.
    particle_count : ndarray, shape (m,)
        Points averaged; 1 for nearest neighbour. 0 marks elements without material: everything else of theirs is NaN,
        or the nearest point's where that is asked for.
    material_volume : ndarray, shape (m,)
        Volume of these points, mm³; adds up to the whole for averages.
    """

    fibre_direction: Array
    in_plane_direction: Array
    platelet_normal: Array
    fibre_tensor: Array
    normal_tensor: Array
    fibre_tensor4: Array
    normal_tensor4: Array
    fibre_spread: Array
    normal_spread: Array
    distance: Array
    particle_count: NDArray[np.int64]
    material_volume: Array


def map_to_elements(
    centres: Array,
    parts: Iterable[Particles],
    owners: Owners | None = None,
    *,
    within: Array | float = np.inf,
    fill: bool = False,
) -> MappedElements:
    """Map directions to elements.

    Parameters
    ----------
    centres : ndarray, shape (m, 3)
        Element centres, mm.
    parts : iterable of Particles
        The points, in disjoint parts that fit memory one at a time.
    owners : callable, optional
        Gives the element that each place, shape (n, 3), belongs to: averages. Without it every element takes the
        nearest point.
    within : ndarray, shape (m,), or float
        Without owners: elements whose nearest point is farther from their centre have no material.
    fill : bool
        Give elements without material the nearest point's directions all the same.

    Raises
    ------
    InputFileError
        If there is no point at all.
    """
    from scipy.spatial import cKDTree

    m = len(centres)
    distance = np.full(m, np.inf)
    p, r, volume = np.full((m, 3), np.nan), np.full((m, 3), np.nan), np.zeros(m)
    sums = np.zeros((m, N_SUMS))
    for part in parts:
        if not len(part) or part.fibre_direction is None:
            continue
        found, index = _nearest(cKDTree(part.positions), centres)
        nearer = found < distance * (1.0 - EQUALLY_NEAR)
        at = index[nearer]
        distance[nearer] = found[nearer]
        p[nearer], volume[nearer] = part.fibre_direction[at], part.volume[at]
        if part.platelet_normal is not None:
            r[nearer] = part.platelet_normal[at]
        if owners is not None:
            owner = owners(part.positions)
            sums += sum_owned(part.positions, part.volume, part.fibre_direction, part.platelet_normal, owner, m)
    if not np.isfinite(distance).any():
        raise InputFileError("there is no point with a known direction to map from")
    count = (distance <= within).astype(np.int64) if owners is None else sums[:, 0].astype(np.int64)
    own = count > 0
    if not fill:
        p[~own], r[~own] = np.nan, np.nan
    nearest = sum_owned(centres, np.ones(m), p, r, np.arange(m), m)
    if owners is None:
        volume[~own] = 0.0
        return _with_frames(p, r, RegionSums((), nearest).averages(), distance, count, volume)
    # What is filled takes the nearest point's tensors, without a volume of its own.
    averages = RegionSums((), np.where(own[:, None], sums, nearest if fill else 0.0)).averages()
    for v, tensor in ((p, averages.fibre_tensor), (r, averages.normal_tensor)):
        known = own & np.isfinite(tensor).all(axis=(1, 2))
        v[known] = np.linalg.eigh(tensor[known])[1][..., -1]
    return _with_frames(p, r, averages, distance, count, sums[:, 1].copy())


def _nearest(tree: Any, centres: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return distance and number of each centre's nearest point, the first of those that are equally near.

    In a regular mesh over regular particles ties are the rule; the last digits of a file shall not decide them.
    """
    found, index = (np.asarray(v).reshape(len(centres), -1) for v in tree.query(centres, k=min(MOST_TIED, tree.n)))
    tied = found <= found[:, :1] * (1.0 + EQUALLY_NEAR)
    return found[:, 0], np.where(tied, index, tree.n).min(axis=1)


def _with_frames(
    p: Array,
    r: Array,
    averages: RegionAverages,
    distance: Array,
    count: NDArray[np.int64],
    volume: Array,
) -> MappedElements:
    """Complete the axes: r is made orthogonal to p, as principal axes of averages need not be."""
    with np.errstate(invalid="ignore"):
        r = np.asarray(normalise(r - np.sum(r * p, axis=1, keepdims=True) * p), dtype=np.float64)
        q = np.cross(r, p)
    axes = {"fibre_direction": p, "in_plane_direction": q, "platelet_normal": r}
    own = {"distance": distance, "particle_count": count, "material_volume": volume}
    shared = {f.name: getattr(averages, f.name) for f in fields(MappedElements) if f.name not in {*axes, *own}}
    return MappedElements(**axes, **own, **shared)  # type: ignore[arg-type]
