r"""Power-law shear thinning (Ostwald, de Waele), with a plateau at rates too low to matter.

.. math:: \eta_{23} = \eta_r\,\big[(\dot\gamma^2 + \dot\gamma_0^2)/\dot\gamma_r^2\big]^{(n-1)/2}

The unit of the consistency m in the usual form :math:`\eta = m\dot\gamma^{n-1}` hangs on n; a viscosity at a rate says
the same without, :math:`m = \eta_r\dot\gamma_r^{1-n}`. The rate is that of :func:`ppmc.materials.law.effective_rate`.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ppmc.materials.thinning import ThinningViscosity
from ppmc.scene.units import PositiveStrainRate

PLATEAU = 1e-3  # of the reference rate: changes the viscosity there by (1 - n)/2 of a millionth


class PowerLaw(ThinningViscosity):
    """Shear thinning by a power of the rate; `shear_viscosity` is the value at `reference_rate`."""

    model: Literal["power_law"] = "power_law"
    """Name of the model."""
    reference_rate: PositiveStrainRate = Field(examples=["1 1/s"])
    """Shear rate at which the viscosity is `shear_viscosity`, 1/s."""
    exponent: float = Field(gt=0, le=1, examples=[0.4])
    """n, the power of the rate with which shear stress rises."""
    plateau_rate: PositiveStrainRate | None = Field(default=None, examples=["0.001 1/s"])
    """Rate below which the viscosity stays what it is, 1/s; a thousandth of `reference_rate` if left out."""

    @model_validator(mode="after")
    def _below(self) -> PowerLaw:
        if self.plateau > self.reference_rate:
            raise ValueError(
                f"`plateau_rate` {self.plateau:g} 1/s is above `reference_rate` {self.reference_rate:g} 1/s"
            )
        return self

    @property
    def plateau(self) -> float:
        """Rate below which the viscosity stays what it is, 1/s."""
        return PLATEAU * self.reference_rate if self.plateau_rate is None else self.plateau_rate

    def shear_at(self, rate: Any) -> Any:
        """Return eta23, Pa s, at effective rates, 1/s."""
        squares = (np.square(rate) + self.plateau**2) / self.reference_rate**2
        return self.shear * squares ** (0.5 * (self.exponent - 1.0))
