"""The stage as users run it: files in, files out."""

import numpy as np
import pytest
import tifffile

from ppmc.ct.stage import make_phantom, run
from ppmc.errors import InputFileError, SceneError
from ppmc.files import read_voxels
from ppmc.orientation import angle_between_axes
from ppmc.scene import Scene

PHANTOM = {"cavity": (5, 4, 2.4), "voxel_size": 0.1, "platelet": {"length": 3, "width": 2, "thickness": 0.6}}


@pytest.fixture(scope="module")
def volume(tmp_path_factory):
    scene = Scene(name="small", seed=3, phantom=PHANTOM, ct={})
    return scene, make_phantom(scene, tmp_path_factory.mktemp("phantom") / "volume.vtkhdf")


def fields_of(path):
    with read_voxels(path, "orientations") as file:
        return file.grid, {name: file.read(name) for name in file.names}


def test_phantom_and_orientations_share_their_grid(volume, tmp_path):
    scene, path = volume
    out = run(scene, input=path, output=tmp_path / "orientations.vtkhdf")
    with read_voxels(path, "volume") as file:
        grid = file.grid
        assert set(file.names) == {"grey", "mask", "fibre_direction", "platelet_normal", "platelet_id"}
    found, fields = fields_of(out)
    assert found == grid
    assert fields["valid"].mean() > 0.9
    with read_voxels(out, "orientations") as file:
        file.read_frames()


def test_stride_and_registration(volume, tmp_path):
    scene, path = volume
    _, plain = fields_of(run(scene, input=path, output=tmp_path / "plain.vtkhdf"))
    place = {"origin": (1, 2, 3), "rotation": (0, 0, 90)}
    placed = scene.model_copy(update={"ct": scene.ct.model_copy(update={"stride": 2})})
    placed = Scene(name="placed", ct={"stride": 2, "registration": place, "platelet_thickness": 0.6})
    grid, fields = fields_of(run(placed, input=path, output=tmp_path / "placed.vtkhdf"))
    assert grid.spacing == (0.2, 0.2, 0.2)
    assert grid.origin == (1, 2, 3)
    assert np.allclose(grid.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = plain["fibre_direction"][::2, ::2, ::2] @ grid.rotation.T
    error = angle_between_axes(fields["fibre_direction"], turned)
    assert np.median(error) < 0.05


def test_tiff_and_vtkhdf_give_the_same(volume, tmp_path):
    scene, path = volume
    with read_voxels(path, "volume") as file:
        tifffile.imwrite(tmp_path / "stack.tif", file.read("grey"), photometric="minisblack")
    _, own = fields_of(run(scene, input=path, output=tmp_path / "a.vtkhdf"))
    other = Scene(name="tiff", ct={"source": {"voxel_size": 0.1, "path": "stack.tif"}, "platelet_thickness": 0.6})
    other._directory = tmp_path
    _, tiff = fields_of(run(other, output=tmp_path / "b.vtkhdf"))
    inner = np.s_[6:-6, 6:-6, 6:-6]
    assert angle_between_axes(own["fibre_direction"][inner], tiff["fibre_direction"][inner]).max() < 0.1


def test_mask_of_the_scene(volume, tmp_path):
    _, path = volume
    mask = np.zeros((24, 40, 50), np.uint8)
    mask[2:-2, 5:-5, 5:-5] = 1
    tifffile.imwrite(tmp_path / "mask.tif", mask, photometric="minisblack")
    scene = Scene(name="masked", ct={"mask": {"path": str(tmp_path / "mask.tif")}})
    _, fields = fields_of(run(scene, input=path, output=tmp_path / "m.vtkhdf"))
    assert not fields["valid"][mask == 0].any()
    assert fields["valid"][mask > 0].mean() > 0.9


@pytest.mark.parametrize(
    ("section", "kind", "message"),
    [
        ({"fibre_window": 3.0}, SceneError, "fibre_window.*larger than the volume"),
        ({"normal_window": 2.0}, SceneError, "normal_window.*larger than the volume"),
        ({"sigma": 0.02}, SceneError, "finer than half a voxel"),
        ({"mask": {"path": "mask.tif"}}, InputFileError, "mask has shape"),
        ({"mask": {"path": "none.tif"}}, InputFileError, "no such file"),
    ],
)
def test_what_does_not_fit_is_refused(volume, tmp_path, section, kind, message):
    _, path = volume
    tifffile.imwrite(tmp_path / "mask.tif", np.ones((24, 40, 49), np.uint8), photometric="minisblack")
    scene = Scene(name="bad", ct=section)
    scene._directory = tmp_path
    with pytest.raises(kind, match=message):
        run(scene, input=path, output=tmp_path / "o.vtkhdf")
    assert not (tmp_path / "o.vtkhdf").exists()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_voxel_that_is_no_number_is_named_wherever_it_is(tmp_path, bad):
    grey = np.random.default_rng(0).standard_normal((80, 24, 24)).astype(np.float32)
    grey[41, 5, 6] = bad  # not among the planes from which the mean grey value is taken
    tifffile.imwrite(tmp_path / "a.tif", grey, photometric="minisblack")
    scene = Scene(name="nan", ct={"source": {"voxel_size": 0.1}, "noise_level": 0.1})
    with pytest.raises(InputFileError, match=r"\[41, 5, 6\] is (nan|inf), which is no grey value"):
        run(scene, input=tmp_path / "a.tif", output=tmp_path / "o.vtkhdf")
    assert not (tmp_path / "o.vtkhdf").exists()


def test_voxel_size_must_be_known(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((24, 24, 24), np.uint8), photometric="minisblack")
    with pytest.raises(SceneError, match="voxel_size"):
        run(Scene(name="bare", ct={}), input=tmp_path / "a.tif", output=tmp_path / "o.vtkhdf")


def test_input_must_not_be_the_output(volume):
    scene, path = volume
    with pytest.raises(SceneError, match="same file"):
        run(scene, input=path, output=path)
