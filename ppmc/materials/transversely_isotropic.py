"""Transversely isotropic viscous platelets, one fibre direction a particle (J5; J, section II.B; A; D)."""

from __future__ import annotations

from typing import Literal

from ppmc.materials.anisotropic import AnisotropicViscosity


class TransverselyIsotropic(AnisotropicViscosity):
    """One fibre direction a particle; the papers' material."""

    model: Literal["transversely_isotropic"] = "transversely_isotropic"
    """Name of the model."""
