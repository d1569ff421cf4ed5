"""Quantities as text: one number, one unit; everything else is refused with what was probably meant."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ppmc.errors import SceneError
from ppmc.scene import parse_scene
from ppmc.scene.quantity import QuantityError, parse_quantity


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("1.5 mm", "mm", 1.5),
        ("-3.55mm/s", "mm/s", -3.55),
        ("−2 mm", "mm", -2.0),  # the minus sign of text programs
        ("1e3", "mm", 1000.0),
        (".5 m", "mm", 500.0),
        ("12 µm", "mm", 0.012),
        ("500 ms", "s", 0.5),
        ("4 h", "s", 14400.0),
        ("1 in", "mm", 25.4),
        ("1.31 GPa", "Pa", 1.31e9),
        ("5 N/mm^2", "Pa", 5e6),
        ("5 N/mm²", "Pa", 5e6),
        ("5 N/(mm*mm)", "Pa", 5e6),
        ("5 Pa s", "Pa*s", 5.0),
        ("5 kPa·s", "Pa*s", 5000.0),
        ("0.5 1/s", "1/s", 0.5),
        ("0.5 s⁻¹", "1/s", 0.5),
        ("1.6 g/cm^3", "g/mm^3", 0.0016),
        ("1600 kg/m^3", "g/mm^3", 0.0016),
        ("12 kN", "uN", 1.2e10),
        ("45°", "degree", 45.0),
        ("3.141592653589793 rad", "degree", 180.0),
        ("5\N{NO-BREAK SPACE}mm", "mm", 5.0),
    ],
)
def test_values(text: str, unit: str, value: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("1,5 mm", "mm", "write 1.5 mm"),
        ("-1,5 mm/s", "mm/s", "write -1.5 mm/s"),
        ("1,5 kPa*s", "Pa*s", "write 1.5 kPa*s"),
        ("0,250 mm", "mm", "write 0.250 mm"),
        ("1,200 mm", "mm", "write 1.200 mm or 1200 mm, whichever"),
        ("1.200,5 mm", "mm", "write 1200.5 mm"),
        ("1,200.5 mm", "mm", "write 1200.5 mm"),
        ("1 200 mm", "mm", "write 1200 mm"),
        ("1\N{NARROW NO-BREAK SPACE}200 mm", "mm", "write 1200 mm"),
        ("61 215 Pa*s", "Pa*s", "write 61215 Pa*s"),
        ("1'000 mm", "mm", "write 1000 mm"),
        ("1’000,5 mm", "mm", "write 1000.5 mm"),
        ("1_000 mm", "mm", "write 1000 mm"),
        ("10 000", "mm", "write 10000"),
        ("3 4 mm", "mm", "holds two numbers"),
        ("6 mm 2", "mm", "second number after the unit 'mm'"),
        ("5 mm 3 um", "mm", "second number after the unit"),
        ("6 mm2", "mm", "write mm^2 for a power"),
        ("5 s-1", "1/s", "write s^-1 for a power"),
        ("2*3 mm", "mm", "write the result"),
        ("1/2 mm", "mm", "write the result"),
        ("1-2 mm", "mm", "write the result"),
        ("5 N/m m", "Pa", "not clear about what stands below the /"),
        ("5 pa", "Pa", "did you mean 'Pa'"),
        ("5 Kg/m^3", "g/mm^3", "did you mean 'kg'"),
        ("5 Mm", "mm", "did you mean 'mm'"),
        ("5 mPas", "Pa*s", "did you mean 'mPa*s'"),
        ("5 Pa.s", "Pa*s", "write * between units"),
        ("5 c", "mm/s", "unknown unit 'c'"),  # pint's speed of light
        ("5 pi*mm", "mm", "unknown unit 'pi'"),
        ("5 %", "mm", "belongs to no unit"),
        ("5 rpm", "1/s", "got an angle"),
        ("5 mm/mm", "degree", "got a plain number"),
        ("1 m", "s", "wrong dimension: expected s, got meter"),
        ("mm", "mm", "write for example '1 mm'"),
        ("", "mm", "write for example '1 mm'"),
        ("nan mm", "mm", "not one number"),
        ("0x10 mm", "mm", "after the unit 'x'"),
        ("5 mm^99999999", "mm", "power beyond 9"),
        ("5 (mm", "mm", "opening bracket"),
        ("5 mm)", "mm", "closing bracket"),
        ("5 mm*", "mm", "operator without a unit"),
        ("5 ^2", "mm", "power without a unit"),
        ("1" * 200, "mm", "at most 100 characters"),
    ],
)
def test_what_is_refused_says_what_was_meant(text: str, unit: str, words: str) -> None:
    with pytest.raises(QuantityError) as caught:
        parse_quantity(text, unit)
    assert words in str(caught.value)


@given(st.text("0123456789.,'_ eE+-mnus/*^()", max_size=12))
@example("1,5")
@example("1 1/s")
def test_only_one_number_and_one_unit_is_ever_read(text: str) -> None:
    try:
        value = parse_quantity(text, "mm")
    except QuantityError:
        return
    number = re.fullmatch(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^0-9]*(?:\^\s*[+-]?\d+[^0-9]*)*)", text)
    assert number is not None, f"{text!r} read as {value}"
    # Whatever the unit, a power of ten of the number as Python reads it; a lost mark or digit would not be.
    ratio = value / float(number.group(1)) if float(number.group(1)) else 1.0
    assert any(ratio == pytest.approx(10.0**k, rel=1e-9) for k in range(-60, 61)), f"{text!r} read as {value}"


SCENE = """\
name: press
charge: {domain: {shape: box, size: [12, 12, 6]}, spacing: 1.5 mm, orientation: {source: planar_random}}
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram:
    shape: plane
    point: [0, 0, 6 mm]
    normal: [0, 0, -1]
    motion: {velocity: [0, 0, "-1.5 mm/s"], travel: 3 mm}
material: {model: newtonian, shear_viscosity: 1.5 kPa*s}
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"-1.5 mm/s"', '"-1,5 mm/s"', "s.yaml:9: tooling.ram.motion.velocity.2: '-1,5 mm/s' is not"),
        ("1.5 kPa*s", '"1,5 kPa*s"', "s.yaml:10: material.shear_viscosity: '1,5 kPa*s' is not"),
        ("travel", "travl", "s.yaml:9: tooling.ram.motion.travl: unknown key; did you mean 'travel'?"),
        ("velocity:", "velcity:", "s.yaml:9: tooling.ram.motion.velcity: unknown key; did you mean 'velocity'?"),
        ("size:", "sze:", "s.yaml:2: charge.domain.sze: unknown key; did you mean 'size'?"),
        ("{source: planar", "{sorce: planar", "charge.orientation.sorce: unknown key; did you mean 'source'?"),
        ("    shape: plane", "    shpe: plane", "s.yaml:6: tooling.ram.shpe: unknown key; did you mean 'shape'?"),
        (
            'velocity: [0, 0, "-1.5 mm/s"]',
            "force: 5 N, direction: [0, 0, -1]",
            "s.yaml:9: tooling.ram.motion.max_speed: this key is required",
        ),
        (
            'velocity: [0, 0, "-1.5 mm/s"]',
            "force: 5 N, direction: [0, 0, -1], max_sped: 1",
            "s.yaml:9: tooling.ram.motion.max_sped: unknown key; did you mean 'max_speed'?",
        ),
    ],
)
def test_messages_name_the_key_that_is_wrong_and_no_other(old: str, new: str, message: str) -> None:
    assert old in SCENE
    with pytest.raises(SceneError) as caught:
        parse_scene(SCENE.replace(old, new), Path("s.yaml"))
    assert message in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
