"""Parametric parts: volume balance, tools that leave exactly the cavity, meshes, and the scenes they make."""

from itertools import pairwise

import numpy as np
import pytest
from pydantic import TypeAdapter

from ppmc.geometry.parts import PARTS, CenterGatedDisk, DoubleDome, PinBracket, Plaque
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.analysis import PathSection, RegionSection
from ppmc.scene.sections.charge import BoxDomain
from ppmc.scene.sections.tooling import Tool

TOOLING = TypeAdapter(dict[str, Tool])

BRACKETS = [
    {},
    {"hole_diameter": 9.525},
    {"flange_thickness": 4, "hole_diameter": 9.525},
    {"flange_thickness": 6, "inset": 8, "top": "square"},
    {"flanges": "minus", "flange_thickness": 10, "entry_radius": 2},
    {"entry_radius": 1.5, "base_height": 2, "length": 80, "inset": 20},
]


def middles(low, high, n):
    """Return the midpoints of n equal steps, and the step."""
    return low + (np.arange(n) + 0.5) * (high - low) / n, (high - low) / n


def free_area(tools, time, x, y, z):
    """Return the area of the section at one x1 that closed tools leave free, by counting midpoints of a grid."""
    (ys, dy), (zs, dz) = middles(*y), middles(*z)
    Y, Z = np.meshgrid(ys, zs, indexing="ij")
    phi, _ = tools.clearance(np.stack([np.full(Y.size, x), Y.ravel(), Z.ravel()], axis=1), time)
    return np.count_nonzero(phi > 0) * dy * dz


def free_volume(part, x, y, z):
    """Return the volume that closed tools leave free; each of x, y, z is (low, high, steps)."""
    tools = compile_tools(TOOLING.validate_python(part.tooling()))
    xs, dx = middles(*x)
    return dx * sum(free_area(tools, part.closing_time, at, y, z) for at in xs)


@pytest.mark.parametrize("keys", BRACKETS)
def test_closed_bracket_tools_leave_the_charges_volume(keys):
    part = PinBracket.model_validate(keys)
    assert part.cavity_volume == pytest.approx(part.charge_volume, rel=1e-12)
    face, top, radius = part.charge_height, part.charge_height + part.flange_height, part.entry_radius
    # The section only changes along x1 within an entry radius of a flange; below and above the mould's face apart.
    breaks = {0.0, part.length}
    for start in part.flange_starts:
        breaks |= {start - radius, start, start + part.flange_thickness, start + part.flange_thickness + radius}
    volume = 0.0
    for low, high in pairwise(sorted(breaks)):
        n = 8 if high - low == pytest.approx(radius) else 1
        base = free_volume(part, (low, high, n), (0.0, part.width, 4), (part.stroke, face, 4))
        above = free_volume(part, (low, high, n), (0.0, part.width, 171), (face, top, 400))
        volume += base + above
    assert volume == pytest.approx(part.charge_volume, rel=1e-3)


@pytest.mark.parametrize(
    ("keys", "hole", "top"),
    [
        ({}, 23.57, 40.57),
        ({"hole_diameter": 9.525}, 21.94, 38.94),
        ({"flange_thickness": 4}, 31.86, 48.86),
        ({"flange_thickness": 6}, 18.03, 35.03),
        ({"flange_thickness": 6, "hole_diameter": 9.525}, 16.40, 33.40),
        ({"top": "square"}, None, 36.92),
    ],
)
def test_hole_heights_of_the_reference(keys, hole, top):
    part = PinBracket.model_validate(keys)
    assert part.flange_height == pytest.approx(top, abs=0.006)
    if hole:
        assert part.hole_height == pytest.approx(hole, abs=0.006)
    assert part.closing_time == pytest.approx(1.0)


@pytest.mark.parametrize(
    "keys", [{}, {"thickness": 2, "draft": 30, "depth": 40}, {"shoulder_radius": 10, "foot_radius": 3}]
)
def test_closed_dome_tools_leave_the_charges_volume(keys):
    part = DoubleDome.model_validate(keys)
    assert part.cavity_volume == pytest.approx(part.charge_volume, rel=1e-12)
    # A quarter is enough; 420 steps meet the flats.
    high = (part.rim, part.depth + part.thickness, part.spine / 2 + part.rim)
    volume = 4 * free_volume(part, *zip((0, 0, 0), high, (40, 420, 60), strict=True))
    assert volume == pytest.approx(part.charge_volume, rel=1e-3)


def test_disk_and_plaque_fill_at_closure():
    disk, plaque = CenterGatedDisk(), Plaque(charge_x1=0)
    for part, size in ((disk, 2 * disk.radius), (plaque, None)):
        assert part.cavity_volume == pytest.approx(part.charge_volume, rel=1e-12)
        low = (-disk.radius, -disk.radius, 0) if size else (0, 0, 0)
        high = (disk.radius, disk.radius, 2 * disk.thickness) if size else (plaque.length, plaque.width, 6)
        assert free_volume(part, *zip(low, high, (120, 120, 24), strict=True)) == pytest.approx(
            part.charge_volume, rel=1e-3
        )
    short = CenterGatedDisk(short_shot_height=3)
    assert short.cavity_volume > short.charge_volume


@pytest.mark.parametrize("name", PARTS)
def test_meshes_are_sound_and_true_to_the_volume(name):
    part = PARTS[name]()
    mesh = part.mesh(3.0)
    assert mesh.volumes().min() > 0
    assert mesh.volumes().sum() == pytest.approx(part.cavity_volume, rel=5e-3)
    # A closed surface: no crack where blocks meet.
    assert part.cavity(3.0).volume == pytest.approx(part.cavity_volume, rel=5e-3)


def test_bracket_mesh_lies_in_the_cavity():
    part = PinBracket()
    tools = compile_tools(TOOLING.validate_python(part.tooling()))
    phi, _ = tools.clearance(part.mesh(2.0).centres(), part.closing_time)
    assert phi.min() > 0.2


def test_dome_mesh_lies_in_the_cavity():
    part = DoubleDome()
    tools = compile_tools(TOOLING.validate_python(part.tooling()))
    phi, _ = tools.clearance(part.mesh(3.0).centres(), part.closing_time)
    assert phi.min() == pytest.approx(1.5, abs=0.25)


@pytest.mark.parametrize("name", PARTS)
def test_sections_are_valid_and_regions_lie_in_the_part(name):
    part = PARTS[name]()
    sections = part.scene_sections()
    TOOLING.validate_python(sections["tooling"])
    TypeAdapter(dict[str, RegionSection]).validate_python(sections["analysis"]["regions"])
    TypeAdapter(dict[str, PathSection]).validate_python(sections["analysis"]["paths"])
    domain = sections["charge"]["domain"]
    if domain["shape"] == "box":
        assert np.prod(BoxDomain.model_validate(domain).size) == pytest.approx(part.charge_volume)
    assert sections["solver"]["end_time"] == part.stroke / part.closing_speed


def test_mesh_files(tmp_path):
    import meshio

    mesh = Plaque().mesh(10.0)
    for name in ("part.vtu", "part.inp"):
        mesh.write(tmp_path / name)
        again = meshio.read(tmp_path / name)
        assert np.array_equal(again.cells[0].data, mesh.bricks)


@pytest.mark.parametrize(
    ("part", "keys", "message"),
    [
        (PinBracket, {"charge_height": 2}, "must be below charge_height"),
        (PinBracket, {"hole_diameter": 40}, "does not fit a width"),
        (PinBracket, {"charge_height": 3}, "volume balance puts the hole"),
        (PinBracket, {"inset": 45}, "no base between the flanges"),
        (Plaque, {"charge_length": 200}, "does not fit into the frame"),
        (Plaque, {"charge_length": 100}, "nothing to fill"),
        (CenterGatedDisk, {"charge_radius": 70}, "must be below radius"),
        (CenterGatedDisk, {"short_shot_height": 9}, "must lie between"),
        (DoubleDome, {"volume": 20_000}, "round ends alone"),
        (DoubleDome, {"charge_length": 300}, "charge: axial"),
        (DoubleDome, {"depth": 300}, "walls meet"),
    ],
)
def test_impossible_parts_are_refused(part, keys, message):
    with pytest.raises(ValueError, match=message):
        part.model_validate(keys)
