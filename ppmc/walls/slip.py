"""Slip: nothing rubs."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from ppmc.walls.law import Array, WallSection


class Slip(WallSection):
    """A wall without traction along it."""

    law: Literal["slip"] = "slip"
    """Name of the law."""

    @property
    def slip_length(self) -> float:
        """Infinite, mm/(Pa s)."""
        return math.inf

    def traction(self, speed: Array, pressure: Array) -> Array:
        """Return none, shape (m,), Pa."""
        return np.zeros_like(speed)
