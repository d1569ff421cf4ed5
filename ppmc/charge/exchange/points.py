"""Orientations at points, as every exchange format gives them, and the checks they all pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.orientation import normalise
from ppmc.particles import Particles

Array = NDArray[np.floating]
# Directions from text files carry few digits; a length off by more than this is no rounding.
LENGTH_TOLERANCE = 1e-2
ANGLE_TOLERANCE = 1e-2
FARTHEST = 1e9  # mm


def oriented_points(
    source: str, positions: Array, fibre_direction: Array, platelet_normal: Array, volume: Array | None = None,
    platelet_id: NDArray[np.int64] | None = None,
) -> Particles:  # fmt: skip
    """Return points whose directions are of unit length and perpendicular to double precision.

    Parameters
    ----------
    source : str
        File, or another name of where they come from, for messages.
    positions, fibre_direction, platelet_normal : ndarray, shape (n, 3)
        Position in mm, p and r.
    volume : ndarray, shape (n,), optional
        Volumes, mm^3; all count the same if left out.
    platelet_id : ndarray, shape (n,), optional
        Platelets, -1 for none.

    Raises
    ------
    InputFileError
        If there are no points, a number is not finite, or directions are neither of unit length nor perpendicular
        within one per cent; with the first point at fault.
    """
    n = len(positions)
    if n == 0:
        raise InputFileError(f"{source}: holds no point")
    for name, values in (("position", positions), ("p", fibre_direction), ("r", platelet_normal)):
        if values.shape != (n, 3):
            raise InputFileError(f"{source}: {name} has shape {values.shape}, must be ({n}, 3)")
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise InputFileError(f"{source}: {name} of point {bad[0] + 1} is not finite: {values[bad[0]].tolist()}")
    bad = np.flatnonzero((np.abs(positions) > FARTHEST).any(axis=1))
    if len(bad):
        where = positions[bad[0]].tolist()
        raise InputFileError(
            f"{source}: position of point {bad[0] + 1} is {where} mm: beyond any part; correct the unit"
        )
    for name, values in (("p", fibre_direction), ("r", platelet_normal)):
        size = np.linalg.norm(values, axis=1)
        bad = np.flatnonzero(np.abs(size - 1.0) > LENGTH_TOLERANCE)
        if len(bad):
            raise InputFileError(
                f"{source}: {name} of point {bad[0] + 1} has length {size[bad[0]]:.4g}, must be 1 "
                f"({len(bad):,} points of {n:,})"
            )
    p, r = normalise(fibre_direction), normalise(platelet_normal)
    along = np.abs(np.sum(p * r, axis=1))
    bad = np.flatnonzero(along > ANGLE_TOLERANCE)
    if len(bad):
        raise InputFileError(
            f"{source}: p and r of point {bad[0] + 1} are not perpendicular (p.r = {along[bad[0]]:.3g}; "
            f"{len(bad):,} points of {n:,})"
        )
    r = normalise(r - np.sum(r * p, axis=1, keepdims=True) * p)
    return Particles(source, positions, np.ones(n) if volume is None else volume, p, r, platelet_id)
