"""What materials with fibres share: one way of giving each of the two viscosities, and one fibre direction."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ppmc.materials.law import Array, Even, LocalState
from ppmc.materials.relations import HEXAGONAL_PACKING, ratio_from_aspect, ratio_from_viscosities, shear_factor
from ppmc.materials.section import MaterialBase
from ppmc.scene.units import PositiveViscosity

# A thousand times that of the stiffest platelets published (61,215, J); beyond, rounding of forces along fibres reaches
# those between them.
MOST_ANISOTROPIC = 1e8


class AnisotropicViscosity(MaterialBase):
    """A shear viscosity and an anisotropy ratio; the fibres of a particle lie along its one direction p."""

    shear_viscosity: PositiveViscosity | None = Field(default=None, examples=["5.36 Pa*s"])
    """Shear viscosity eta23 = eta12 of the platelet, Pa s; or give `matrix_viscosity`."""
    matrix_viscosity: PositiveViscosity | None = Field(default=None, examples=["1 Pa*s"])
    """Viscosity eta0 of the matrix, Pa s; with `fibre_volume_fraction` it gives eta23 = kappa eta0."""
    fibre_volume_fraction: float | None = Field(default=None, ge=0, lt=HEXAGONAL_PACKING, examples=[0.6])
    """Fibre volume fraction Vf."""
    anisotropy_ratio: float | None = Field(default=None, ge=1, examples=[1000.0])
    """R = eta11/eta22, 1 for an isotropic fluid; or give `axial_viscosity` or `aspect_ratio`."""
    axial_viscosity: PositiveViscosity | None = Field(default=None, examples=["1.31 MPa*s"])
    """Viscosity eta11 along the fibre, Pa s."""
    aspect_ratio: float | None = Field(default=None, gt=0, examples=[903.4])
    """L/D of the fibres or L/H of the platelets, from which R follows by `aspect_rule`."""
    aspect_rule: Literal["pipes", "shear_lag"] = "pipes"
    """eta11/eta23 = (Vf/2) a^2 (pipes) or a^2/4 (shear_lag)."""

    @model_validator(mode="after")
    def _one_way_each(self) -> AnisotropicViscosity:
        if (self.shear_viscosity is None) == (self.matrix_viscosity is None):
            raise ValueError("give exactly one of `shear_viscosity` and `matrix_viscosity`")
        if self.matrix_viscosity is not None and self.fibre_volume_fraction is None:
            raise ValueError("`matrix_viscosity` needs `fibre_volume_fraction`")
        ways = (self.anisotropy_ratio, self.axial_viscosity, self.aspect_ratio)
        if sum(way is not None for way in ways) != 1:
            raise ValueError("give exactly one of `anisotropy_ratio`, `axial_viscosity` and `aspect_ratio`")
        if self.ratio < 1.0:
            raise ValueError(f"the viscosities give an anisotropy ratio R of {self.ratio:.4g}; it must be at least 1")
        if self.ratio > MOST_ANISOTROPIC:
            raise ValueError(
                f"an anisotropy ratio R of {self.ratio:.4g} is beyond any platelet and this arithmetic: "
                f"at most {MOST_ANISOTROPIC:g}"
            )
        return self

    @property
    def shear(self) -> float:
        """Shear viscosity eta23, Pa s."""
        if self.shear_viscosity is not None:
            return self.shear_viscosity
        assert self.matrix_viscosity is not None and self.fibre_volume_fraction is not None
        return self.matrix_viscosity * shear_factor(self.fibre_volume_fraction)

    @property
    def ratio(self) -> float:
        """Anisotropy ratio R."""
        if self.anisotropy_ratio is not None:
            return self.anisotropy_ratio
        if self.axial_viscosity is not None:
            return ratio_from_viscosities(self.axial_viscosity, self.shear)
        assert self.aspect_ratio is not None
        fraction = 0.6 if self.fibre_volume_fraction is None else self.fibre_volume_fraction
        return ratio_from_aspect(self.aspect_ratio, self.aspect_rule, fraction)

    def shear_at(self, rate: Any) -> Any:
        """Return the shear viscosity, Pa s, at any rate."""
        return np.full(np.shape(rate), self.shear)

    def directions(self, local: LocalState) -> Array:
        """Return p, shape (n, 1, 3)."""
        return local.fibre_direction[:, None, :]

    def viscosities(self, rate: Array, directions: Array, local: LocalState) -> tuple[Array, Array]:
        """Return eta23, shape (n,), and 4 eta23 (R - 1), shape (n, 1)."""
        stiffness = 4.0 * self.shear * (self.ratio - 1.0)
        return np.full(len(local), self.shear), np.full((len(local), 1), stiffness)

    def even_as(self) -> Even | None:
        """Deforms evenly as a Newtonian fluid where R = 1, else as fibres."""
        return "newtonian" if self.ratio == 1.0 else "fibres"
