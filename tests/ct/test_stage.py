"""The stage as users run it: files in, files out."""

import numpy as np
import pytest
import tifffile

from ppmc.ct.field_of_view import field_of_view
from ppmc.ct.found import Found
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


@pytest.mark.parametrize(("thickness", "message"), [(140, "140 mm, but the whole volume.*5 x 4 x 2.4"), (0.02, "less")])
def test_impossible_thicknesses_are_refused_with_both_lengths(volume, tmp_path, thickness, message):
    _, path = volume
    scene = Scene(name="slip", ct={"platelet_thickness": thickness})
    with pytest.raises(SceneError, match=message):
        run(scene, input=path, output=tmp_path / "o.vtkhdf")


def round_scan(n=48, fill=0):
    """Return grey values with a texture along x in a round field of view, and the distance from its axis."""
    rng = np.random.default_rng(0)
    y, x = np.ogrid[:n, :n]
    away = np.hypot(y - 0.5 * n, x - 0.5 * n)[None]
    grey = 100 + 20 * rng.standard_normal((n, n, 1)) + 3 * rng.standard_normal((n, n, n))
    return np.where(away < 0.45 * n, grey, fill).astype(np.uint8), np.broadcast_to(away, (n, n, n))


def test_what_is_outside_of_a_round_field_of_view_is_left_out(tmp_path, capsys):
    grey, away = round_scan()
    tifffile.imwrite(tmp_path / "v.tif", grey, photometric="minisblack")
    _, fields = fields_of(run(placed(tmp_path), output=tmp_path / "o.vtkhdf"))
    assert "round field of view" in capsys.readouterr().err
    rim = (away > 0.45 * 48 - 5) & (away < 0.45 * 48 - 2)
    error = angle_between_axes(fields["fibre_direction"][rim], np.array([1.0, 0.0, 0.0]))
    assert np.median(error) < 2
    assert not fields["valid"][away > 0.45 * 48].any()
    _, fields = fields_of(run(placed(tmp_path, field_of_view=False), output=tmp_path / "p.vtkhdf"))
    assert np.median(angle_between_axes(fields["fibre_direction"][rim], np.array([1.0, 0.0, 0.0]))) > 4


def placed(folder, **mask):
    scene = Scene(name="v", ct={"source": {"path": "v.tif", "voxel_size": 0.1}, **({"mask": mask} if mask else {})})
    scene._directory = folder
    return scene


def test_no_field_of_view_where_there_is_none(in_memory):
    grey, _ = round_scan(fill=7)
    assert field_of_view(in_memory(grey)).radius == pytest.approx(0.45 * 48, abs=1)
    assert field_of_view(in_memory(np.where(grey == 7, 0, 130).astype(np.uint8)[:, 10:, :])) is None
    assert field_of_view(in_memory(np.random.default_rng(0).integers(0, 255, (24, 40, 40)).astype(np.uint8))) is None
    few = np.zeros((40, 40, 40), np.uint8)  # rods in an empty background
    few[:, 18:22, 5:35] = 200
    assert field_of_view(in_memory(few)) is None


def test_what_was_found_is_told(volume, tmp_path):
    scene, path = volume
    told = []
    out = run(scene, input=path, output=tmp_path / "o.vtkhdf", tell=told.append)
    _, fields = fields_of(out)
    valid = fields["valid"] > 0
    text = "\n".join(told)
    p = fields["fibre_direction"][valid]
    assert f"{100 * valid.mean():.1f} % of the voxels" in text
    assert f"11 {np.mean(p[:, 0] ** 2):.3f}" in text
    told_error = float(text.split("predicted error ")[1].split()[0])
    assert told_error == pytest.approx(np.median(fields["predicted_error"][valid]), abs=0.02)
    assert "N 11" in text


def test_what_was_found_in_large_results_is_that_of_some_voxels():
    rng = np.random.default_rng(0)
    p = rng.standard_normal((20, 22, 24, 3)) * (3, 1, 1)
    p /= np.linalg.norm(p, axis=-1, keepdims=True)
    scalars = {name: np.full(p.shape[:3], 0.5) for name in ("confidence", "predicted_error")}
    fields = {"fibre_direction": p, "platelet_normal": p, "valid": np.ones(p.shape[:3], np.uint8), **scalars}
    large, whole = Found((128, 128, 128)), Found((20, 22, 24))
    whole.add(fields, ((0, 20), (0, 22), (0, 24)))
    for z in (0, 5, 15):
        end = {0: 5, 5: 15, 15: 20}[z]
        large.add({name: values[z:end] for name, values in fields.items()}, ((z, end), (0, 22), (0, 24)))
    once = Found((128, 128, 128))
    once.add(fields, ((0, 20), (0, 22), (0, 24)))
    assert large.lines() == once.lines()
    assert large.lines()[0] == whole.lines()[0]
