r"""Planar uniform fibres about the normal of the nearest tool (D4, D5).

:math:`A = \tfrac12(I - nn)` and its fourth-order partner are reproduced exactly by three directions in the plane, 60
degrees apart, with equal fractions: a trigonometric polynomial of degree four is integrated exactly by three equally
spaced axes.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from ppmc.materials.anisotropic import AnisotropicViscosity
from ppmc.materials.law import Array, Even, LocalState


class PlanarUniform(AnisotropicViscosity):
    """All in-plane directions alike; the plane follows the nearest tool, not the deformation."""

    model: Literal["planar_uniform"] = "planar_uniform"
    """Name of the model."""

    follows_walls: ClassVar[bool] = True

    def directions(self, local: LocalState) -> Array:
        """Return three axes along the nearest wall, shape (n, 3, 3)."""
        assert local.wall_normal is not None
        return three_axes(local.wall_normal)

    def viscosities(self, rate: Array, directions: Array, local: LocalState) -> tuple[Array, Array]:
        """Return eta23, shape (n,), and a third of the fibres' stiffness for each axis, shape (n, 3)."""
        stiffness = 4.0 * self.shear * (self.ratio - 1.0) / 3.0
        return np.full(len(local), self.shear), np.full((len(local), 3), stiffness)

    def even_as(self) -> Even:
        """Deforms evenly as a Newtonian fluid where R = 1, else as planar random fibres do."""
        return "newtonian" if self.ratio == 1.0 else "planar"


def three_axes(normals: Array) -> Array:
    """Three unit axes 60 degrees apart in the planes normal to `normals` (n, 3); shape (n, 3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angles = np.pi / 3.0 * np.arange(3)
    return np.asarray(
        np.cos(angles)[None, :, None] * first[:, None, :] + np.sin(angles)[None, :, None] * second[:, None, :]
    )
