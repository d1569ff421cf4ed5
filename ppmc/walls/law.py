"""What a wall law is to the solver: the traction along a wall, from the speed of sliding and the pressure."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ppmc.scene.base import Section, description_of

Array = NDArray[np.float64]


class WallLaw(ABC):
    """Traction of a wall against what slides over it; subclass it for a law of one's own.

    A law in proportion to the speed says so by `slip_length` and costs nothing more; for every other the step iterates
    until tractions, speeds and pressures agree.
    """

    @property
    def slip_length(self) -> float | None:
        """Speed over traction, mm/(Pa s), of a law for which that is a constant: infinite where nothing rubs."""
        return None

    @abstractmethod
    def traction(self, speed: Array, pressure: Array) -> Array:
        """Traction along the wall, against the sliding.

        Parameters
        ----------
        speed : ndarray, shape (m,)
            Of the material at the wall against it, mm/s, zero or more.
        pressure : ndarray, shape (m,)
            On the wall, Pa, zero or more.

        Returns
        -------
        ndarray, shape (m,)
            Pa; at speed zero the most that the wall holds before anything slides.
        """

    @property
    def rubs(self) -> bool:
        """Whether the wall resists sliding at all."""
        return self.slip_length is None or math.isfinite(self.slip_length)

    def described(self) -> Any:
        """Return what a file keeps of it, ready for JSON."""
        return description_of(self)


class WallSection(Section, WallLaw):
    """A wall law with a name, ``law``, by which scenes call it."""

    if TYPE_CHECKING:
        law: str

    def described(self) -> Any:
        """Return its section; of a law without constants the name alone, as scenes write it."""
        section = self.model_dump(mode="json")
        return section if len(section) > 1 else self.law
