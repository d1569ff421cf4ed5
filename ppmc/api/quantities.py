"""What stands for a quantity in calls: a number in ppmc's units, text with a unit, or a quantity of pint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from numpy.typing import NDArray

Quantity: TypeAlias = Any
"""A number in mm, s, g, Pa (as the argument says), text such as ``"6 mm"``, or a ``pint.Quantity``."""

Vector: TypeAlias = "Sequence[Any] | NDArray[Any] | Any"
"""Three quantities: a tuple, list or array, or one ``pint.Quantity`` that holds three."""
