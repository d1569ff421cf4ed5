"""Newtonian fluid: the anisotropic model at R = 1."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ppmc.scene.base import Section
from ppmc.scene.units import PositiveViscosity


class Newtonian(Section):
    """Isotropic viscous fluid."""

    model: Literal["newtonian"] = "newtonian"
    """Name of the model."""
    shear_viscosity: PositiveViscosity = Field(examples=["5.36 Pa*s"])
    """Viscosity in shear, Pa s."""

    @property
    def shear(self) -> float:
        """Shear viscosity, Pa s."""
        return self.shear_viscosity

    @property
    def ratio(self) -> float:
        """Anisotropy ratio: 1."""
        return 1.0
