"""Quantities in scenes: plain numbers in mm, s, g, Pa, or strings such as ``"6 mm"`` and ``"1.31 GPa"``.

Each type below is a float after validation, in ppmc's units: mm, s, g, Pa (1 Pa = 1 g/(mm s^2)); angles in degrees.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

if TYPE_CHECKING:
    import pint

LONGEST, MOST_POWERS = 80, 3
_POWER = re.compile(r"\*\*|\^")
_SMALL_POWER = re.compile(r"(?:\*\*|\^)\s*\(?\s*[-+]?\d{1,2}(?:\.\d{1,3})?(?![\d.])\s*\)?(?!\s*(?:\*\*|\^))")


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry:
    """Return pint's registry; half a second to build, so made at the first unit string only."""
    import pint

    return pint.UnitRegistry()


def to_base(value: Any, unit: str) -> float:
    """Return `value` as a number in `unit`.

    Parameters
    ----------
    value : float, int or str
        A number already in `unit`, or text such as ``"3.55 mm/s"``.
    unit : str
        The unit to convert to, as pint spells it.

    Raises
    ------
    PydanticCustomError
        If the text is no quantity, or has another dimension.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        shown = str(value).lower() if isinstance(value, bool) else type(value).__name__
        raise _refusal("expected a number or a quantity such as '1 {unit}', got {value}", shown, unit)
    if not isinstance(value, str):
        try:
            return float(value)
        except OverflowError:
            raise _refusal("'{value}...' is beyond all numbers", str(value)[:20], unit) from None
    if not _is_tame(value):
        raise _refusal("'{value}' is no simple quantity; write for example '1 {unit}'", value[:40], unit)
    import pint

    try:
        quantity: Any = _registry().Quantity(value)
        if quantity.unitless:
            return float(quantity.magnitude)
        return float(quantity.to(unit).magnitude)
    except pint.DimensionalityError as error:
        message = f"'{{value}}' has the wrong dimension: expected {{unit}}, got {error.units1}"
        raise _refusal(message, value, unit) from None
    except Exception:
        # pint passes on whatever its tokenizer and evaluator stumble over.
        raise _refusal("'{value}' is not a quantity; write for example '1 {unit}'", value, unit) from None


def _is_tame(text: str) -> bool:
    """Return whether a text can be evaluated in no time: short, of few and small powers, none of them stacked."""
    powers = _POWER.findall(text)
    return len(text) <= LONGEST and len(powers) <= MOST_POWERS and len(powers) == len(_SMALL_POWER.findall(text))


def _refusal(message: str, value: str, unit: str) -> PydanticCustomError:
    """Return the error of one bad quantity."""
    return PydanticCustomError("unit", message, {"value": value, "unit": unit})


def _quantity(unit: str, **bounds: Any) -> Any:
    """Return the annotated float type of a quantity in `unit`."""
    low = "".join(f", {k} {v}" for k, v in bounds.items())
    schema: dict[str, Any] = {
        "anyOf": [{"type": "number"}, {"type": "string"}],
        "description": f"number in {unit} or text with a unit{low}",
    }
    return Annotated[float, BeforeValidator(lambda v: to_base(v, unit)), Field(**bounds), WithJsonSchema(schema)]


if TYPE_CHECKING:
    # One name a line: type checkers take a chain of assignments for variables, not for type aliases.
    Length = float
    PositiveLength = float
    NonNegativeLength = float
    Time = float
    PositiveTime = float
    Velocity = float
    PositiveVelocity = float
    Viscosity = float
    PositiveViscosity = float
    Pressure = float
    PositivePressure = float
    NonNegativePressure = float
    Force = float
    PositiveForce = float
    Density = float
    PositiveDensity = float
    Angle = float
    NonNegativeAngle = float
    StrainRate = float
    PositiveStrainRate = float
    NonNegativeTime = float
    FrictionCoefficient = float
else:
    Length = _quantity("mm")
    PositiveLength = _quantity("mm", gt=0)
    NonNegativeLength = _quantity("mm", ge=0)
    Time = _quantity("s")
    PositiveTime = _quantity("s", gt=0)
    NonNegativeTime = _quantity("s", ge=0)
    Velocity = _quantity("mm/s")
    PositiveVelocity = _quantity("mm/s", gt=0)
    Viscosity = _quantity("Pa*s", ge=0)
    PositiveViscosity = _quantity("Pa*s", gt=0)
    Pressure = _quantity("Pa")
    PositivePressure = _quantity("Pa", gt=0)
    NonNegativePressure = _quantity("Pa", ge=0)
    Force = _quantity("uN")
    PositiveForce = _quantity("uN", gt=0)
    Density = _quantity("g/mm^3", ge=0)
    PositiveDensity = _quantity("g/mm^3", gt=0)
    Angle = _quantity("degree")
    NonNegativeAngle = _quantity("degree", ge=0)
    StrainRate = _quantity("1/s")
    PositiveStrainRate = _quantity("1/s", gt=0)
    FrictionCoefficient = _quantity("Pa*s/mm", gt=0)


def _three(v: Any) -> Any:
    """Accept any sequence of three values."""
    if isinstance(v, str) or not hasattr(v, "__len__") or len(v) != 3:
        raise PydanticCustomError("vector", "expected three values [x, y, z], got {value}", {"value": repr(v)})
    return tuple(v)


def _unit_length(v: tuple[float, float, float]) -> tuple[float, float, float]:
    """Scale a direction to unit length; refuse the zero vector."""
    length = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    if length < 1e-12:
        raise PydanticCustomError("direction", "a direction must not be the zero vector")
    return (v[0] / length, v[1] / length, v[2] / length)


if TYPE_CHECKING:
    # One name a line: type checkers take a chain of assignments for variables, not for type aliases.
    Vector3 = tuple[float, float, float]
    LengthVector = tuple[float, float, float]
    PositiveLengthVector = tuple[float, float, float]
    VelocityVector = tuple[float, float, float]
    Direction = tuple[float, float, float]
else:
    Vector3 = Annotated[tuple[float, float, float], BeforeValidator(_three)]
    LengthVector = Annotated[tuple[Length, Length, Length], BeforeValidator(_three)]
    PositiveLengthVector = Annotated[tuple[PositiveLength, PositiveLength, PositiveLength], BeforeValidator(_three)]
    VelocityVector = Annotated[tuple[Velocity, Velocity, Velocity], BeforeValidator(_three)]
    Direction = Annotated[tuple[float, float, float], BeforeValidator(_three), AfterValidator(_unit_length)]
