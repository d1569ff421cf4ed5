"""Sheets laid on tools: balance, width, volume, fibres; and orientations about normals."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from ppmc.charge.domains.drape import drape, flat_sheet, turned
from ppmc.charge.domains.membrane import membrane_energy, membrane_forces
from ppmc.charge.orientations.frames import DRAPED, Frames
from ppmc.charge.orientations.surface_normals import distance_of, local_frames, regional_frames
from ppmc.charge.stage import run
from ppmc.errors import SceneError
from ppmc.files import read_particles
from ppmc.geometry.charge_bounds import charge_bounds
from ppmc.geometry.parts import DoubleDome
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.orientation import angle_between_axes, orientation_tensor
from ppmc.scene.loader import parse_scene
from ppmc.scene.scene import Scene
from ppmc.scene.sections.charge import DrapedDomain, RegionalOrientation
from ppmc.scene.sections.tooling import Tool

TOOLING = TypeAdapter(dict[str, Tool])
PIPE = {"tool": {"shape": "cylinder", "center": [0, 0, 0], "axis": [1, 0, 0], "radius": 15}}
BALL = {"tool": {"shape": "rounded_box", "center": [0, 0, 0], "size": [60, 60, 60], "edge_radius": 30}}


def laid(tooling, spacing=1.0, layers=None, **keys):
    domain = DrapedDomain.model_validate({"shape": "draped", "tool": "tool", **keys})
    distance = distance_of(domain.tool, TOOLING.validate_python(tooling), Path(), "charge.domain.tool")
    sheet = flat_sheet(domain, (spacing,) * 3, layers)
    return sheet, drape(domain, sheet, distance), distance


def test_forces_are_the_gradient_of_the_energy():
    generator = np.random.default_rng(0)
    flat = np.stack([*np.meshgrid(np.arange(5) * 1.5, np.arange(4) * 0.8, indexing="ij"), np.zeros((5, 4))], axis=-1)
    x = flat + 0.1 * generator.normal(size=flat.shape)
    way, small = generator.normal(size=x.shape), 1e-6
    slope = (membrane_energy(x + small * way, 1.5, 0.8, 0.3) - membrane_energy(x - small * way, 1.5, 0.8, 0.3)) / (
        2 * small
    )
    force = membrane_forces(x, 1.5, 0.8, 0.3)
    assert slope == pytest.approx(-np.sum(force * way), rel=1e-6)
    np.testing.assert_allclose(force.sum(axis=(0, 1)), 0, atol=1e-14)
    np.testing.assert_allclose(membrane_forces(flat, 1.5, 0.8, 0.3), 0, atol=1e-15)


def test_sheet_on_a_pipe_keeps_width_and_volume_where_padding_widens_it():
    _, draped, distance = laid(PIPE, size=[10, 40, 3])
    assert draped.notes["width_ratio"] == pytest.approx(1, abs=2e-3)
    assert draped.notes["length_ratio"] == pytest.approx(1, abs=2e-3)
    # Padding the formed lower face, as the papers did, would widen the mean by half the thickness over the radius.
    assert 1 + 0.5 * 3 / 15 > 1.09
    np.testing.assert_allclose(np.linalg.det(draped.deformation_gradient), 1, atol=1e-9)
    phi, _ = distance(draped.positions)
    # Cells of equal volume: layers get thinner outwards, (R + h)^2 growing evenly.
    heights = phi.reshape(3, -1).mean(axis=1)
    assert phi.reshape(3, -1).std(axis=1).max() < 1e-2
    np.testing.assert_allclose(np.diff((15 + heights) ** 2, 2), 0, atol=0.01 * 3 * 15)
    angle = np.arctan2(draped.positions[:, 1], draped.positions[:, 2])
    spread = np.ptp(angle.reshape(3, 40, 10), axis=1)
    assert spread.std() < 1e-3


def test_real_volume_of_a_draped_sheet():
    # Hexahedra between the particles: their volume is the flat sheet's, as counted from particle to particle.
    from ppmc.geometry.parts.meshes.hexahedra import HexMesh, grid_quads

    part = DoubleDome()
    sheet, draped, distance = laid({"tool": part.tooling()["punch"]}, 3.3, **{**part.charge_domain(), "tool": "tool"})
    n3, n2, n1 = sheet.shape
    quads = grid_quads(n2, n1)
    layers = np.arange(n3 - 1)[:, None, None] * n1 * n2
    bricks = np.concatenate([quads + layers, quads + layers + n1 * n2], axis=2).reshape(-1, 8)
    volume = HexMesh(draped.positions, bricks).volumes().sum()
    flat = np.prod([length * (n - 1) / n for length, n in zip(part.charge_domain()["size"], (n1, n2, n3), strict=True)])
    assert volume == pytest.approx(flat, rel=1e-2)
    assert draped.notes["width_ratio"] == pytest.approx(1, abs=1e-2)
    assert draped.notes["length_ratio"] == pytest.approx(1, abs=1e-2)
    assert sheet.volumes.sum() == pytest.approx(part.charge_volume)
    phi, _ = distance(draped.positions)
    assert phi.min() > 0 and phi.max() < 1.1 * part.sheet[2]
    # The straight part is a prism: nothing moves along the axis, and both sides are alike.
    assert np.abs(draped.positions[:, 2]).max() < part.sheet[1] / 2
    assert draped.positions[:, 0].mean() == pytest.approx(0, abs=0.05)


def test_sheet_over_round_ends_keeps_width_and_volume():
    # The axial charge must be pressed together over the dome's ends; it gives way there, not in width or volume.
    part = DoubleDome(charge="axial")
    sheet, draped, _ = laid(
        {"tool": part.tooling()["punch"]}, 6.0, layers=2, **{**part.charge_domain(), "tool": "tool"}
    )
    n3, n2, n1 = sheet.shape
    places = draped.positions.reshape(n3, n2, n1, 3)
    widths = np.linalg.norm(np.diff(places, axis=1), axis=-1).sum(axis=1).mean(axis=0) / (part.sheet[0] * (n2 - 1) / n2)
    assert widths.mean() == pytest.approx(1, abs=6e-3)
    assert widths[n1 // 3 : -(n1 // 3)] == pytest.approx(1, abs=1e-2)
    assert widths.mean() == pytest.approx(draped.notes["width_ratio"], abs=1e-3)
    assert 0.95 < draped.notes["length_ratio"] < 1
    np.testing.assert_allclose(np.linalg.det(draped.deformation_gradient), 1, atol=1e-9)
    # Where the middle is pressed together the sheet is as much thicker.
    along, across, up = (np.linalg.norm(draped.deformation_gradient[..., a], axis=-1) for a in range(3))
    assert up.max() > 1.2 and np.all(up * along * across > 1 - 1e-9)


def test_fibres_turn_with_the_sheet():
    sheet, draped, distance = laid(PIPE, size=[10, 40, 2])
    across = Frames.of(np.tile([0.0, 1, 0], (sheet.n, 1)), np.tile([0.0, 0, 1], (sheet.n, 1)), 0)
    formed = turned(across, draped)
    _, normals = distance(draped.positions)
    assert angle_between_axes(formed.platelet_normal, normals).max() < 1
    hoop = np.cross([1.0, 0, 0], normals)
    assert angle_between_axes(formed.fibre_direction, hoop).max() < 1
    assert np.all(formed.source == DRAPED)
    assert np.abs(np.sum(formed.fibre_direction * formed.platelet_normal, axis=1)).max() < 1e-12


def test_small_sheet_on_a_ball_stretches_as_it_must():
    _, draped, _ = laid(BALL, size=[12, 12, 1])
    # A cap of radius a on a sphere of radius R has Gaussian curvature strain of order (a/R)^2/16.
    assert 0.98 < draped.notes["least_areal_stretch"] < 1 < draped.notes["largest_areal_stretch"] < 1.02
    assert draped.notes["forming_residual_strain"] < 1e-4


def test_areal_strain_on_a_ball_follows_from_its_curvature():
    # Equilibrium and compatibility of a plane elastic sheet of small strain on a surface of Gaussian curvature K:
    # the Laplacian of the areal strain is -(1 - nu) K, whatever the sheet's outline.
    sheet, draped, _ = laid(BALL, spacing=0.5, layers=1, size=[12, 12, 0.1])
    _, n2, n1 = sheet.shape
    area = 1.0 / np.linalg.norm(draped.deformation_gradient[..., 2], axis=-1)
    x, y = sheet.positions[:, 0], sheet.positions[:, 1]
    inner = np.hypot(x, y) < 3.0
    terms = np.stack([np.ones(n1 * n2), x**2, y**2, x**4 - 6 * x**2 * y**2 + y**4], axis=1)
    (_, xx, yy, _), *_ = np.linalg.lstsq(terms[inner], area[inner] - 1.0, rcond=None)
    assert 2 * (xx + yy) == pytest.approx(-(1 - 0.3) / 30.05**2, rel=0.05)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"size": [10, 10, 2], "centre": [0, 40, 0]}, "misses tool"),
        ({"size": [10, 80, 2]}, "of the sheet would lie on the underside of tool 'tool'"),
        ({"size": [10, 10, 2], "tool": "ram"}, r"no tool 'ram' in the scene's tooling \(it has tool\)"),
    ],
)
def test_sheets_that_cannot_lie(keys, message):
    with pytest.raises(SceneError, match=message):
        laid(PIPE, **keys)


def test_thick_sheet_in_a_tight_corner_is_refused():
    corner = {"tool": {"shape": "revolution", "profile": [[0, -5], [40, -5], [40, 0], [12, 0], [10, 15], [0, 15]],
                       "corner_radii": [0, 0, 0, 1.5, 1, 0], "axis": [0, 0, 1], "spine": 60}}  # fmt: skip
    with pytest.raises(SceneError, match="does not fit the bends"):
        laid(corner, size=[10, 70, 8])


def test_regional_normals_of_the_five_regions():
    part = DoubleDome()
    section = RegionalOrientation.model_validate(part.orientation())
    _, draped, _ = laid({"tool": part.tooling()["punch"]}, 3.5, **{**part.charge_domain(), "tool": "tool"})
    frames = regional_frames(section, draped.positions, np.random.default_rng(0))
    assert len(frames.notes["regions"]) == 5 and min(frames.notes["particles_per_region"]) > 0
    assert frames.notes["share_outside_all_regions"] < 0.005
    wall = frames.region_id == frames.notes["regions"].index("wall_plus")
    n = frames.platelet_normal[wall][0]
    np.testing.assert_allclose(n, [np.cos(np.radians(20)), np.sin(np.radians(20)), 0])
    expected = (np.eye(3) - np.outer(n, n)) / 2
    np.testing.assert_allclose(orientation_tensor(frames.fibre_direction[wall]), expected, atol=0.05)


def test_local_normals_are_the_tools():
    distance = distance_of("tool", TOOLING.validate_python(BALL), Path(), "charge.orientation.tool")
    points = np.random.default_rng(1).normal(size=(2000, 3))
    points *= 31 / np.linalg.norm(points, axis=1, keepdims=True)
    frames = local_frames(distance, points, np.random.default_rng(0))
    assert angle_between_axes(frames.platelet_normal, points).max() < 1e-4
    assert np.abs(np.sum(frames.fibre_direction * points, axis=1)).max() < 1e-9
    np.testing.assert_allclose(orientation_tensor(frames.fibre_direction), np.eye(3) / 3, atol=0.03)


SCENE = """
name: draped
seed: 3
tooling:
  tool: {{shape: cylinder, center: [0, 0, 0], axis: [1, 0, 0], radius: 15}}
charge:
  domain: {{shape: draped, tool: tool, size: [10, 30, 2]}}
  spacing: 1 mm
  orientation: {orientation}
"""


@pytest.mark.parametrize(
    ("orientation", "code"),
    [
        ("{source: platelets, length: 6 mm, width: 3 mm}", 4),
        ("{source: local, tool: tool}", 3),
        ("{source: uniform}", 4),
    ],
)
def test_draped_scenes_run(orientation, code, tmp_path):
    path = run(parse_scene(SCENE.format(orientation=orientation)), output=tmp_path / "charge.vtkhdf")
    charge = read_particles(path, "charge")
    assert np.all(charge.fields["orientation_source"] == code)
    assert charge.extra["width_ratio"] == pytest.approx(1, abs=1e-2)
    assert charge.fields["volume"].sum() == pytest.approx(600)
    outward = charge.positions * [0, 1, 1]
    assert np.percentile(angle_between_axes(charge.fields["platelet_normal"], outward), 99) < 2


@pytest.mark.parametrize("charge", ["transverse", "axial"])
def test_estimated_bounds_hold_the_sheet_and_reach_as_high(charge):
    sections = DoubleDome(charge=charge).scene_sections()
    sections["charge"]["spacing"] = 6.0
    scene = Scene.model_validate({"name": "dome", **sections})
    domain = scene.charge.domain
    low, high = charge_bounds(domain, compile_tools(scene.tooling), scene.directory)
    sheet = flat_sheet(domain, scene.charge.spacing, 2)
    formed = drape(domain, sheet, distance_of(domain.tool, scene.tooling, scene.directory, "charge")).positions
    assert np.all(formed.min(axis=0) >= low) and np.all(formed.max(axis=0) <= high)
    assert high[1] - formed[:, 1].max() < 0.51 * domain.size[2]
