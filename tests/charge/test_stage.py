"""The charge stage as a whole: files in, file out, command line, and what it says to bad input."""

import subprocess
import sys

import h5py
import numpy as np
import pytest

from ppmc.charge.report import lines
from ppmc.charge.stage import run
from ppmc.errors import InputFileError, SceneError
from ppmc.files import Provenance, VoxelGrid, read_particles, write_voxels
from ppmc.orientation import angle_between_axes, normalise
from ppmc.scene.loader import parse_scene

SCENE = """
name: block
seed: 11
charge:
  domain: {{shape: box, origin: [0, 0, 0], size: [6 mm, 4 mm, 2 mm]}}
  spacing: 0.5 mm
  layers: 4
  orientation: {orientation}
"""


def scene(orientation="{source: ct}"):
    return parse_scene(SCENE.format(orientation=orientation))


@pytest.fixture
def orientations(tmp_path):
    """Return an orientations file whose fibre direction turns with x1: 10 degrees a millimetre."""
    grid = VoxelGrid((20, 40, 60), (0.1, 0.1, 0.1), (0.05, 0.05, 0.05))
    x = 0.05 + 0.1 * np.arange(60)
    angle = np.broadcast_to(np.radians(10 * x), grid.shape)
    p = np.stack([np.cos(angle), np.sin(angle), np.zeros(grid.shape)], axis=-1).astype(np.float32)
    r = np.zeros_like(p)
    r[..., 2] = 1
    path = tmp_path / "orientations.vtkhdf"
    fields = {
        "fibre_direction": p,
        "platelet_normal": r,
        "confidence": np.full(grid.shape, 0.9, np.float32),
        "valid": np.ones(grid.shape, np.uint8),
    }
    write_voxels(path, "orientations", fields, grid=grid, provenance=Provenance.collect("test"))
    return path


def test_ct_charge_carries_the_nearest_voxels_frames(orientations, tmp_path):
    path = run(scene(), input=orientations, output=tmp_path / "charge.vtkhdf")
    charge = read_particles(path, "charge")
    assert len(charge.positions) == 12 * 8 * 4
    assert charge.fields["volume"].sum() == pytest.approx(48.0, rel=1e-12)
    # The particle at 0.25 mm stands between voxel centres 0.25 +- 0.05: half a voxel is half a degree.
    exact = np.radians(10 * charge.positions[:, 0])
    exact = np.stack([np.cos(exact), np.sin(exact), 0 * exact], axis=1)
    assert angle_between_axes(charge.fields["fibre_direction"], exact).max() <= 0.5 + 1e-4
    assert np.all(charge.fields["orientation_source"] == 1)
    assert np.all(charge.fields["platelet_id"] == -1)
    p, q, r = (charge.fields[k] for k in ("fibre_direction", "in_plane_direction", "platelet_normal"))
    np.testing.assert_allclose(np.cross(p, normalise(q)), r, atol=1e-12)
    assert charge.extra["layers"] == 4
    assert charge.extra["spacing"] == pytest.approx([0.5, 0.5, 0.5])
    assert charge.extra["share_with_data"] == 1.0
    text = "\n".join(lines(path))
    assert "384 particles in 4 layers" in text and "100.00% CT" in text


def test_charge_larger_than_the_volume_is_refused_and_leaves_nothing(orientations, tmp_path):
    wide = parse_scene(SCENE.replace("6 mm", "12 mm").format(orientation="{source: ct}"))
    with pytest.raises(SceneError, match=r"only 5\d\.\d\d% of the 768 particles.*outside the CT volume"):
        run(wide, input=orientations, output=tmp_path / "charge.vtkhdf")
    assert not (tmp_path / "charge.vtkhdf").exists()


@pytest.mark.parametrize(
    "orientation",
    [
        "{source: uniform, fibre_direction: [1, 1, 0]}",
        "{source: planar_random}",
        "{source: platelets, length: {mean: 3, deviation: 1}, width: 2}",
    ],
)
def test_charges_that_need_no_file(orientation, tmp_path):
    one = run(scene(orientation), output=tmp_path / "one.vtkhdf")
    two = run(scene(orientation), output=tmp_path / "two.vtkhdf")
    assert one.read_bytes() == two.read_bytes()
    charge = read_particles(one, "charge")
    assert np.abs(charge.fields["fibre_direction"][:, 2]).max() < 1e-12


def test_missing_input_and_same_file_for_input_and_output(orientations, tmp_path):
    with pytest.raises(SceneError, match="needs an orientations file"):
        run(scene(), output=tmp_path / "charge.vtkhdf")
    with pytest.raises(InputFileError, match="no such orientations file"):
        run(scene(), input=tmp_path / "nothing.vtkhdf", output=tmp_path / "charge.vtkhdf")
    with pytest.raises(SceneError, match="same file"):
        run(scene(), input=orientations, output=orientations)


@pytest.mark.parametrize(
    ("damage", "named"),
    [
        ("shape", "fibre_direction"),
        ("missing", "platelet_normal"),
        ("nan", "fibre_direction"),
        ("length", "platelet_normal"),
    ],
)
def test_broken_orientations_are_refused_by_name(orientations, tmp_path, damage, named):
    with h5py.File(orientations, "r+") as file:
        data = file["VTKHDF/PointData"]
        if damage == "shape":
            del data["fibre_direction"]
            data["fibre_direction"] = np.zeros((20, 40, 59, 3), np.float32)
        elif damage == "missing":
            del data["platelet_normal"]
        elif damage == "nan":
            data["fibre_direction"][:, :, 30] = np.nan
        else:
            data["platelet_normal"][:, :, 30] = (0, 0, 0.5)
    with pytest.raises(InputFileError, match=named):
        run(scene(), input=orientations, output=tmp_path / "charge.vtkhdf")


def test_true_platelet_ids_come_from_the_phantoms_volume(orientations, tmp_path):
    grid = VoxelGrid((20, 40, 60), (0.1, 0.1, 0.1), (0.05, 0.05, 0.05))
    ids = np.broadcast_to(np.arange(60, dtype=np.int32) // 20, grid.shape).copy()
    truth = tmp_path / "volume.vtkhdf"
    write_voxels(
        truth, "volume", {"grey": np.zeros(grid.shape, np.uint8), "platelet_id": ids},
        grid=grid, provenance=Provenance.collect("test"),
    )  # fmt: skip
    path = run(scene(f"{{source: ct, platelet_ids: {truth}}}"), input=orientations, output=tmp_path / "charge.vtkhdf")
    charge = read_particles(path, "charge")
    assert np.array_equal(charge.fields["platelet_id"], (charge.positions[:, 0] // 2).astype(int))
    again = run(scene(), input=orientations, output=tmp_path / "again.vtkhdf", volume=truth)
    assert np.array_equal(read_particles(again, "charge").fields["platelet_id"], charge.fields["platelet_id"])
    with pytest.raises(InputFileError, match="no dataset 'platelet_id'"):
        bare = tmp_path / "bare.vtkhdf"
        fields = {"grey": np.zeros(grid.shape, np.uint8)}
        write_voxels(bare, "volume", fields, grid=grid, provenance=Provenance.collect("test"))
        run(scene(), input=orientations, output=tmp_path / "again.vtkhdf", volume=bare)


def test_stage_and_section_import_no_heavy_package():
    code = (
        "import sys, ppmc.charge.cli, ppmc.scene.sections.charge;"
        "bad = {'numba', 'scipy', 'pandas', 'pyvista', 'h5py'} & set(sys.modules); sys.exit(str(bad) if bad else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
