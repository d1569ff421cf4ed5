"""Several fibre directions in one material point, with volume fractions (A3)."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from ppmc.scene.sections.materials.transversely_isotropic import AnisotropicViscosity
from ppmc.scene.units import Angle


class OrientationMixture(AnisotropicViscosity):
    """Layers of different fibre direction within each particle, all convected with its deformation."""

    model: Literal["orientation_mixture"] = "orientation_mixture"
    """Name of the model."""
    angles: tuple[Angle, ...] = Field(min_length=1, examples=[[0, 90]])
    """Angle of each direction from the particle's fibre direction p towards q in the platelet plane, degrees."""
    fractions: tuple[float, ...] = Field(min_length=1, examples=[[0.5, 0.5]])
    """Volume fraction of each direction; they add up to 1."""

    @model_validator(mode="after")
    def _fractions(self) -> OrientationMixture:
        if len(self.angles) != len(self.fractions):
            raise ValueError(f"{len(self.angles)} `angles` but {len(self.fractions)} `fractions`; give one each")
        if min(self.fractions) < 0 or not math.isclose(sum(self.fractions), 1.0, abs_tol=1e-9):
            raise ValueError(f"`fractions` must be positive and add up to 1, not {sum(self.fractions):.6g}")
        return self
