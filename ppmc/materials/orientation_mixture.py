"""Several fibre directions in one material point, with volume fractions (A3)."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from ppmc.materials.anisotropic import AnisotropicViscosity
from ppmc.materials.law import Array, Even, LocalState
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

    def directions(self, local: LocalState) -> Array:
        """Return the directions, shape (n, k, 3), all convected with F from their angles at the start.

        A direction at angle a is a material line, cos(a) p + sin(a) q at the start. Convected lines keep their
        components on the convected (unnormalised) p and q-hat, whose lengths follow from F.
        """
        angles = np.radians(np.array(self.angles))
        inverse = np.linalg.inv(local.deformation_gradient)
        p0 = _unit(np.einsum("nab,nb->na", inverse, local.fibre_direction))
        q0 = np.einsum("nab,nb->na", inverse, local.in_plane_direction)
        q0 = _unit(q0 - np.einsum("na,na->n", q0, p0)[:, None] * p0)
        lines = np.cos(angles)[None, :, None] * p0[:, None, :] + np.sin(angles)[None, :, None] * q0[:, None, :]
        return _unit(np.einsum("nab,nkb->nka", local.deformation_gradient, lines))

    def viscosities(self, rate: Array, directions: Array, local: LocalState) -> tuple[Array, Array]:
        """Return eta23, shape (n,), and the stiffness of each direction by its fraction, shape (n, k)."""
        stiffness = 4.0 * self.shear * (self.ratio - 1.0) * np.array(self.fractions)
        return np.full(len(local), self.shear), np.broadcast_to(stiffness, (len(local), len(stiffness))).copy()

    def even_as(self) -> Even | None:
        """Deforms evenly as a Newtonian fluid where R = 1; what mixtures do has no closed form here."""
        return "newtonian" if self.ratio == 1.0 else None


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
