"""Advice, segmentation and figures."""

import numpy as np
import pytest

from ppmc.ct.figures import draw
from ppmc.ct.phantom import Phantom
from ppmc.ct.segment import mask_reader, specimen_mask
from ppmc.ct.stage import make_phantom, run, suggest
from ppmc.ct.suggest import advise, texture_spectrum
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


def test_advice_follows_wavelength_and_thickness(in_memory):
    fine = advise(in_memory(plane_waves(64, 5.0)), (0.1, 0.1, 0.1), None)
    coarse = advise(in_memory(plane_waves(64, 10.0)), (0.1, 0.1, 0.1), None)
    assert fine.sigma == pytest.approx(0.1, rel=0.15)
    assert coarse.sigma == pytest.approx(2 * fine.sigma, rel=0.2)
    assert fine.signal_to_noise == pytest.approx(10.0, rel=0.3)
    assert fine.fibre_window == pytest.approx((2 * fine.sigma,) * 3)
    # the window follows the platelets' plane where their thickness is known
    platelets = advise(in_memory(plane_waves(64, 5.0)), (0.1, 0.1, 0.1), 0.6)
    assert platelets.fibre_window is None
    assert not any("fibre_window" in line for line in platelets.lines())


def test_a_volume_without_texture_gets_advice_all_the_same(in_memory):
    advice = advise(in_memory(np.full((40, 40, 40), 7, np.uint8)), (0.1, 0.1, 0.1), None)
    assert advice.sigma > 0


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
    assert "sigma:" in text
    out = run(scene, input=volume, output=tmp_path / "o.vtkhdf")
    files = draw(out, tmp_path / "figures")
    assert len(files) == 5
    assert all(f.stat().st_size > 5000 for f in files)
