r"""Carreau-Yasuda shear thinning, between two plateaus.

.. math:: \eta_{23} = \eta_\infty + (\eta_0 - \eta_\infty)\,[1 + (\lambda\dot\gamma)^a]^{(n-1)/a}

P. J. Carreau, Trans. Soc. Rheol. 16 (1972), doi:10.1122/1.549276; K. Yasuda et al., Rheol. Acta 20 (1981),
doi:10.1007/BF01513059. The rate is the effective one of :func:`ppmc.materials.law.effective_rate`.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ppmc.materials.thinning import ThinningViscosity
from ppmc.scene.units import PositiveTime, Viscosity


class CarreauYasuda(ThinningViscosity):
    """Shear thinning between a plateau at rest, which is `shear_viscosity`, and one at infinite rate."""

    model: Literal["carreau_yasuda"] = "carreau_yasuda"
    """Name of the model."""
    relaxation_time: PositiveTime = Field(examples=["0.5 s"])
    """lambda, s: thinning sets in at the rate 1/lambda."""
    exponent: float = Field(gt=0, le=1, examples=[0.4])
    """n, the power of the rate with which shear stress rises between the plateaus."""
    transition: float = Field(default=2.0, gt=0, le=100)
    """a, how sharp the knee at 1/lambda is; 2 is Carreau's model."""
    infinite_viscosity: Viscosity = Field(default=0.0, examples=["0.1 Pa*s"])
    """Shear viscosity at infinite rate, Pa s."""

    @model_validator(mode="after")
    def _thins(self) -> CarreauYasuda:
        if self.infinite_viscosity > self.shear:
            raise ValueError(
                f"`infinite_viscosity` {self.infinite_viscosity:g} Pa s is above that at rest, {self.shear:g} Pa s"
            )
        return self

    def shear_at(self, rate: Any) -> Any:
        """Return eta23, Pa s, at effective rates, 1/s."""
        knee = 1.0 + (self.relaxation_time * np.asarray(rate)) ** self.transition
        falling = knee ** ((self.exponent - 1.0) / self.transition)
        return self.infinite_viscosity + (self.shear - self.infinite_viscosity) * falling
