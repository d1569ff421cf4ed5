"""Newtonian fluid: the anisotropic model at R = 1, without fibres."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from ppmc.materials.law import Array, Even, LocalState
from ppmc.materials.section import MaterialBase
from ppmc.scene.units import PositiveViscosity


class Newtonian(MaterialBase):
    """Isotropic viscous fluid."""

    model: Literal["newtonian"] = "newtonian"
    """Name of the model."""
    shear_viscosity: PositiveViscosity = Field(examples=["5.36 Pa*s"])
    """Viscosity in shear, Pa s."""

    @property
    def ratio(self) -> float:
        """Anisotropy ratio: 1."""
        return 1.0

    @property
    def shear(self) -> float:
        """Shear viscosity, Pa s."""
        return self.shear_viscosity

    def shear_at(self, rate: Any) -> Any:
        """Return the shear viscosity, Pa s, at any rate."""
        return np.full(np.shape(rate), self.shear)

    def viscosities(self, rate: Array, directions: Array, local: LocalState) -> tuple[Array, Array]:
        """Return the one viscosity, shape (n,), and no stiffness, shape (n, 0)."""
        return np.full(len(local), self.shear), np.zeros((len(local), 0))

    def even_as(self) -> Even:
        """Deforms evenly as what it is."""
        return "newtonian"
