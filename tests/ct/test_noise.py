"""Noise is measured, its tilt is taken off, and the error it causes is foretold."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from ppmc.ct.floor import gradient_floor, raised
from ppmc.ct.noise import noise_level, noise_tensor, tilting_part
from ppmc.ct.orientations import grey_reference
from ppmc.ct.settings import settings
from ppmc.ct.signal import signal_of
from ppmc.orientation import angle_between_axes
from ppmc.scene.sections.ct import CtSection

ANISOTROPIC = (1.0, 1.0, 2.5)
FLAT_VOXELS = {"sigma": 1.4, "fibre_window": 5.0, "normal_window": 5.0}


@pytest.mark.parametrize("level", [0.1, 1.0])
@pytest.mark.parametrize("direction", [(1, 0, 0), (1, 1, 0.2)])
def test_level_is_found_under_fibres(texture, in_memory, level, direction):
    grey = texture(direction, n=48) / 2.5
    noisy = grey + level * np.random.default_rng(0).standard_normal(grey.shape).astype(np.float32)
    assert noise_level(in_memory(noisy)) == pytest.approx(level, rel=0.15)


def test_tensor_is_what_white_noise_gives(solve, in_memory):
    grey = np.random.default_rng(1).standard_normal((48, 48, 48)).astype(np.float32)
    chosen = settings(CtSection(**FLAT_VOXELS), ANISOTROPIC, grey.shape, None)
    want = noise_tensor(chosen, 1.0)
    result = solve(grey, spacing=ANISOTROPIC, **FLAT_VOXELS)
    trace = result["eigenvalues"].sum(axis=-1).mean()
    assert trace == pytest.approx(want[:3].sum(), rel=0.1)
    assert want[0] == pytest.approx(want[1])
    assert want[2] < 0.9 * want[0]
    assert tilting_part(want).tolist() == pytest.approx([want[0] - want[2], want[1] - want[2], 0, 0, 0, 0])


def test_cubic_voxels_are_not_tilted(in_memory):
    chosen = settings(CtSection(), (0.1, 0.1, 0.1), (40, 40, 40), None)
    assert not tilting_part(noise_tensor(chosen, 1.0)).any()


def test_correction_brings_p_nearer_where_voxels_are_not_cubes(solve, texture):
    direction = np.array([1.0, 0.3, 0.8])
    grey = texture(direction, n=40, waves=30, seed=1, spacing=ANISOTROPIC)
    grey = grey / grey.std() + 0.7 * np.random.default_rng(2).standard_normal(grey.shape).astype(np.float32)
    chosen = settings(CtSection(**FLAT_VOXELS), ANISOTROPIC, grey.shape, None)
    tensor = noise_tensor(chosen, 0.7 / grey.std())
    error = []
    for noise in (None, tensor):
        result = solve(grey, spacing=ANISOTROPIC, noise=noise, **FLAT_VOXELS)
        error.append(np.median(angle_between_axes(result["fibre_direction"][8:-8, 8:-8, 8:-8], direction)))
    assert error[1] < 0.85 * error[0]


@pytest.mark.parametrize("window", [2.0, (3.5, 3.5, 0.7), None])
@pytest.mark.parametrize("noise", [0.2, 0.8])
def test_predicted_error_is_the_error_made(solve, texture, window, noise):
    direction = np.array([1.0, 0.4, 0.0])
    grey = texture(direction, n=56, waves=40)
    grey = grey / grey.std() + noise * np.random.default_rng(5).standard_normal(grey.shape).astype(np.float32)
    # with a platelet thickness and no window the default follows the platelets' plane
    result = solve(grey, fibre_window=window, normal_window=6.0, thickness=None if window else 8.0)
    inside = np.s_[10:-10, 10:-10, 10:-10]
    made = np.sqrt(np.mean(angle_between_axes(result["fibre_direction"][inside], direction) ** 2))
    foretold = np.sqrt(np.mean(result["predicted_error"][inside].astype(float) ** 2))
    assert 0.55 < foretold / made < 1.8


def test_pure_noise_is_invalid(solve):
    grey = np.random.default_rng(1).standard_normal((40, 40, 40)).astype(np.float32)
    chosen = settings(CtSection(), (1.0, 1.0, 1.0), grey.shape, None)
    result = solve(grey, noise=noise_tensor(chosen, 1.0))
    assert result["valid"].mean() < 0.02


def test_eigenvalue_fields_are_finite_and_errors_bounded(solve):
    grey = np.zeros((24, 24, 24), np.float32)
    grey[12:] = 1.0
    result = solve(grey)
    assert np.isfinite(result["predicted_error"]).all()
    assert result["predicted_error"].max() <= 90.0


def test_settings_are_plain_data():
    chosen = settings(CtSection(), (0.1, 0.1, 0.1), (64, 64, 64), 0.6)
    assert dataclasses.is_dataclass(chosen)
    assert chosen.fibre_window[2] < chosen.fibre_window[0]


@pytest.mark.parametrize("blur", [0.5, 0.8, 1.2, 1.6])
@pytest.mark.parametrize("thickness", [None, 8.0])
def test_noise_of_any_spectrum_is_invalid(solve, in_memory, blur, thickness):
    grey = gaussian_filter(np.random.default_rng(3).standard_normal((56, 56, 56)), blur).astype(np.float32)
    volume, spacing = in_memory(grey), (1.0, 1.0, 1.0)
    reference, level = grey_reference(volume), noise_level(volume)
    signal = signal_of(volume, spacing, level)
    chosen = settings(CtSection(), spacing, grey.shape, thickness, signal)
    white = noise_tensor(chosen, level / reference.unit)
    floor = gradient_floor(volume, spacing, chosen, reference, signal.scale)
    assert floor > 3 * white[:3].sum()
    result = solve(grey, noise=raised(white, floor), thickness=thickness)
    assert result["valid"].mean() < 0.02


def test_floor_leaves_white_noise_and_texture_alone(texture, in_memory):
    spacing = (1.0, 1.0, 1.0)
    for grey in (np.random.default_rng(1).standard_normal((48, 48, 48)).astype(np.float32), texture((1, 0.4, 0.2), 48)):
        volume = in_memory(grey)
        reference, level = grey_reference(volume), noise_level(volume)
        chosen = settings(CtSection(), spacing, grey.shape, None)
        white = noise_tensor(chosen, max(level / reference.unit, 0.05))
        floor = gradient_floor(volume, spacing, chosen, reference, 1.0)
        assert np.array_equal(raised(white, floor), white)


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_median_of_the_predicted_error_is_that_of_the_error_in_platelets(solve, texture, noise):
    direction = np.array([1.0, 0.4, 0.2])
    grey = texture(direction, n=56, waves=40)
    grey = grey / grey.std() + noise * np.random.default_rng(5).standard_normal(grey.shape).astype(np.float32)
    result = solve(grey, thickness=8.0)
    inside = np.s_[10:-10, 10:-10, 10:-10]
    made = np.median(angle_between_axes(result["fibre_direction"][inside], direction))
    assert 1 / 1.5 < np.median(result["predicted_error"][inside]) / made < 1.5
