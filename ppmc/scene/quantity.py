"""The grammar of a quantity written as text: one number, then at most one unit expression.

::

    quantity = number [unit]
    number   = [+-] digits [. digits] [e [+-] digits]
    unit     = ["1"] factor { ("*" | "/" | blank) factor }
    factor   = name ["^" integer] | "(" unit ")"

Commas, blanks or apostrophes inside a number, a second number and sums are refused with what was probably meant:
programs that drop them read "1,5 mm" as 15 mm. pint knows the units; it is asked for names that measure something a
scene holds, not for its constants ("c" is the speed of light there).
"""

from __future__ import annotations

import difflib
import math
import re
from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint

MOST_CHARACTERS = 100
MOST_POWER = 9
UNITS = frozenset({
    "meter", "micron", "angstrom", "inch", "foot", "yard", "thou", "gram", "metric_ton", "pound", "ounce", "second",
    "minute", "hour", "day", "hertz", "pascal", "bar", "standard_atmosphere", "torr", "pound_force_per_square_inch",
    "newton", "dyne", "force_pound", "force_gram", "kilogram_force", "kip", "joule", "watt", "poise", "stokes", "liter",
    "degree", "radian", "arcminute", "arcsecond", "turn", "gradian", "revolutions_per_minute",
})  # fmt: skip
"""Units that quantities of a scene are made of, by pint's names; SI prefixes come with them."""
ANGLES = frozenset({"degree", "radian", "arcminute", "arcsecond", "turn", "gradian", "revolutions_per_minute"})
"""Those that count as angles; pint takes an angle for a plain number, a scene does not."""
SMALL_ONLY = frozenset({"meter", "second"})
"""Units without prefixes above kilo: 'Mm' is mm with a slip of the shift key, not a thousand kilometres."""
LARGE_PREFIXES = frozenset({"mega", "giga", "tera", "peta", "exa", "zetta", "yotta", "ronna", "quetta"})
COMMON = (
    "um", "mm", "cm", "m", "inch", "s", "ms", "min", "h", "Pa", "kPa", "MPa", "GPa", "uN", "mN", "N", "kN", "g", "kg",
    "deg", "rad", "bar", "psi", "lbf", "Hz",
)  # fmt: skip
"""Spellings that a mistyped name is compared with."""
SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
LIKE_NUMBER = re.compile(r"([+-]?[0-9.][0-9.,'’_ ]*(?:[eE][+-]?[0-9]+)?)\s*(.*)", re.DOTALL)
THOUSANDS = re.compile(r"(?<=[0-9])[ '’_]+(?=[0-9]{3}(?![0-9]))")
TOKEN = re.compile(r"\s*(?:(\*\*|\^)\s*([+-]?[0-9]+)|([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)|([*·⋅/()])|([A-Za-zµμΩÅ°_]+)|(\S))")


class QuantityError(ValueError):
    """A text that is no quantity; the message says what was probably meant."""


def parse_quantity(text: str, unit: str) -> float:
    """Return a quantity as a number in a unit.

    Parameters
    ----------
    text : str
        Such as ``"3.55 mm/s"``; a number alone is already in `unit`.
    unit : str
        The unit to convert to.

    Raises
    ------
    QuantityError
        If it is not one number and one unit expression, names an unknown unit, has another dimension, or is beyond
        what a float holds.
    """
    clean = re.sub(r"\s+", " ", text).strip().replace("−", "-")
    if len(clean) > MOST_CHARACTERS:
        raise QuantityError(f"a quantity has at most {MOST_CHARACTERS} characters; write for example '1 {unit}'")
    found = NUMBER.match(clean)
    rest = clean[found.end() :] if found else ""
    if found is None or rest[:1] in {".", ",", "'", "’", "_"} or (re.match(r"\s*[0-9.,]", rest) and not _per(rest)):
        raise QuantityError(_malformed(clean, unit))
    number = float(found.group())
    if not math.isfinite(number):
        raise QuantityError("is beyond all numbers")
    if not rest.strip():
        return number
    return _convert(number, _powers(rest, unit), unit)


def _per(rest: str) -> bool:
    """Return whether what follows the number is a unit that begins with one over something, as in '5 1/s'."""
    return re.match(r" 1 ?/ ?[^0-9 ]", rest) is not None


def _malformed(text: str, unit: str) -> str:
    """Say what a text that does not begin with one number was probably meant to be."""
    general = f"is not one number and one unit; write for example '1 {unit}'"
    found = LIKE_NUMBER.fullmatch(text)
    if found is None or not re.search("[0-9]", found.group(1)):
        return general
    digits = THOUSANDS.sub("", found.group(1).strip(" '’_"))
    tail = f" {found.group(2)}" if found.group(2) else ""
    if re.search("[ '’_]", digits):
        return f"holds two numbers; a quantity is one number and one unit, for example '1 {unit}'"
    if re.fullmatch(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}", digits):
        return (
            f"has a comma: write {digits.replace(',', '.')}{tail} or {digits.replace(',', '')}{tail}, "
            "whichever is meant"
        )
    number = _without_marks(digits)
    if NUMBER.fullmatch(number) is None:
        return general
    return f"is not a number as scenes write it (a point for decimals, nothing between thousands): write {number}{tail}"


def _without_marks(digits: str) -> str:
    """Return a number with its decimal mark a point and without marks between thousands, where that is clear."""
    for mark, other in ((",", "."), (".", ",")):
        if re.fullmatch(rf"[+-]?[1-9][0-9]{{0,2}}(?:[{other}][0-9]{{3}})+(?:[{mark}][0-9]+)?", digits):
            return digits.replace(other, "").replace(mark, ".")
    return digits.replace(",", ".")


def _powers(text: str, unit: str) -> dict[str, int]:
    """Return the power of each unit name in a unit expression."""
    tokens = _tokens(text, unit)
    powers, at = _product(tokens, 0)
    if at < len(tokens):
        raise QuantityError("has a closing bracket without an opening one")
    return powers


def _tokens(text: str, unit: str) -> list[str | int]:
    """Cut a unit expression into names, operators and powers (integers)."""
    out: list[str | int] = []
    at = 0
    text = re.sub("°(?![CF])", "deg", text).rstrip()
    while at < len(text):
        found = TOKEN.match(text, at)
        assert found is not None
        hat, power, raised, operator, name, other = found.groups()
        at = found.end()
        if hat or raised:
            try:
                out.append(int(power or raised.translate(SUPERSCRIPTS)))
            except ValueError:
                raise QuantityError(f"has '{raised}', which is no power") from None
        elif operator:
            out.append("*" if operator in "·⋅" else operator)
        elif name:
            out.append(name)
        elif other == "1" and not out and re.match(r"\s*/", text[at:]):
            continue
        else:
            raise QuantityError(_stray(other, text[:at], text[at:], out, unit))
    return out


def _stray(sign: str, before: str, after: str, tokens: list[str | int], unit: str) -> str:
    """Say what is wrong with a sign that no unit holds."""
    if sign.isdigit() and tokens and isinstance(tokens[-1], str) and tokens[-1] not in "*/(":
        digits = sign + after[: len(after) - len(after.lstrip("0123456789"))]
        if before[-2:-1] != " ":
            return f"has the number {digits} after the unit '{tokens[-1]}'; write {tokens[-1]}^{digits} for a power"
        return (
            f"has a second number after the unit '{tokens[-1]}'; a quantity is one number and one unit "
            f"({tokens[-1]}^{digits} for a power)"
        )
    if sign == "-" and re.match("[0-9]", after) and tokens and isinstance(tokens[-1], str):
        return f"has the sign - after the unit '{tokens[-1]}'; write {tokens[-1]}^-{after[0]} for a power"
    if sign.isdigit() or sign in "+-":
        return f"is a sum or product to be worked out; write the result, for example '1 {unit}'"
    if sign in ".,":
        return f"has '{sign}' in its unit; write * between units, for example 'Pa*s'"
    return f"has '{sign}', which belongs to no unit; write for example '1 {unit}'"


def _product(tokens: list[str | int], at: int) -> tuple[dict[str, int], int]:
    """Return the powers of a product of factors that begins at a token, and where it ends."""
    powers: dict[str, int] = {}
    sign, needs, divided = 1, False, False
    while at < len(tokens):
        token = tokens[at]
        if token in ("*", "/"):
            if needs or (token == "*" and not powers):
                break
            sign, needs = (-1 if token == "/" else 1), True
            divided |= token == "/"
            at += 1
            continue
        if token == ")":
            break
        if isinstance(token, int):
            raise QuantityError("has a power without a unit before it")
        if powers and not needs and divided:
            raise QuantityError("is not clear about what stands below the /; write * between units, or brackets")
        factor = {token: 1}
        at += 1
        if token == "(":
            factor, at = _product(tokens, at)
            if at >= len(tokens):
                raise QuantityError("has an opening bracket without a closing one")
            at += 1
        exponent = 1
        if at < len(tokens) and isinstance(tokens[at], int):
            exponent = int(tokens[at])
            at += 1
        if abs(exponent) > MOST_POWER:
            raise QuantityError(f"has a power beyond {MOST_POWER}")
        for name, power in factor.items():
            powers[name] = powers.get(name, 0) + sign * exponent * power
        sign, needs = (1, False)
    if needs or not powers:
        raise QuantityError("has an operator without a unit after it")
    return powers, at


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry:
    """Return pint's registry; half a second to build, so made at the first unit string only."""
    import pint

    return pint.UnitRegistry()


@lru_cache(maxsize=200)
def _unit_named(name: str) -> tuple[str, str]:
    """Return pint's (prefix, unit) of a name.

    Raises
    ------
    QuantityError
        If it is none of `UNITS`; with the common unit whose spelling is nearest.
    """
    found = [c for c in _registry().parse_unit_name(name) if c[1] in UNITS]
    # Names have a plural, symbols have none: "Pas" is a viscosity without its dot, not several pascals.
    found = [c for c in found if not c[2]] or [c for c in found if len(name) > 4]
    slip = bool(found) and found[0][1] in SMALL_ONLY and found[0][0] in LARGE_PREFIXES
    if found and not slip:
        return found[0][0], found[0][1]
    near = [c for c in COMMON if c.casefold() == name.casefold() and c != name]
    near = near or difflib.get_close_matches(name, [c for c in COMMON if len(c) > 1], n=1)
    hint = f"{name[:-1]}*s" if name.endswith("Pas") else near[0] if near else None
    said = f"; did you mean '{hint}'?" if hint else f"; scenes know for example {', '.join(COMMON[:12])}"
    raise QuantityError(f"has an unknown unit '{name}'{said}")


def _convert(number: float, powers: dict[str, int], unit: str) -> float:
    """Return a number of a unit in another unit."""
    import pint

    named = {name: _unit_named(name) for name in powers}
    angle = any(base in ANGLES for _, base in named.values())
    if angle and unit != "degree":
        raise QuantityError(f"has the wrong dimension: expected {unit}, got an angle")
    registry = _registry()
    source = registry.Unit("")
    for name, power in powers.items():
        prefix, base = named[name]
        source = source * registry.Unit(prefix + base) ** power
    try:
        if source.dimensionless and not (angle and unit == "degree"):
            raise QuantityError(f"has the wrong dimension: expected {unit}, got a plain number")
        return float(registry.Quantity(number, source).to(unit).magnitude)
    except pint.DimensionalityError:
        joined = next((f"; did you mean '{n[:-1]}*s'?" for n in powers if n.endswith("Pas")), "")
        raise QuantityError(f"has the wrong dimension: expected {unit}, got {source}{joined}") from None
    except OverflowError:
        raise QuantityError("is too large a number") from None
