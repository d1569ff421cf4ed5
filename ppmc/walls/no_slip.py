"""No slip: the material at the wall moves with it."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ppmc.walls.law import Array, WallSection


class NoSlip(WallSection):
    """A wall that the material sticks to."""

    law: Literal["no_slip"] = "no_slip"
    """Name of the law."""

    @property
    def slip_length(self) -> float:
        """Zero, mm/(Pa s)."""
        return 0.0

    def traction(self, speed: Array, pressure: Array) -> Array:
        """Return whatever it takes, shape (m,), Pa: no bound."""
        return np.full_like(speed, np.inf)
