"""Scenes beyond all bounds get one message, and get it before anybody has worked for them."""

from __future__ import annotations

import pytest

from ppmc.errors import SceneError
from ppmc.scene import parse_scene

SQUEEZE = """\
name: x
charge:
  domain: {{shape: box, size: [{size}, 4 mm, 2 mm]}}
  spacing: 0.5 mm
  orientation: {{source: planar_random}}
tooling:
  {tool}: {{shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}}
solver: {{end_time: {end}, output_interval: {interval}}}
"""


def scene(size: str = "4 mm", tool: str = "lower", end: str = "1 s", interval: str = "0.1 s") -> str:
    return SQUEEZE.format(size=size, tool=tool, end=end, interval=interval)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (scene(size='"9**9**9 mm"'), r"scene\.yaml:3: charge\.domain\.size.*a power without a unit"),
        (scene(size='"9^9^9 mm"'), "a power without a unit"),
        (scene(size='"(9**99)**99 mm"'), "is not one number and one unit"),
        (scene(size='"2**1000000000 mm"'), "a power without a unit"),
        (scene(size='"' + "1+" * 60 + '1 mm"'), "at most 100 characters"),
        (scene(size="1" + "0" * 400), "beyond all numbers"),
        (scene(size="1e400"), "size"),
        (scene(tool='"r\\0m"'), r"scene\.yaml:7: tooling"),
        (scene(tool="a/b"), r"scene\.yaml:7: tooling"),
        (scene(tool="../a"), r"scene\.yaml:7: tooling"),
        (scene(end="1e300"), r"end_time.*1e\+300 s is beyond any moulding: at most 1e\+09 s"),
        (scene(end="1e-300"), r"end_time.*1e-300 s is beyond any moulding: at least 1e-12 s"),
        (scene(size="4e200 m"), r"size.*4e\+203 mm is beyond any moulding"),
        (scene(interval="4e-10 s"), r"asks for 2.5e.09 frames up to 1 s; at most 100,000"),
        ("name: x\n? [a, b]\n: 1\n", r"scene\.yaml:2: a key must be a word"),
        ("name: x\n? {a: b}\n: 1\n", r"scene\.yaml:2: a key must be a word"),
        ("name: x\ncharge: " + "[" * 20000 + "\n", r"scene\.yaml:2: nested more than 40 deep"),
        ("name: x\ncharge: " + "{a: " * 60 + "1" + "}" * 60 + "\n", "nested more than 40 deep"),
        ("name: x\nsolver: {output_times: [" + "1, " * 30000 + "1]}\n", "holds more than 20,000 values"),
    ],
)
def test_what_no_scene_means_is_told_at_once(text: str, told: str) -> None:
    with pytest.raises(SceneError, match=told):
        parse_scene(text)


@pytest.mark.parametrize("size", ["4e-3 m", "0.4 cm", "4 mm**2 / mm", "4000 um"])
def test_unit_expressions_of_people_pass(size: str) -> None:
    domain = parse_scene(scene(size=f'"{size}"')).charge.domain  # type: ignore[union-attr]
    assert domain.size[0] == pytest.approx(4.0)  # type: ignore[union-attr]


@pytest.mark.parametrize("ratio", ["anisotropy_ratio: 1e300", "axial_viscosity: 1e17 Pa*s", "aspect_ratio: 1e9"])
def test_ratios_beyond_any_platelet_are_told(ratio: str) -> None:
    with pytest.raises(SceneError, match=r"material.*an anisotropy ratio R of .* is beyond any platelet"):
        parse_scene(f"name: x\nmaterial: {{model: transversely_isotropic, shear_viscosity: 1 Pa*s, {ratio}}}\n")


@pytest.mark.parametrize("speed", ["-1e200", "-1e-200", "-1e30 m/s"])
def test_speeds_beyond_any_tool_are_told(speed: str) -> None:
    with pytest.raises(SceneError, match=r"velocity.*mm/s is beyond any moulding"):
        parse_scene(
            "name: x\ntooling:\n  ram: {shape: plane, point: [0, 0, 1], normal: [0, 0, -1], "
            f"motion: {{velocity: [0, 0, {speed}]}}}}\n"
        )
