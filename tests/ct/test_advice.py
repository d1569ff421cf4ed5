"""Advice, segmentation and figures."""

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter

from ppmc.ct.figures import draw
from ppmc.ct.phantom import Phantom
from ppmc.ct.segment import mask_reader, specimen_mask
from ppmc.ct.stage import make_phantom, run, suggest
from ppmc.ct.suggest import texture_spectrum
from ppmc.files import read_voxels
from ppmc.scene import Scene
from ppmc.scene.sections.phantom import PhantomSection

PHANTOM = {"cavity": (6, 5, 3.0), "voxel_size": 0.1, "platelet": {"length": 3, "width": 2, "thickness": 0.6}}


def plane_waves(n, wavelength, noise=0.1):
    rng = np.random.default_rng(0)
    z, y, _ = np.meshgrid(*(np.arange(n),) * 3, indexing="ij")
    grey = np.zeros((n, n, n))
    for _ in range(20):
        a = rng.uniform(0, 2 * np.pi)
        grey += np.sin(2 * np.pi / wavelength * (np.cos(a) * y + np.sin(a) * z) + rng.uniform(0, 7))
    return (grey / grey.std() + noise * rng.standard_normal(grey.shape)).astype(np.float32)


@pytest.mark.parametrize("wavelength", [4.0, 6.0, 10.0])
def test_wavelength_and_strength_of_plane_waves(in_memory, wavelength):
    found, variance = texture_spectrum(in_memory(plane_waves(64, wavelength)), (0.5, 0.5, 0.5))
    assert found == pytest.approx(0.5 * wavelength, rel=0.1)
    assert variance == pytest.approx(1.0, rel=0.3)


def scene_of(tmp_path, grey, **ct):
    tifffile.imwrite(tmp_path / "v.tif", grey, photometric="minisblack")
    scene = Scene(name="v", ct={"source": {"path": "v.tif", "voxel_size": 0.1}, **ct})
    scene._directory = tmp_path
    return scene


def advised(scene):
    """Return the section that the advice prints, and its remarks."""
    lines = suggest(scene)
    start = lines.index("ct:") + 1
    return dict(line.strip().split(": ") for line in lines[start:]), lines[: start - 1]


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_wavelength_through_noise(in_memory, noise):
    found, variance = texture_spectrum(in_memory(plane_waves(64, 9.0, noise)), (1.0, 1.0, 1.0))
    assert found == pytest.approx(9.0, rel=0.1)
    assert variance == pytest.approx(1.0, rel=0.3)


def test_advice_is_what_a_run_does_by_itself(tmp_path):
    rng = np.random.default_rng(0)
    grey = (plane_waves(48, 8.0) + 2.0 * rng.standard_normal((48, 48, 48))).astype(np.float32)
    scene = scene_of(tmp_path, grey)
    section, _ = advised(scene)
    assert "platelet_thickness" not in section
    asked = scene_of(tmp_path, grey, **section)
    p = []
    for k, each in enumerate((scene, asked)):
        with read_voxels(run(each, output=tmp_path / f"{k}.vtkhdf"), "orientations") as file:
            p.append(file.read("fibre_direction"))
    assert np.array_equal(*p)


@pytest.mark.parametrize("thickness", [0.6, 1.2])
def test_platelets_are_seen_and_told_from_noise(tmp_path, thickness):
    section = PhantomSection(
        cavity=(6.4, 6.4, 6.4), voxel_size=0.1, layup="plies", angles=[0, 60, -30, 90, 30, -60], tilt=(16, 10),
        platelet={"length": 4, "width": 2, "thickness": thickness}, void_fraction=0.0, noise=0.3,
    )  # fmt: skip
    grey = np.concatenate([s.fields["grey"] for s in Phantom(section, 1).slabs()])
    section, remarks = advised(scene_of(tmp_path, grey))
    assert float(section["platelet_thickness"].split()[0]) == pytest.approx(thickness, rel=0.35)
    assert any("confidence" in line for line in remarks)
    noise = np.random.default_rng(0).integers(0, 255, (48, 48, 48)).astype(np.uint8)
    assert "platelet_thickness" not in advised(scene_of(tmp_path, noise))[0]


def test_noise_that_is_not_white_gets_no_level(tmp_path):
    noise = gaussian_filter(np.random.default_rng(0).standard_normal((48, 48, 48)), 0.8)
    section, remarks = advised(scene_of(tmp_path, noise.astype(np.float32)))
    assert "noise_level" not in section
    assert any("not white" in line for line in remarks)


def test_a_volume_without_texture_gets_advice_all_the_same(tmp_path):
    section, _ = advised(scene_of(tmp_path, np.full((40, 40, 40), 7, np.uint8)))
    assert float(section["sigma"].split()[0]) > 0


def test_specimen_is_found_in_air(in_memory):
    phantom = Phantom(PhantomSection(**PHANTOM, margin=1.0, void_contrast=8.0), 1)
    fields = [s.fields for s in phantom.slabs()]
    grey, truth = (np.concatenate([f[name] for f in fields]) for name in ("grey", "mask"))
    mask, cell = specimen_mask(in_memory(grey))
    assert cell == 1
    assert np.mean(mask == truth) > 0.98
    core = np.s_[12:-12, 12:-12, 12:-12]
    assert mask[core].mean() > 0.99  # a void open to the outside is air
    without, _ = specimen_mask(in_memory(grey), exclude_voids=True)
    assert 0.9 < without[core].mean() < mask[core].mean()


def test_without_air_everything_is_specimen(in_memory):
    assert specimen_mask(in_memory(plane_waves(32, 5.0)))[0].all()


def test_coarse_mask_reads_like_a_fine_one():
    coarse = np.arange(8, dtype=np.uint8).reshape(2, 2, 2)
    read = mask_reader(coarse, 3)
    assert np.array_equal(read((slice(2, 4), slice(0, 1), slice(3, 6))), [[[1, 1, 1]], [[5, 5, 5]]])


def test_segmented_run_suggestion_and_figures(tmp_path):
    scene = Scene(name="s", phantom={**PHANTOM, "margin": 0.5, "void_contrast": 8.0}, ct={"mask": {"segment": True}})
    volume = make_phantom(scene, tmp_path / "volume.vtkhdf")
    text = "\n".join(suggest(scene, input=volume))
    assert "noise_level:" in text
    out = run(scene, input=volume, output=tmp_path / "o.vtkhdf")
    files = draw(out, tmp_path / "figures")
    assert len(files) == 5
    assert all(f.stat().st_size > 5000 for f in files)
