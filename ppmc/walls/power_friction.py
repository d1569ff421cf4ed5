r"""Power-law friction: :math:`\tau = \tau_r (v/v_r)^n`, a sheared film of shear-thinning resin (hydrodynamic friction).

The unit of k in the usual form :math:`\tau = k v^n` hangs on n; a traction at a speed says the same without,
:math:`k = \tau_r v_r^{-n}`. M. R. Barone and D. A. Caulk, J. Appl. Mech. 53 (1986), doi:10.1115/1.3171765, with n = 1.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from ppmc.scene.units import PositivePressure, PositiveVelocity
from ppmc.walls.law import Array, WallSection


class PowerFriction(WallSection):
    """A lubricated wall whose film thins: the traction rises with a power of the sliding speed."""

    law: Literal["power_law"] = "power_law"
    """Name of the law."""
    reference_traction: PositivePressure = Field(examples=["20 kPa"])
    """Traction at `reference_speed`, Pa."""
    reference_speed: PositiveVelocity = Field(examples=["1 mm/s"])
    """Sliding speed at which the traction is `reference_traction`, mm/s."""
    exponent: float = Field(gt=0, le=2, examples=[0.5])
    """n, the power of the speed with which the traction rises."""

    def traction(self, speed: Array, pressure: Array) -> Array:
        """Return the traction at a speed, shape (m,), Pa."""
        return np.asarray(self.reference_traction * (speed / self.reference_speed) ** self.exponent)
