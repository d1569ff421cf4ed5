"""What shear-thinning materials share: the anisotropic tensor, scaled by how far its effective rate has thinned it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ppmc.materials.anisotropic import AnisotropicViscosity
from ppmc.materials.law import Array, LocalState, effective_rate


class ThinningViscosity(AnisotropicViscosity):
    """An anisotropic viscosity whose eta23 falls with the effective rate, and eta11 with it: R stays what it is.

    A material of this kind says what `shear_at` is; R = 1 makes it an isotropic fluid.
    """

    rate_dependent: ClassVar[bool] = True

    def viscosities(self, rate: Array, directions: Array, local: LocalState) -> tuple[Array, Array]:
        """Return eta23, shape (n,), at the effective rates, and 4 eta23 (R - 1), shape (n, 1)."""
        stiffening = 4.0 * (self.ratio - 1.0)
        shear = np.asarray(self.shear_at(effective_rate(rate, directions, np.full(1, stiffening))))
        return shear, stiffening * shear[:, None]
