"""p in rods with known directions: as they come, through noise, of several diameters, and whatever advice says."""

import numpy as np
import pytest

from ppmc.ct.noise import noise_level, noise_tensor
from ppmc.ct.orientations import Job, grey_reference, orientations
from ppmc.ct.settings import settings
from ppmc.ct.signal import Signal, choose, gradient_energy, signal_of
from ppmc.ct.tiles import Tiling
from ppmc.orientation import angle_between_axes
from ppmc.scene.sections.ct import CtSection

ONE = (1.0, 1.0, 1.0)
MARGIN = 8


def rods(n, radius, length, tries, kind, seed=7):
    """Return a volume of rods that do not touch, 0 to 1, blurred, and their true direction, zero outside."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    grey, fibre = np.zeros((n, n, n), np.float32), np.zeros((n, n, n, 3), np.float32)
    taken = np.zeros((n, n, n), bool)
    z, y, x = np.meshgrid(*(np.arange(n),) * 3, indexing="ij")
    for _ in range(tries):
        middle, t = rng.uniform(0, n, 3), rng.uniform(0, np.pi)
        d = {
            "random": rng.standard_normal(3),
            "planar": np.array([np.cos(t), np.sin(t), 0.1 * rng.standard_normal()]),
            "aligned": np.array([0.9, 0.27, 0.3]) + 0.06 * rng.standard_normal(3),
        }[kind]
        d /= np.linalg.norm(d)
        a, b, c = x - middle[0], y - middle[1], z - middle[2]
        along = a * d[0] + b * d[1] + c * d[2]
        across = np.sqrt(np.maximum(a * a + b * b + c * c - along * along, 0))
        if taken[(across < radius + 1) & (abs(along) < length / 2 + 1)].any():
            continue
        inside = (across < radius) & (abs(along) < length / 2)
        taken |= inside
        fibre[inside] = d
        part = np.clip(radius - across + 0.5, 0, 1) * np.clip(length / 2 - abs(along) + 0.5, 0, 1)
        grey = np.maximum(grey, part)
    return gaussian_filter(grey, 0.6), fibre


@pytest.fixture(scope="module")
def thin():
    return rods(56, 1.75, 40, 150, "planar")


@pytest.fixture(scope="module")
def thick():
    return rods(56, 3.0, 50, 60, "random")


def recorded(grey, noise, seed=2):
    value = 80 + 80 * (grey + noise * np.random.default_rng(seed).standard_normal(grey.shape))
    return np.clip(value.round(), 0, 255).astype(np.uint8)


def found(volume, **section):
    """Return the fields, as the stage makes them from a volume."""
    reference, level = grey_reference(volume), noise_level(volume)
    chosen = settings(CtSection(**section), ONE, volume.shape, None, signal_of(volume, ONE, level))
    job = Job(volume, ONE, chosen, reference, noise=noise_tensor(chosen, level / reference.unit), least_confidence=0.05)
    return next(iter(orientations(job, 1, Tiling(job.shape, job.shape)))).fields


def errors(fields, fibre):
    inside = np.zeros(fibre.shape[:3], bool)
    inside[MARGIN:-MARGIN, MARGIN:-MARGIN, MARGIN:-MARGIN] = True
    inside &= (fibre != 0).any(axis=-1)
    p, true = fields["fibre_direction"][inside].astype(float), fibre[inside].astype(float)
    error = angle_between_axes(p, true)
    tensor = np.abs(p.T @ p - true.T @ true).max() / len(p)
    return np.median(error), np.percentile(error, 95), tensor


@pytest.mark.parametrize(
    ("phantom", "noise", "median", "most"),
    [
        ("thin", 0.0, 0.3, 9), ("thin", 1 / 3, 1.8, 12), ("thin", 1.0, 8.0, 36),
        ("thick", 0.0, 0.3, 9), ("thick", 1 / 3, 1.3, 12), ("thick", 1.0, 4.0, 25),
    ],
)  # fmt: skip
def test_rods(request, in_memory, phantom, noise, median, most):
    grey, fibre = request.getfixturevalue(phantom)
    fields = found(in_memory(recorded(grey, noise)))
    got = errors(fields, fibre)
    assert got[0] < median
    assert got[1] < most
    assert got[2] < (0.01 if noise < 1 else 0.03)
    if noise > 0:
        assert 1 / 1.5 < np.median(fields["predicted_error"][(fibre != 0).any(axis=-1)]) / got[0] < 1.5


def test_without_a_platelet_thickness_nothing_pulls_p_into_a_plane(in_memory, thin):
    """Normals or none, from whatever window: p is the same."""
    volume = in_memory(recorded(thin[0], 1 / 3))
    p = found(volume)["fibre_direction"]
    assert np.array_equal(p, found(volume, normals=False, follow=True)["fibre_direction"])
    assert np.array_equal(p, found(volume, normal_window=4.0)["fibre_direction"])


def test_fixed_windows_are_those_of_one_round_window(in_memory, thin):
    volume = in_memory(recorded(thin[0], 0.0))
    quick, _, _ = errors(found(volume, normals=False), thin[1])
    assert errors(found(volume), thin[1])[0] < quick < 2.0


def test_noise_and_scale_decide_on_windows():
    sigmas = np.linspace(1.0, 3.0, 21)
    edges = sigmas**-1.0
    assert choose(sigmas, edges, np.zeros(21)) == Signal(1.0, 0.0, 3.0)
    # noise as strong as the signal at one voxel, falling with the fifth power: (s^4) halves the odds at 2^(1/4)
    noisy = choose(sigmas, edges + sigmas**-5.0, sigmas**-5.0)
    assert noisy.sigma == pytest.approx(2**0.25, abs=0.1)
    # a signal as fine as the voxels bears no smoothing
    fine = choose(sigmas, sigmas**-4.0 + 9 * sigmas**-5.0, 9 * sigmas**-5.0)
    assert fine.sigma == pytest.approx(1.3)
    assert fine.scale == 1.0


def test_energy_of_gradients_of_noise_and_of_a_wave():
    noise = np.random.default_rng(0).standard_normal((32, 32, 32))
    sigmas = np.array([1.0, 1.5])
    energy, white = gradient_energy(noise, ONE, sigmas)
    assert energy == pytest.approx(white, rel=0.1)
    # white noise after a Gaussian: the mean squared gradient is 3 / (16 pi^(3/2) s^5); the sum is over 32^3 waves
    assert white / 32**3 == pytest.approx(3 / (16 * np.pi**1.5 * sigmas**5), rel=0.02)
    wave = 2 * np.pi / 8
    x = np.arange(32)
    energy, _ = gradient_energy(np.cos(wave * x) * np.ones((32, 32, 1)), ONE, sigmas)
    assert energy / 32**3 == pytest.approx(0.5 * wave**2 * np.exp(-((wave * sigmas) ** 2)), rel=0.1)
