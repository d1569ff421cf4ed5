"""Quantities in scenes: plain numbers in mm, s, g, Pa, or strings such as ``"6 mm"`` and ``"1.31 GPa"``.

How such a string is read is in `ppmc.scene.quantity`.

Each type below is a float after validation, in ppmc's units: mm, s, g, Pa (1 Pa = 1 g/(mm s^2)); angles in degrees.
"""

from __future__ import annotations

import math
from numbers import Real
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from ppmc.scene.quantity import QuantityError, parse_quantity

# Least and largest magnitude that a moulding has, by unit, a few decades beyond the strangest: what lies outside is a
# slip of the exponent, and what is computed with it overflows or never ends.
MAGNITUDES = {
    "mm": (1e-9, 1e6),
    "s": (1e-12, 1e9),
    "mm/s": (1e-15, 1e7),
    "Pa*s": (1e-9, 1e18),
    "Pa": (1e-9, 1e18),
    "uN": (1e-12, 1e18),
    "g/mm^3": (1e-12, 1e15),
    "degree": (1e-12, 1e5),
    "1/s": (1e-15, 1e9),
    "Pa*s/mm": (1e-12, 1e18),
}


def to_base(value: Any, unit: str) -> float:
    """Return `value` as a number in `unit`.

    Parameters
    ----------
    value : float, int, str or quantity of pint
        A number already in `unit`, text such as ``"3.55 mm/s"``, or a quantity.
    unit : str
        The unit to convert to, as pint spells it.

    Raises
    ------
    PydanticCustomError
        If the text is not one number and one unit, or has another dimension; with what was probably meant.
    """
    if hasattr(value, "magnitude") and hasattr(value, "to"):
        return _of_pint(value, unit)
    if isinstance(value, bool) or not isinstance(value, Real | str):
        shown = str(value).lower() if isinstance(value, bool) else type(value).__name__
        raise _refusal("expected a number or a quantity such as '1 {unit}', got {value}", shown, unit)
    if not isinstance(value, str):
        try:
            return float(value)
        except OverflowError:
            raise _refusal("'{value}...' is beyond all numbers", str(value)[:20], unit) from None
    try:
        return parse_quantity(value, unit)
    except QuantityError as error:
        raise _refusal(f"'{{value}}' {_escaped(str(error))}", value, unit) from None


def _of_pint(value: Any, unit: str) -> float:
    """Return a quantity of pint, whatever its registry, as a number in `unit`."""
    try:
        if str(value.units) != "dimensionless":
            return float(value.to(unit).magnitude)
    except Exception as error:  # each registry has errors of its own
        raise _refusal(f"'{{value}}' is no quantity in {{unit}} ({_escaped(str(error))})", str(value), unit) from None
    raise _refusal("'{value}' has no unit, expected one such as {unit}", str(value), unit)


def _escaped(text: str) -> str:
    """Return a text that pydantic's message template leaves as it is."""
    return text.replace("{", "(").replace("}", ")")


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
    return Annotated[
        float,
        BeforeValidator(lambda v: to_base(v, unit)),
        Field(**bounds),
        AfterValidator(lambda v: _of_a_moulding(v, unit)),
        WithJsonSchema(schema),
    ]


def _of_a_moulding(value: float, unit: str) -> float:
    """Refuse what is beyond all mouldings."""
    least, most = MAGNITUDES[unit]
    if abs(value) > most:
        raise _refusal(f"{{value}} {{unit}} is beyond any moulding: at most {most:g} {unit}", f"{value:g}", unit)
    if 0.0 < abs(value) < least:
        raise _refusal(f"{{value}} {{unit}} is beyond any moulding: at least {least:g} {unit}", f"{value:g}", unit)
    return value


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
    length = math.hypot(*v)
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
