from __future__ import annotations

import numpy as np
import pytest

from ppmc.analysis.averages import moments
from ppmc.analysis.averages.averages import FOURTH, fourth_components, in_frames, region_averages, region_sums
from ppmc.analysis.averages.regions import Region, box, cylinder, everything, sphere
from ppmc.orientation import normalise, orientation_tensor, orientation_tensor4
from ppmc.particles import Particles, join


def cloud(n: int = 3000, seed: int = 1) -> Particles:
    rng = np.random.default_rng(seed)
    x = rng.uniform([0, 0, 0], [30, 12, 6], (n, 3))
    return Particles(
        "cloud", x, rng.uniform(0.1, 1, n), normalise(rng.normal(size=(n, 3))), normalise(rng.normal(size=(n, 3)))
    )


def rotation(seed: int = 3) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.linalg.det(q)


REGIONS = [
    everything(),
    box("box", [5, 2, 1], [20, 9, 5]),
    box("turned", [-4, -3, -2], [4, 3, 2], axes=rotation(), origin=[15, 6, 3]),
    box("slab", [-np.inf, -np.inf, 2.0], [np.inf, np.inf, 3.0]),
    cylinder("sector", [15, 6, 3], [0, 0, 1], 4, 6, 2, 0.3, 2.2),
    cylinder("past pi", [15, 6, 3], [0.2, 1, 0.1], 5, 5, 1, 2.8, 4.0),
    cylinder("full", [15, 6, 3], [1, 1, 0], 12, 3),
    sphere("ball", [10, 6, 3], 3),
]


@pytest.mark.parametrize("region", REGIONS, ids=lambda r: r.name)
def test_kernel_equals_numpy_twin(region: Region) -> None:
    s = cloud()
    a = region_averages(s, [region])
    m = region.contains(s.positions)
    assert a.particle_count[0] == m.sum() > 20
    assert a.material_volume[0] == pytest.approx(s.volume[m].sum(), rel=1e-12)
    assert np.allclose(a.centroid[0], np.average(s.positions[m], axis=0, weights=s.volume[m]), atol=1e-12)
    for v, second, fourth, spread in (
        (s.fibre_direction, a.fibre_tensor, a.fibre_tensor4, a.fibre_spread),
        (s.platelet_normal, a.normal_tensor, a.normal_tensor4, a.normal_spread),
    ):
        assert v is not None
        assert np.allclose(second[0], orientation_tensor(v[m], s.volume[m]), atol=1e-13)
        assert np.allclose(fourth[0], orientation_tensor4(v[m], s.volume[m]), atol=1e-13)
        dyads = v[m][:, :, None] * v[m][:, None, :]
        deviation = np.average((dyads - second[0]) ** 2, axis=0, weights=s.volume[m]) ** 0.5
        assert np.allclose(spread[0], deviation, atol=1e-7)


@pytest.mark.parametrize("region", REGIONS, ids=lambda r: r.name)
def test_enclosing_box_is_tight(region: Region) -> None:
    low, high = region.bounds()
    x = np.random.default_rng(0).uniform([-5, -5, -5], [35, 20, 12], (400_000, 3))
    inside = x[region.contains(x)]
    assert (inside >= low - 1e-9).all() and (inside <= high + 1e-9).all()
    bounded = np.isfinite(low) & np.isfinite(high)
    # Random points come near every face of a bounded region.
    assert (np.ptp(inside, axis=0)[bounded] > 0.8 * (high - low)[bounded]).all()


@pytest.mark.parametrize("region", [r for r in REGIONS if np.isfinite(r.volume)], ids=lambda r: r.name)
def test_geometric_volume(region: Region) -> None:
    low, high = region.bounds()
    x = np.random.default_rng(0).uniform(low, high, (200_000, 3))
    share = region.contains(x).mean() * np.prod(high - low)
    assert share == pytest.approx(region.volume, rel=0.03)


def test_contraction_of_fourth_order_is_second_order_and_traces_are_one() -> None:
    a = region_averages(cloud(), REGIONS)
    assert np.allclose(np.einsum("miikl->mkl", a.fibre_tensor4), a.fibre_tensor, atol=1e-13)
    assert np.allclose(np.trace(a.fibre_tensor, axis1=1, axis2=2), 1, atol=1e-13)
    assert np.allclose(np.trace(a.normal_tensor, axis1=1, axis2=2), 1, atol=1e-13)


def test_rotating_data_and_regions_rotates_every_tensor() -> None:
    s, R = cloud(), rotation(9)
    before = region_averages(s, REGIONS)
    after = region_averages(s.rotated(R), [r.rotated(R) for r in REGIONS])
    assert (before.particle_count == after.particle_count).all()
    turned = in_frames(before, np.broadcast_to(R, (len(REGIONS), 3, 3)))
    for name in ("fibre_tensor", "normal_tensor", "fibre_tensor4", "normal_tensor4"):
        assert np.abs(getattr(turned, name) - getattr(after, name)).max() < 1e-12


def test_empty_regions_are_nan_not_zero() -> None:
    far = box("far", [100, 0, 0], [101, 1, 1])
    a = region_averages(cloud(), [far, everything()])
    assert a.particle_count.tolist() == [0, 3000]
    assert (
        np.isnan(a.fibre_tensor[0]).all() and np.isnan(a.normal_tensor4[0]).all() and np.isnan(a.fibre_spread[0]).all()
    )
    nothing = Particles("none", np.empty((0, 3)), np.empty(0))
    assert np.isnan(region_averages(nothing, [everything()]).fibre_tensor).all()


def test_missing_normal_and_unknown_directions() -> None:
    s = cloud(100)
    p = np.array(s.fibre_direction)
    p[:10] = 0
    p[10:20] = np.nan
    a = region_averages(Particles("s", s.positions, s.volume, p), [everything()])
    assert np.isnan(a.normal_tensor).all()
    assert np.allclose(a.fibre_tensor[0], orientation_tensor(p[20:], s.volume[20:]))
    assert a.particle_count[0] == 100
    assert a.known_share[0] == pytest.approx(s.volume[20:].sum() / s.volume.sum())


def test_slices_count_every_point_once_even_on_shared_faces() -> None:
    x = np.linspace(0, 10, 101)
    s = Particles("row", np.column_stack([x, 0 * x, 0 * x]), np.ones(101), np.tile([1.0, 0, 0], (101, 1)))
    edges = np.linspace(-0.5, 10.5, 12)
    slices = [box(str(k), [edges[k], -1, -1], [edges[k + 1], 1, 1]) for k in range(11)]
    assert region_averages(s, slices).particle_count.sum() == 101


def test_flat_and_single_point_clouds() -> None:
    s = Particles("one", np.array([[1.0, 2, 3]]), np.ones(1), np.array([[0, 0, 1.0]]))
    a = region_averages(s, [everything(), sphere("ball", [1, 2, 3], 0.1)])
    assert a.particle_count.tolist() == [1, 1]
    assert a.fibre_tensor[0, 2, 2] == 1 and a.fibre_spread[0].max() == 0


def test_sums_of_parts_add_up() -> None:
    s = cloud()
    parts = [s.select(np.arange(k, 3000, 3)) for k in range(3)]
    total = region_sums(parts[0], REGIONS) + region_sums(parts[1], REGIONS) + region_sums(parts[2], REGIONS)
    assert np.allclose(total.sums, region_sums(s, REGIONS).sums, atol=1e-10)
    assert len(join(parts)) == 3000


def test_order_of_fourth_components() -> None:
    assert ["".join(str(i + 1) for i in c) for c in FOURTH[:4]] == ["1111", "1112", "1113", "1122"]
    a = region_averages(cloud(), [everything()])
    assert fourth_components(a.fibre_tensor4)[0, 3] == a.fibre_tensor4[0, 0, 0, 1, 1]


def test_same_bits_in_parallel(monkeypatch: pytest.MonkeyPatch) -> None:
    s = cloud(20_000)
    serial = region_sums(s, REGIONS * 3).sums
    monkeypatch.setattr(moments, "PARALLEL_FROM", 0)
    assert np.array_equal(region_sums(s, REGIONS * 3).sums, serial)


def test_every_platelet_counts_once() -> None:
    """Four platelets of 30, 30, 30, 10 points: (Σw)²/Σ(w of a platelet)² = 100²/(3·30² + 10²)."""
    ids = np.repeat([4, 7, 9, 2], [30, 30, 30, 10])
    p = np.repeat(np.eye(3)[[0, 1, 2, 0]], [30, 30, 30, 10], axis=0)
    s = Particles("s", np.random.default_rng(0).uniform(0, 1, (100, 3)), np.ones(100), p, None, ids)
    a = region_averages(s, [everything()])
    assert a.effective_platelets[0] == pytest.approx(1e4 / (3 * 900 + 100))
    assert a.fibre_error[0, 0, 0] == pytest.approx(a.fibre_spread[0, 0, 0] / np.sqrt(1e4 / 2800))
    loose = Particles("s", s.positions, s.volume, p, None, np.where(ids == 2, -1, ids))
    assert region_averages(loose, [everything()]).effective_platelets[0] == pytest.approx(1e4 / (2700 + 10))
    unknown = Particles("s", s.positions, s.volume, p)
    assert np.isnan(region_averages(unknown, [everything()]).effective_platelets[0])


def test_centre_of_a_slab_follows_the_material() -> None:
    slab = box("slab", [-np.inf, 1.0, -np.inf], [np.inf, 3.0, np.inf])
    assert slab.centre_near(np.array([7.0, 2.9, 4.0])).tolist() == [7.0, 2.0, 4.0]
    assert slab.centre.tolist() == [0.0, 2.0, 0.0]
    assert everything().centre_near(np.array([1.0, 2.0, 3.0])).tolist() == [1.0, 2.0, 3.0]
    sector = cylinder("s", [0, 0, 5], [0, 0, 1], 2, 4, 2, 0, np.pi, reference=[1, 0, 0])
    assert np.allclose(sector.centre, [0, 3, 5])
    assert sphere("b", [1, 2, 3], 2).centre.tolist() == [1, 2, 3]
