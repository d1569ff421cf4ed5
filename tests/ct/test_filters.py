import numpy as np
import pytest

from ppmc.ct.filters import cell_box, derivative, gaussian
from ppmc.ct.normals import cell_axis


@pytest.mark.parametrize("sigma", [0.5, 0.7, 1.0, 2.0, 3.7])
def test_gaussian_keeps_constants_and_derivative_is_exact_on_a_ramp(sigma):
    g, d = gaussian(sigma), derivative(sigma)
    i = np.arange(len(d)) - len(d) // 2
    assert g.sum() == pytest.approx(1.0, abs=1e-6)
    assert d.sum() == pytest.approx(0.0, abs=1e-6)
    assert d @ i == pytest.approx(1.0, abs=1e-6)
    assert np.array_equal(g, g[::-1])
    assert np.array_equal(d, -d[::-1])


def test_window_of_no_width_is_the_voxel_itself():
    assert np.array_equal(gaussian(0.0), [1.0])


@pytest.mark.parametrize(("sigma", "worst"), [(1.0, 6e-3), (1.5, 2e-3), (0.7, 0.02), (0.5, 0.12)])
def test_derivative_matches_its_smoothing(sigma, worst):
    """The pair's frequency responses must differ by exactly the frequency, or directions are biased."""
    g, d = gaussian(sigma), derivative(sigma)
    i = np.arange(len(d)) - len(d) // 2
    w = np.linspace(0.2, 0.6 * np.pi, 50)
    smooth = np.cos(np.outer(w, i)) @ g
    slope = np.sin(np.outer(w, i)) @ d
    assert np.max(np.abs(slope / (w * smooth) - 1.0)) < worst


@pytest.mark.parametrize("cell", [1, 3, 5, 7])
def test_cells_count_every_voxel_once_and_lie_evenly(cell):
    for n in range(8, 40):
        start, count = cell_axis(n, cell)
        assert 2 * start + (count - 1) * cell == n - 1
        total = np.zeros(n + 4 * cell)
        for c in range(count):
            centre = start + c * cell + 2 * cell
            total[centre - cell // 2 : centre + cell // 2 + 1] += cell_box(cell) * cell
        assert np.allclose(total[2 * cell : 2 * cell + n], 1.0)
