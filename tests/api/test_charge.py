"""Charges from every source, as a scene would make them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pint
import pytest

import ppmc
from ppmc.charge.stage import run
from ppmc.errors import InputFileError, SceneError
from ppmc.files import read_particles
from ppmc.scene import parse_scene

mm = pint.UnitRegistry().mm
DISK = "{shape: cylinder, center: [0, 0, 2], axis: [0, 0, 1], radius: 5, length: 4}"
BOX = "{shape: box, size: [6, 6, 3]}"
RAM = "tooling: {tool_1: {shape: cylinder, center: [0, 0, 0], axis: [0, 1, 0], radius: 9}}"


def tool() -> ppmc.tools.Tool:
    return ppmc.tools.cylinder((0, 0, 0), (0, 1, 0), 9)


def box(orientation: ppmc.Charge) -> ppmc.Charge:
    return ppmc.Charge.box((6, 6, 3), spacing=1, orientation=orientation)


CASES: dict[str, tuple[Callable[[], ppmc.Charge], str]] = {
    "collimated": (
        lambda: box(ppmc.Collimated((0, 2, 0), (0, 0, 1))),
        f"domain: {BOX}\n  orientation: {{source: uniform, fibre_direction: [0, 2, 0]}}",
    ),
    "planar random in a disk": (
        lambda: ppmc.Charge.fill(
            ppmc.tools.cylinder((0, 0, 2 * mm), (0, 0, 1), radius="5 mm", length=4),
            spacing=1 * mm,
            orientation=ppmc.PlanarRandom(seed=4, normal=np.array([0.0, 0, 1])),
        ),
        f"domain: {DISK}\n  orientation: {{source: planar_random}}",
    ),
    "platelets": (
        lambda: box(ppmc.Platelets(length="3 mm", width={"mean": 1.5, "deviation": 0.2}, pitch="5 deg", seed=4)),
        f"domain: {BOX}\n  orientation: {{source: platelets, length: 3, width: {{mean: 1.5, deviation: 0.2}}, "
        "pitch: 5}",
    ),
    "regional": (
        lambda: box(ppmc.Regional({"all": {"min": (0, 0, 0), "max": (6, 6, 3), "normal": (0, 1, 0)}}, seed=4)),
        f"domain: {BOX}\n  orientation: {{source: regional, regions: {{all: {{min: [0, 0, 0], max: [6, 6, 3], "
        "normal: [0, 1, 0]}}}",
    ),
    "along a tool": (
        lambda: box(ppmc.AlongTool(tool(), seed=4)),
        f"domain: {BOX}\n  orientation: {{source: local, tool: tool_1}}\n{RAM}",
    ),
    "draped": (
        lambda: ppmc.Charge.draped(
            (8, 6, 1), tool(), spacing=0.5, centre=(0, 0, 9), orientation=ppmc.PlanarRandom(seed=4)
        ),
        "domain: {shape: draped, tool: tool_1, size: [8, 6, 1], centre: [0, 0, 9]}\n"
        f"  orientation: {{source: planar_random}}\n{RAM}",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_it_is_what_a_scene_makes(name: str, tmp_path: Path) -> None:
    make, text = CASES[name]
    spacing = 0.5 if name == "draped" else 1
    head, tail = text.split("\ntooling", 1) if "\ntooling" in text else (text, None)
    tooling = "" if tail is None else f"\ntooling{tail}"
    scene = parse_scene(f"name: charge\nseed: 4\ncharge:\n  spacing: {spacing}\n  {head}{tooling}\n")
    path = run(scene, output=tmp_path / "scene.vtkhdf")
    ours, theirs = make(), read_particles(path, "charge")
    assert np.array_equal(ours.positions, theirs.positions)
    assert list(ours.contents.fields) and set(ours.contents.fields) == set(theirs.fields)
    for field, values in theirs.fields.items():
        assert np.array_equal(ours.contents.fields[field], values), field
    written = ours.write(tmp_path / "api.vtkhdf")
    again = ppmc.read(written)
    assert isinstance(again, ppmc.Charge) and again.path == written
    if name != "collimated":  # a scene that draws nothing keeps its seed all the same
        assert written.read_bytes() == path.read_bytes()


def test_arrays_give_the_charge_back(tmp_path: Path) -> None:
    one = box(ppmc.PlanarRandom(seed=2))
    two = ppmc.Charge.from_arrays(
        one.positions, one.fibre_direction, one.platelet_normal, one.volume, platelet_id=one.platelet_id, spacing="1 mm"
    )
    assert np.array_equal(one.fibre_direction, two.fibre_direction) and np.allclose(one.A, two.A, atol=1e-15)
    assert two.facts["spacing"] == [1.0, 1.0, 1.0]
    three = ppmc.read(two.write(tmp_path / "c.vtkhdf"))
    assert np.array_equal(three.particles.in_plane_direction, one.particles.in_plane_direction)
    four = ppmc.Charge.from_arrays(one.positions, (1, 0, 0), (0, 0, 1), 1.0)
    assert np.allclose(four.A, np.diag([1, 0, 0])) and four.total_volume == len(one) == 108


GOOD = {
    "positions": [[0, 0, 0], [1, 0, 0]], "fibre_direction": (1, 0, 0), "platelet_normal": (0, 0, 1), "volume": 1.0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"positions": [[0, 0, 0], [1, 0, np.nan]]}, "position of point 2 is not finite"),
        ({"positions": []}, "holds no point"),
        ({"positions": [[0, 0], [1, 0]]}, r"position has shape \(2, 2\), must be \(2, 3\)"),
        ({"fibre_direction": [[1, 0, 0], [2, 0, 0]]}, "p of point 2 has length 2"),
        ({"platelet_normal": (1, 0, 0)}, "p and r of point 1 are not perpendicular"),
        ({"volume": [1, -1]}, "volume of point 2 is -1 mm"),
        ({"volume": [1, 1, 1]}, r"volume has shape \(3,\), must be \(2,\)"),
        ({"platelet_id": [1]}, r"platelet_id has shape \(1,\)"),
    ],
)
def test_bad_arrays_are_named(changed: dict, message: str) -> None:
    with pytest.raises(InputFileError, match=message):
        ppmc.Charge.from_arrays(**{**GOOD, **changed})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: box("planar_random"), "orientation: 'planar_random' is none; take one such as ppmc.PlanarRandom"),
        (lambda: box(ppmc.PlanarRandom(normal=(0, 0, 0))), r"ppmc\.PlanarRandom: normal: .*zero vector"),
        (lambda: box(ppmc.Platelets(length="3 s", width=1)), r"ppmc\.Platelets: length.*'3 s'"),
        (
            lambda: ppmc.Charge.box((6, 6), spacing=1, orientation=ppmc.Collimated()),
            r"ppmc\.Charge\.box: charge\.domain\.size: expected three values",
        ),
        (
            lambda: ppmc.Charge.box((6, 6, -1 * mm), spacing=1, orientation=ppmc.Collimated()),
            r"ppmc\.Charge\.box: charge\.domain\.size\.2: .*greater than 0",
        ),
        (
            lambda: ppmc.Charge.box((6, 6, 1), spacing=2 * mm / mm, orientation=ppmc.Collimated()),
            r"charge\.spacing.*has no unit, expected one such as mm",
        ),
        (
            lambda: ppmc.Charge.fill(
                ppmc.tools.plane((0, 0, 0), (0, 0, 1)), spacing=1, orientation=ppmc.Collimated()
            ),
            "charge.domain",
        ),
        (lambda: ppmc.tools.plane((0, 0, 0), (0, 0, 0)), r"ppmc\.tools\.plane: normal: .*zero vector"),
        (
            lambda: ppmc.tools.plane((0, 0, 0), (0, 0, 1), motion={"velocty": (0, 0, 1)}),
            r"ppmc\.tools\.plane: motion\.velocty: unknown key; did you mean 'velocity'",
        ),
        (lambda: ppmc.tools.cylinder((0, 0, 0), (0, 0, 1), "1 kg"), r"ppmc\.tools\.cylinder: radius: '1 kg'"),
    ],
)  # fmt: skip
def test_wrong_input_gives_one_clear_error(make: Callable[[], object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make()
