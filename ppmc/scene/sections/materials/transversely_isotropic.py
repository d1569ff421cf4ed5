"""Transversely isotropic viscous platelets (J, section II.B; A; D)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from ppmc.scene.base import Section
from ppmc.scene.sections.materials.relations import (
    HEXAGONAL_PACKING,
    ratio_from_aspect,
    ratio_from_viscosities,
    shear_factor,
)
from ppmc.scene.units import PositiveViscosity

# A thousand times that of the stiffest platelets published (61,215, J); beyond, rounding of forces along fibres reaches
# those between them.
MOST_ANISOTROPIC = 1e8


class AnisotropicViscosity(Section):
    """Viscosities shared by all models with fibres: one way of giving each of the two constants."""

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


class TransverselyIsotropic(AnisotropicViscosity):
    """One fibre direction a particle; the papers' material."""

    model: Literal["transversely_isotropic"] = "transversely_isotropic"
    """Name of the model."""
