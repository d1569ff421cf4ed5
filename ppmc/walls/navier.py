r"""Navier friction: :math:`\tau = \lambda_f v`, a film of fluid between charge and wall."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from ppmc.scene.units import FrictionCoefficient
from ppmc.walls.law import Array, WallSection


class NavierFriction(WallSection):
    """A wall with a tangential traction in proportion to the sliding velocity, tau = friction * v."""

    law: Literal["navier"] = "navier"
    """Name of the law; may be left out."""
    friction: FrictionCoefficient = Field(examples=["0.5 Pa*s/mm"])
    """Wall friction coefficient, Pa s/mm."""

    @property
    def slip_length(self) -> float:
        """One over the friction, mm/(Pa s)."""
        return 1.0 / self.friction

    def traction(self, speed: Array, pressure: Array) -> Array:
        """Return friction times speed, shape (m,), Pa."""
        return self.friction * speed

    def described(self) -> Any:
        """Return its section in the short form, in which the name is left out."""
        return self.model_dump(mode="json", exclude={"law"})
