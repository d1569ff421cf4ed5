from __future__ import annotations

import numpy as np
import pytest

from ppmc.analysis.flow.occupancy import Cells, cells_around, fill_shares, occupancy, overlap, silhouette
from ppmc.particles import Particles
from tests.analysis.test_fill_knit_ensemble import lattice

SHEARED = np.array([[1.4, 0.5, 0.0], [0.0, 1.0, 0.3], [0.0, 0.0, 1 / 1.4]])


def block(F: np.ndarray, size: tuple[float, ...] = (20, 10, 4), h: float = 0.5) -> Particles:
    x = lattice((0, 0, 0), size, h)
    n = len(x)
    gradient = np.broadcast_to(F, (n, 3, 3)).reshape(n, 9)
    return Particles("s", x @ F.T, np.full(n, h**3), fields={"deformation_gradient": gradient})


@pytest.mark.parametrize("F", [np.eye(3), SHEARED, np.diag([2.5, 0.8, 0.5])], ids=["start", "sheared", "squeezed"])
def test_shares_hold_the_volume_exactly_and_filled_cells_closely(F: np.ndarray) -> None:
    s = block(F)
    cells = cells_around([s.positions], 2.0, 0.25)
    volume = 800 * np.linalg.det(F)
    assert fill_shares([s], cells).sum() * cells.size**3 == pytest.approx(volume, rel=1e-12)
    assert occupancy([s], cells).sum() * cells.size**3 == pytest.approx(volume, rel=0.02)


def test_a_turned_scan_fills_the_turned_box() -> None:
    angle = np.radians(30)
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    # Voxels of 1 x 1 x 2 mm.
    x = lattice((0, 0, 0), (12, 8, 2), 1.0)
    x = x[x[:, 2] < 1] * [1, 1, 2]
    x = np.vstack([x, x + np.array([0, 0, 2])])
    s = Particles("scan", x @ R.T, np.full(len(x), 2.0))
    cells = cells_around([s.positions], 2.0, 0.25)
    filled = occupancy([s], cells, np.diag([1, 1, 2]) / np.cbrt(2) @ R.T)
    assert filled.sum() * cells.size**3 == pytest.approx(384, rel=0.02)
    assert silhouette(filled, 2).sum() * cells.size**2 == pytest.approx(96, rel=0.02)


def test_overlap_of_shifted_blocks_is_that_of_their_volumes() -> None:
    a = block(np.eye(3))
    b = Particles("b", a.positions + np.array([4.0, 0, 0]), a.volume)
    cells = Cells(np.array([-1.0, -1, -1]), 0.5, (60, 24, 12))
    first, second = occupancy([a], cells), occupancy([b], cells)
    assert overlap(first, second) == pytest.approx(16 / 24)
    for axis, expected in ((0, 1.0), (1, 16 / 24), (2, 16 / 24)):
        assert overlap(silhouette(first, axis), silhouette(second, axis)) == pytest.approx(expected)
    assert overlap(first, first) == 1
    empty = np.zeros((2, 2, 2))
    assert np.isnan(overlap(empty, empty))


def test_cracks_between_particles_are_no_holes() -> None:
    s = block(np.eye(3))
    rng = np.random.default_rng(4)
    loose = Particles("s", s.positions + rng.uniform(-0.12, 0.12, s.positions.shape), s.volume)
    cells = Cells(np.array([-1.0, -1, -1]), 0.25, (88, 48, 24))
    core = (slice(8, 80), slice(8, 40), slice(8, 16))
    assert np.minimum(fill_shares([loose], cells)[core], 1).mean() < 0.95
    assert occupancy([loose], cells)[core].mean() > 0.98
