"""Planar uniform fibres about the normal of the nearest tool (D4, D5)."""

from __future__ import annotations

from typing import Literal

from ppmc.scene.sections.materials.transversely_isotropic import AnisotropicViscosity


class PlanarUniform(AnisotropicViscosity):
    """All in-plane directions alike; the plane follows the nearest tool, not the deformation."""

    model: Literal["planar_uniform"] = "planar_uniform"
    """Name of the model."""
