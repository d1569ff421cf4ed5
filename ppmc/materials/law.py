r"""What a material is to the solver: viscosities and directions at a point, from the state there.

The stress is that of J5 with one shear viscosity and a stiffness a direction, :math:`m_k = p_k\otimes p_k - I/3`,

.. math:: \tau = \sum_k s_k\,(D:m_k)\,m_k + 2\eta_{23}\,\mathrm{dev}\,D, \qquad s_k = 4\eta_{23}(R-1)\,v_k .

A material gives :math:`\eta_{23}` and :math:`s_k` of every particle, which may depend on the rate D, and the directions
:math:`p_k`, which may not. Everything else follows from these.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ppmc.scene.base import description_of

Array = NDArray[np.float64]
Even = Literal["newtonian", "fibres", "planar"]


@dataclass(frozen=True)
class LocalState:
    """What a material may know of n points.

    Attributes
    ----------
    fibre_direction, in_plane_direction : ndarray, shape (n, 3)
        p and q-hat, unit vectors.
    deformation_gradient : ndarray, shape (n, 3, 3)
        F since the start.
    reference_position : ndarray, shape (n, 3)
        Where the material was at the start, mm.
    wall_normal : ndarray, shape (n, 3), or None
        Normal of the nearest tool, for materials that follow walls.
    """

    fibre_direction: Array
    in_plane_direction: Array
    deformation_gradient: Array
    reference_position: Array
    wall_normal: Array | None = None

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.fibre_direction)

    def rows(self, index: Any) -> LocalState:
        """Return the state of some of the points; `index` is anything that picks rows of an array."""
        normal = None if self.wall_normal is None else self.wall_normal[index]
        return LocalState(
            self.fibre_direction[index],
            self.in_plane_direction[index],
            self.deformation_gradient[index],
            self.reference_position[index],
            normal,
        )


@dataclass(frozen=True)
class Reference:
    """Viscosities by which a run chooses its constants and `ppmc check` judges it.

    Attributes
    ----------
    shear : float
        eta23, Pa s.
    ratio : float
        Anisotropy ratio R.
    """

    shear: float
    ratio: float

    @property
    def squeeze(self) -> float:
        """Viscosity (R + 2) eta23 that an even squeeze of planar random fibres meets, Pa s."""
        return (self.ratio + 2.0) * self.shear


class Material(ABC):
    """A material; subclass it for one of your own and pass that to the solver.

    `ratio` and `shear_at` are its reference values; `directions` and `viscosities` its law. An isotropic fluid needs no
    directions.

    Attributes
    ----------
    rate_dependent : bool
        Whether viscosities depend on the rate: the step then iterates until rates and viscosities agree.
    follows_walls : bool
        Whether directions are those of the nearest wall, given as ``local.wall_normal``, not the material's own.
    """

    rate_dependent: ClassVar[bool] = False
    follows_walls: ClassVar[bool] = False

    @property
    @abstractmethod
    def ratio(self) -> float:
        """Anisotropy ratio R of the stiffest point, 1 for an isotropic fluid; an attribute will do."""

    @abstractmethod
    def shear_at(self, rate: Any) -> Any:
        """Shear viscosity eta23, Pa s, at effective rates, 1/s (see :func:`effective_rate`); any shape."""

    @abstractmethod
    def viscosities(self, rate: Array, directions: Array, local: LocalState) -> tuple[Array, Array]:
        """Viscosities of n points.

        Parameters
        ----------
        rate : ndarray, shape (n, 3, 3)
            Rate of deformation D, 1/s.
        directions : ndarray, shape (n, k, 3)
            As :meth:`directions` gave them, carried along to where the step stands.
        local : LocalState

        Returns
        -------
        shear : ndarray, shape (n,)
            eta23, Pa s.
        stiffness : ndarray, shape (n, k)
            4 eta23 (R - 1) v_k of each direction, Pa s.
        """

    def directions(self, local: LocalState) -> Array:
        """Unit fibre directions, shape (n, k, 3); none unless a material says otherwise."""
        return np.zeros((len(local), 0, 3))

    def reference(self, closing_rate: float) -> Reference:
        """Viscosities that a squeeze with this closing rate, 1/s, meets."""
        return Reference(float(self.shear_at(math.sqrt(self.ratio + 2.0) * closing_rate)), self.ratio)

    def even_as(self) -> Even | None:
        """Return as what it deforms evenly in a squeeze between slip plates, so that the answer is known beforehand.

        "newtonian" for an isotropic fluid, "fibres" where each particle has the one direction p, "planar" for all
        directions along the plates alike; None, as long as a material does not say so itself.
        """
        return None

    def remarks(self, positions: Array) -> list[str]:
        """Return what looks wrong for a charge whose particles begin at `positions` (n, 3), mm; a line each."""
        return []

    def described(self) -> dict[str, Any]:
        """Return what a file keeps of it, ready for JSON."""
        return description_of(self)


def effective_rate(rate: Array, directions: Array | None = None, stiffening: Array | None = None) -> Array:
    r"""Rate of the simple shear that would dissipate as much, shape (n,), 1/s.

    From the dissipation :math:`D:\tau = \eta_{23}\dot\gamma^2`,

    .. math:: \dot\gamma^2 = 2\,\mathrm{dev}D:\mathrm{dev}D + \sum_k 4(R-1)\,v_k\,(D:m_k)^2 ,

    so that what stretches fibres thins as well. A law :math:`\eta_{23}(\dot\gamma)` has a potential then, which is
    convex as long as the traction :math:`\eta_{23}\dot\gamma` rises with the rate: there is one flow.

    Parameters
    ----------
    rate : ndarray, shape (n, 3, 3)
        D, 1/s (only its symmetric part counts).
    directions : ndarray, shape (n, k, 3), optional
        Unit directions; none for an isotropic fluid.
    stiffening : ndarray, shape (k,) or (n, k), optional
        4 (R - 1) v_k of each.
    """
    rate = 0.5 * (rate + np.swapaxes(rate, -1, -2))
    trace = np.einsum("nii->n", rate)
    squares = 2.0 * (np.einsum("nij,nij->n", rate, rate) - trace * trace / 3.0)
    if directions is not None and stiffening is not None and directions.shape[1] > 0:
        along = np.einsum("nij,nki,nkj->nk", rate, directions, directions) - trace[:, None] / 3.0
        squares = squares + np.sum(stiffening * along * along, axis=1)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))
