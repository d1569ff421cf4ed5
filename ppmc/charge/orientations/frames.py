"""What every source of orientations returns: one platelet frame for each particle, and where it came from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.orientation import in_plane_from_normal

Array = NDArray[np.floating]

# Codes of the field `orientation_source`.
DEFAULT, FROM_CT, RANDOM, REGIONAL, DRAPED, GIVEN = 0, 1, 2, 3, 4, 5


@dataclass(frozen=True)
class Frames:
    """Platelet frames of n particles.

    Attributes
    ----------
    fibre_direction, platelet_normal : ndarray, shape (n, 3)
        p and r, unit length and perpendicular.
    source : ndarray, shape (n,), int32
        Code of the field `orientation_source`.
    platelet_id, region_id : ndarray, shape (n,), int
        -1 for none.
    confidence : ndarray, shape (n,)
        1 where the direction is given, not measured.
    notes : dict
        Figures about how the frames came about, stored in the charge file and printed.
    """

    fibre_direction: Array
    platelet_normal: Array
    source: NDArray[np.int32]
    platelet_id: NDArray[np.int64]
    region_id: NDArray[np.int32]
    confidence: Array
    notes: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, fibre_direction: Array, platelet_normal: Array, source: int, **notes: Any) -> Frames:
        """Return frames of one source, without platelets or regions."""
        n = len(fibre_direction)
        return cls(
            fibre_direction,
            platelet_normal,
            np.full(n, source, dtype=np.int32),
            np.full(n, -1, dtype=np.int64),
            np.full(n, -1, dtype=np.int32),
            np.ones(n),
            dict(notes),
        )

    @property
    def in_plane_direction(self) -> Array:
        """q-hat, shape (n, 3): before any flow it is perpendicular to p, q-hat = q = r x p."""
        return in_plane_from_normal(self.fibre_direction, self.platelet_normal)

    def with_ids(self, platelet_id: NDArray[np.int64]) -> Frames:
        """Return the same frames with platelet ids."""
        return replace(self, platelet_id=platelet_id.astype(np.int64))
