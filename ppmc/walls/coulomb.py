r"""Coulomb friction: :math:`\tau \le \mu p`, with equality where the charge slides and sticking where it does not."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ppmc.walls.law import Array, WallSection


class CoulombFriction(WallSection):
    """A dry wall: the charge slides where the traction reaches a share of the pressure, and sticks elsewhere."""

    law: Literal["coulomb"] = "coulomb"
    """Name of the law."""
    coefficient: float = Field(gt=0, le=10, examples=[0.2])
    """mu, traction over pressure where it slides."""

    def traction(self, speed: Array, pressure: Array) -> Array:
        """Return mu times the pressure at any speed, shape (m,), Pa."""
        return self.coefficient * pressure
