"""From particles or voxels to the elements of a structural mesh: nearest neighbour, or averages over the elements.

Nearest neighbour is the papers' way (J section IV, A section 4): vectors have no average. The average gives every
particle wholly to one element, so that volumes add up; it yields tensors, and their principal axes as directions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ppmc.analysis.averages import RegionAverages, RegionSums
from ppmc.analysis.moments import N_SUMS, sum_owned
from ppmc.analysis.samples import Samples
from ppmc.errors import InputFileError
from ppmc.orientation import normalise

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
        Points averaged; 1 for nearest neighbour. 0 marks elements that took the nearest point for want of any of
        their own.
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


def map_to_elements(centres: Array, parts: Iterable[Samples], owners: Owners | None = None) -> MappedElements:
    """Map directions to elements.

    Parameters
    ----------
    centres : ndarray, shape (m, 3)
        Element centres, mm.
    parts : iterable of Samples
        The points, in disjoint parts that fit memory one at a time.
    owners : callable, optional
        Gives the element that each place, shape (n, 3), belongs to: averages. Without it every element takes the
        nearest point.

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
        found, index = cKDTree(part.positions).query(centres)
        nearer = found < distance
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
    nearest = sum_owned(centres, np.ones(m), p, r, np.arange(m), m)
    if owners is None:
        return _with_frames(p, r, RegionSums((), nearest).averages(), distance, np.ones(m, dtype=np.int64), volume)
    count = sums[:, 0].astype(np.int64)
    own = count > 0
    # What no particle lies in takes the nearest point's tensors, without a volume of its own.
    averages = RegionSums((), np.where(own[:, None], sums, nearest)).averages()
    for v, tensor in ((p, averages.fibre_tensor), (r, averages.normal_tensor)):
        known = own & np.isfinite(tensor).all(axis=(1, 2))
        v[known] = np.linalg.eigh(tensor[known])[1][..., -1]
    return _with_frames(p, r, averages, distance, count, sums[:, 1].copy())


def abaqus_distribution(mapped: MappedElements, element_numbers: NDArray[np.int64], name: str = "ppmc") -> str:
    """Return the lines that give each element its local axes 1 = p, 2 = q in Abaqus.

    A ``*DISTRIBUTION`` of six numbers an element (a point on axis 1 and one in the 1-2 plane) with the
    ``*ORIENTATION`` that uses it; include it in the input file, and name it in ``*SOLID SECTION, ORIENTATION``.
    Elements whose directions are not known keep the default first line.
    """
    lines = [
        f"*DISTRIBUTION TABLE, NAME={name}_table",
        "COORD3D, COORD3D",
        f"*DISTRIBUTION, NAME={name}_axes, LOCATION=ELEMENT, TABLE={name}_table",
        ", 1., 0., 0., 0., 1., 0.",
    ]
    axes = np.hstack([mapped.fibre_direction, mapped.in_plane_direction])
    for number, row in zip(element_numbers, axes, strict=True):
        if np.isfinite(row).all():
            lines.append(f"{number}, " + ", ".join(f"{v:.6f}" for v in row))
    lines += [f"*ORIENTATION, NAME={name}", f"{name}_axes", "3, 0."]
    return "\n".join(lines) + "\n"


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
