from __future__ import annotations

import numpy as np
import pytest

from ppmc.analysis.averages.averages import in_frames, region_averages
from ppmc.analysis.averages.paths import circle_path, line_path, straight_path, swept_path
from ppmc.errors import SceneError
from ppmc.particles import Particles


def ring(n: int = 40_000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points around the x1 axis, and the radial and hoop directions there (θ from -x3 towards x2)."""
    rng = np.random.default_rng(2)
    x = rng.uniform([-2, -10, -10], [2, 10, 10], (n, 3)) + np.array([0, 3, 20])
    d = x - [0, 3, 20]
    angle = np.arctan2(d[:, 1], -d[:, 2])
    radial = np.column_stack([0 * angle, np.sin(angle), -np.cos(angle)])
    hoop = np.column_stack([0 * angle, np.cos(angle), np.sin(angle)])
    return x, radial, hoop


def test_circle_sees_an_analytic_field() -> None:
    """A fibre 30 degrees off the hoop direction has A_rr = 1/4, A_θθ = 3/4 at every θ; normals along x1, N_11 = 1."""
    x, radial, hoop = ring()
    p = 0.5 * radial + np.sqrt(0.75) * hoop
    s = Particles("ring", x, np.ones(len(x)), p, np.tile([1.0, 0, 0], (len(x), 1)))
    path = circle_path("hole", [0, 3, 20], [1, 0, 0], [0, 0, -1], 4, 8, 3, 72, 5.0)
    a = in_frames(region_averages(s, path.regions), path.frames)
    half = np.radians(2.5)
    # Over a sector of half-angle w the field turns with θ: cos² of the turn is averaged.
    mean = 0.5 + 0.5 * np.sin(2 * half) / (2 * half)
    expected_rr = 0.25 * mean + 0.75 * (1 - mean)
    assert path.components == ("r", "θ", "x1")
    assert np.abs(a.fibre_tensor[:, 0, 0] - expected_rr).max() < 5e-3
    assert np.abs(a.fibre_tensor[:, 1, 1] - (1 - expected_rr)).max() < 5e-3
    assert np.allclose(a.normal_tensor[:, 2, 2], 1, atol=1e-12)
    assert path.coordinate[18] == pytest.approx(90)
    assert np.allclose(path.frames[18, 0], [0, 1, 0], atol=1e-12)


def test_circle_turns_every_fibre_exactly() -> None:
    """δ past the middle of a sector the same fibre has p_r = ½ cos δ − √¾ sin δ in the sector's own axes."""
    x, radial, hoop = ring(20_000)
    s = Particles("ring", x, np.ones(len(x)), 0.5 * radial + np.sqrt(0.75) * hoop)
    path = circle_path("hole", [0, 3, 20], [1, 0, 0], [0, 0, -1], 4, 8, 3, 36, 10.0)
    a = in_frames(region_averages(s, path.regions), path.frames)
    d = x - [0, 3, 20]
    theta = np.degrees(np.arctan2(d[:, 1], -d[:, 2]))
    for k, region in enumerate(path.regions):
        delta = np.radians(theta[region.contains(x)] - path.coordinate[k])
        p_r = 0.5 * np.cos(delta) - np.sqrt(0.75) * np.sin(delta)
        p_t = 0.5 * np.sin(delta) + np.sqrt(0.75) * np.cos(delta)
        expected = [[np.mean(p_r**2), np.mean(p_r * p_t)], [np.mean(p_r * p_t), np.mean(p_t**2)]]
        assert np.abs(a.fibre_tensor[k, :2, :2] - expected).max() < 1e-12
        assert a.fibre_tensor4[k, 0, 0, 1, 1] == pytest.approx(np.mean(p_r**2 * p_t**2), abs=1e-12)


def test_circle_covers_the_ring_once() -> None:
    x, radial, _ = ring(5000)
    s = Particles("ring", x, np.ones(len(x)), radial)
    path = circle_path("hole", [0, 3, 20], [1, 0, 0], [0, 0, -1], 4, 8, 3, 36, 10.0)
    d = x - [0, 3, 20]
    rho = np.hypot(d[:, 1], d[:, 2])
    inside = (rho >= 4) & (rho < 8) & (np.abs(d[:, 0]) < 1.5)
    assert region_averages(s, path.regions).particle_count.sum() == inside.sum()


def test_straight_path_reads_a_linear_field() -> None:
    x = np.random.default_rng(0).uniform(0, [50, 5, 3], (60_000, 3))
    angle = x[:, 0] / 50 * np.pi / 2
    p = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    path = straight_path("base", 0, 50, [0, -np.inf, -np.inf], [50, np.inf, np.inf])
    a = region_averages(Particles("s", x, np.ones(len(x)), p), path.regions)
    assert np.abs(a.fibre_tensor[:, 0, 0] - np.cos(path.coordinate / 50 * np.pi / 2) ** 2).max() < 2e-3


def test_swept_rectangle_stays_inside_and_is_limited_in_length() -> None:
    path = swept_path("bar", 2, 0, 150, 10, 5.0, -60, 60, 23)
    low, high = path.regions[0].bounds()
    assert (low[0], high[0]) == (-60, -50)
    assert (low[2], high[2]) == (-70, 80)
    assert path.regions[-1].bounds()[1][0] == 60
    assert np.isinf(low[1])


def test_line_path_is_right_handed_and_equally_spaced() -> None:
    path = line_path("l", [[0, 0, 0], [3, 0, 0], [3, 4, 0]], 0.5, 15, [0, 0, 1])
    assert np.allclose(np.linalg.det(path.frames), 1)
    assert np.allclose(np.diff(path.coordinate), 0.5)
    assert np.allclose(path.regions[-1].centre, [3, 4, 0])
    assert np.allclose(path.frames[-1], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    "make",
    [
        lambda: straight_path("p", 0, 5, [0, 0, 0], [np.inf, 1, 1]),
        lambda: straight_path("p", 0, 5, [np.nan] * 3, [np.nan] * 3),
        lambda: swept_path("p", 1, 1, 10, 1, 0, 0, 5, 3),
        lambda: swept_path("p", 2, 0, 10, 1, 0, np.nan, 5, 3),
        lambda: line_path("p", [[0, 0, 0], [0, 0, 0]], 1, 3, [0, 0, 1]),
        lambda: line_path("p", [[0, 0, 0], [0, 0, 1]], 1, 3, [0, 0, 1]),
    ],
)
def test_impossible_paths_say_so(make: object) -> None:
    with pytest.raises(SceneError):
        make()  # type: ignore[operator]
