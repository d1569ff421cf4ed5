from __future__ import annotations

import numpy as np
import pytest

from ppmc.analysis.averages.averages import region_averages
from ppmc.analysis.averages.regions import box, everything
from ppmc.analysis.flow.ensemble import ensemble, particle_difference
from ppmc.analysis.flow.fill import fill_times
from ppmc.analysis.flow.knit import find_knit_lines
from ppmc.analysis.flow.occupancy import Cells, cells_around
from ppmc.particles import Particles


def lattice(low: tuple[float, ...], high: tuple[float, ...], h: float = 1.0) -> np.ndarray:
    axes = [np.arange(a + h / 2, b, h) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def cubes(positions: np.ndarray, F: np.ndarray | None = None, h: float = 1.0) -> Particles:
    n = len(positions)
    fields = {} if F is None else {"deformation_gradient": np.broadcast_to(F, (n, 3, 3)).reshape(n, 9)}
    return Particles("s", positions, np.full(n, h**3), fields=fields)


def test_fill_time_of_a_moving_front() -> None:
    """A block that grows at 1 mm/s along x1 from 4 mm: the place x fills at x − 4 s, as fine as cells and frames."""
    frames = [(t, cubes(lattice((0, 0, 0), (4 + t, 4, 4)))) for t in np.arange(0.0, 9.0)]
    cells = cells_around([s.positions for _, s in frames], 0.5, 1.0)
    final = frames[-1][1]
    times = fill_times(frames, cells, final)
    expected = np.maximum(np.floor(final.positions[:, 0]) - 3, 0)
    assert np.array_equal(times, expected)


def test_fill_time_of_a_squeeze() -> None:
    """Stretched along x1 by 1 + t: the place x fills when 10 (1 + t) = x, whatever the distance between particles."""
    x, times = lattice((0, 0, 0), (10, 6, 6), 0.5), np.linspace(0, 1, 41)
    frames = []
    for t in times:
        F = np.diag([1 + t, 1.0, 1 / (1 + t)])
        frames.append((t, cubes(x @ F.T, F, 0.5)))
    cells = cells_around([frames[0][1].positions, frames[-1][1].positions], 0.5, 0.5)
    found = fill_times(frames, cells, frames[-1][1])
    front = frames[-1][1].positions[:, 0]
    expected = np.maximum(front / 10 - 1, 0)
    # Half a cell and a frame.
    assert np.abs(found - expected).max() < 0.5 * 0.5 / 10 + 0.025 + 0.02


def test_places_never_reached_are_nan() -> None:
    cells = Cells(np.zeros(3), 1.0, (10, 1, 1))
    start, end = cubes(np.array([[0.5, 0.5, 0.5]])), cubes(np.array([[0.5, 0.5, 0.5], [7.5, 0.5, 0.5]]))
    times = fill_times([(0.0, start)], cells, end)
    assert times[0] == 0 and np.isnan(times[1])


def two_fronts(stretch: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two blocks that started 20 mm apart and now touch at x2 = 0; F = diag(s, 1/s, 1)."""
    now = lattice((0, -6, 0), (10, 6, 4))
    side = np.sign(now[:, 1])
    F = np.diag([stretch, 1 / stretch, 1.0])
    start = now @ np.linalg.inv(F).T + np.column_stack([0 * side, 10 * side, 0 * side])
    return now, start, np.broadcast_to(F, (len(now), 3, 3))


@pytest.mark.parametrize("stretch", [1.0, 3.0])
def test_knit_line_is_where_two_fronts_met(stretch: float) -> None:
    now, start, F = two_fronts(stretch)
    rng = np.random.default_rng(0)
    p = np.column_stack([np.cos(a := rng.uniform(0, np.pi, len(now))), 0 * a, np.sin(a)])
    r = np.tile([0.0, 1.0, 0.0], (len(now), 1))
    side = now[:, 1] > 0
    knit = find_knit_lines(now, start, 1.0, p, r, F)
    assert set(np.flatnonzero(np.abs(now[:, 1]) < 1)) <= set(knit.index)
    assert np.abs(now[knit.index, 1]).max() < 2.1
    near = np.abs(now[knit.index, 1]) < 1
    assert np.abs(knit.across[near, 1]).min() > 0.75
    assert np.median(knit.crossing[near]) < 0.06 and np.median(knit.normal_across[near]) > 0.9
    # Where only the particles that lie across have volume, all that is there crosses.
    heavy = find_knit_lines(now, start, 1.0, np.where(side[:, None], r, p), r, F, np.where(side, 1.0, 1e-9))
    assert np.median(heavy.crossing[np.abs(now[heavy.index, 1]) < 1]) > 0.75


def test_affine_flow_has_no_knit_line_however_stretched() -> None:
    now, _, _ = two_fronts()
    F = np.array([[4.0, 0.5, 0], [0, 0.5, 0], [0, 0, 0.5]])
    start = now @ np.linalg.inv(F).T
    knit = find_knit_lines(
        now, start, 1.0, np.tile([1.0, 0, 0], (len(now), 1)), None, np.broadcast_to(F, (len(now), 3, 3))
    )
    assert len(knit) == 0 and knit.share.max() == 0
    assert len(find_knit_lines(now[:3], start[:3], 1.0, np.eye(3))) == 0


def test_ensemble_mean_and_spread() -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 1, (50, 3))
    runs = []
    regions = [everything(), box("far", [5, 5, 5], [6, 6, 6])]
    for angle in (0.2, 0.4, 0.6):
        p = np.tile([np.cos(angle), np.sin(angle), 0], (50, 1))
        runs.append(region_averages(Particles("s", x, np.ones(50), p), regions))
    e = ensemble(runs)
    values = np.cos([0.2, 0.4, 0.6]) ** 2
    assert e.fibre_mean[0, 0, 0] == pytest.approx(values.mean())
    assert e.fibre_spread[0, 0, 0] == pytest.approx(values.std(ddof=1))
    assert e.filled.tolist() == [3, 0] and np.isnan(e.fibre_mean[1]).all() and np.isnan(e.normal_mean).all()
    assert np.isnan(ensemble(runs[:1]).fibre_spread).all()


def test_difference_of_two_runs() -> None:
    x = lattice((0, 0, 0), (5, 5, 5))
    p = np.tile([1.0, 0, 0], (len(x), 1))
    q = np.tile([-np.cos(0.1), np.sin(0.1), 0], (len(x), 1))
    d = particle_difference((x, x + np.array([0, 0.3, 0.4])), (p, q), 0.9)
    assert d.distance_mean == pytest.approx(0.5) and d.angle_mean == pytest.approx(np.degrees(0.1))
    assert np.isnan(particle_difference((x, x[1:]), (p, q[1:]), 0.9).angle_mean)
