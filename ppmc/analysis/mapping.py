"""From particles or voxels to the elements of a structural mesh: nearest neighbour, or a conservative average.

Nearest neighbour is the papers' way (J section IV, A section 4): vectors have no average. The conservative way gives
every particle wholly
to the element whose centre is nearest, so that volumes add up; it yields tensors, and their principal axes as
directions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ppmc.analysis.averages import FOURTH, from_fourth
from ppmc.analysis.samples import Samples
from ppmc.errors import InputFileError
from ppmc.orientation import from_six, normalise, to_six

Array = NDArray[np.float64]
Method = Literal["nearest", "average"]


@dataclass(frozen=True)
class MappedElements:
    """What each of m elements received.

    Attributes
    ----------
    fibre_direction, in_plane_direction, platelet_normal : ndarray, shape (m, 3)
        p, q = r × p, r; orthonormal. NaN where nothing is known.
    fibre_tensor, normal_tensor : ndarray, shape (m, 3, 3)
        A and N: of the one nearest point, or averages.
    fibre_tensor4 : ndarray, shape (m, 3, 3, 3, 3)
        𝔸, likewise.
    distance : ndarray, shape (m,)
        From the element's centre to the nearest point, mm.
    particle_count : ndarray, shape (m,)
        Points averaged; 1 for nearest neighbour. 0 marks elements that took the nearest point for want of any of
        their own.
    material_volume : ndarray, shape (m,)
        Volume of these points, mm³; adds up to the whole for the conservative average.
    """

    fibre_direction: Array
    in_plane_direction: Array
    platelet_normal: Array
    fibre_tensor: Array
    normal_tensor: Array
    fibre_tensor4: Array
    distance: Array
    particle_count: NDArray[np.int64]
    material_volume: Array


def map_to_elements(centres: Array, parts: Iterable[Samples], method: Method = "nearest") -> MappedElements:
    """Map directions to elements.

    Parameters
    ----------
    centres : ndarray, shape (m, 3)
        Element centres, mm.
    parts : iterable of Samples
        The points, in disjoint parts that fit memory one at a time.
    method : {"nearest", "average"}
        Nearest point, or conservative average.

    Raises
    ------
    InputFileError
        If there is no point at all.
    """
    from scipy.spatial import cKDTree

    m = len(centres)
    distance = np.full(m, np.inf)
    p, r, volume = np.full((m, 3), np.nan), np.full((m, 3), np.nan), np.zeros(m)
    sums, count = np.zeros((m, 28)), np.zeros(m, dtype=np.int64)
    elements = cKDTree(centres) if method == "average" else None
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
        if elements is not None:
            owner = elements.query(part.positions)[1]
            _accumulate(sums, owner, part)
            count += np.bincount(owner, minlength=m)
    if not np.isfinite(distance).any():
        raise InputFileError("there is no point with a known direction to map from")
    A, N = p[:, :, None] * p[:, None, :], r[:, :, None] * r[:, None, :]
    A4 = A[:, :, :, None, None] * A[:, None, None, :, :]
    if elements is None:
        return _with_frames(p, r, A, N, A4, distance, np.ones(m, dtype=np.int64), volume)
    own = count > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        means = sums / sums[:, 12:13]
    A[own], N[own], A4[own] = from_six(means[own, :6]), from_six(means[own, 6:12]), from_fourth(means[own, 13:])
    p[own] = np.linalg.eigh(A[own])[1][..., -1]
    whole = own & np.isfinite(N).all(axis=(1, 2))
    r[whole] = np.linalg.eigh(N[whole])[1][..., -1]
    return _with_frames(p, r, A, N, A4, distance, count, sums[:, 12].copy())


def abaqus_distribution(mapped: MappedElements, element_numbers: NDArray[np.int64], name: str = "ppmc") -> str:
    """Return the lines that give each element its local axes 1 = p, 2 = q in Abaqus.

    A ``*DISTRIBUTION`` of six numbers an element (a point on axis 1 and one in the 1-2 plane) with the
    ``*ORIENTATION`` that uses it; include it in
    the input file. Elements whose directions are not known keep the default first line.
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


def _accumulate(sums: Array, owner: NDArray[np.int64], part: Samples) -> None:
    """Add V p p, V r r, V and the 15 components of V p p p p of every point to the sums of its element."""
    p = part.fibre_direction
    r = part.platelet_normal
    m = len(sums)
    for start, v in ((0, p), (6, r)):
        if v is None:
            sums[:, start : start + 6] = np.nan
            continue
        dyads = to_six(v[:, :, None] * v[:, None, :])
        for k in range(6):
            sums[:, start + k] += np.bincount(owner, weights=part.volume * dyads[:, k], minlength=m)
    sums[:, 12] += np.bincount(owner, weights=part.volume, minlength=m)
    if p is not None:
        for k, (a, b, c, d) in enumerate(FOURTH):
            weights = part.volume * p[:, a] * p[:, b] * p[:, c] * p[:, d]
            sums[:, 13 + k] += np.bincount(owner, weights=weights, minlength=m)


def _with_frames(
    p: Array,
    r: Array,
    A: Array,
    N: Array,
    A4: Array,
    distance: Array,
    count: NDArray[np.int64],
    volume: Array,
) -> MappedElements:
    """Complete the axes: r is made orthogonal to p, as principal axes of averages need not be."""
    with np.errstate(invalid="ignore"):
        r = np.asarray(normalise(r - np.sum(r * p, axis=1, keepdims=True) * p), dtype=np.float64)
        q = np.cross(r, p)
    return MappedElements(p, q, r, A, N, A4, distance, count, volume)
