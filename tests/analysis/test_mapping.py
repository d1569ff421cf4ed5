from __future__ import annotations

import numpy as np
import pytest

from ppmc.analysis.averages.averages import region_averages
from ppmc.analysis.averages.regions import box
from ppmc.analysis.mesh.mapping import map_to_elements
from ppmc.analysis.mesh.stiffness import Lamina, averaged_stiffness, engineering_moduli, stiffness_matrix
from ppmc.errors import InputFileError
from ppmc.orientation import normalise, orientation_tensor, orientation_tensor4
from ppmc.particles import Particles

RNG = np.random.default_rng(6)
LAMINA = Lamina(140e9, 9e9, 0.3, 0.4, 5e9)


def cloud(n: int = 4000) -> Particles:
    x = RNG.uniform(0, [10, 6, 3], (n, 3))
    p = normalise(RNG.normal(size=(n, 3)))
    r = normalise(np.cross(p, RNG.normal(size=(n, 3))))
    return Particles("s", x, RNG.uniform(0.5, 1.5, n), p, r)


def centres() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(0.5, 10), np.arange(0.5, 6), np.arange(0.5, 3), indexing="ij"), -1).reshape(
        -1, 3
    )


def test_nearest_takes_the_nearest_in_any_number_of_parts() -> None:
    s, c = cloud(), centres()
    mapped = map_to_elements(c, [s.select(np.arange(k, 4000, 3)) for k in range(3)])
    nearest = np.argmin(((c[:, None] - s.positions[None]) ** 2).sum(-1), axis=1)
    assert s.fibre_direction is not None
    assert np.array_equal(mapped.fibre_direction, s.fibre_direction[nearest])
    assert np.allclose(mapped.distance, np.linalg.norm(c - s.positions[nearest], axis=1))
    axes = np.stack([mapped.fibre_direction, mapped.in_plane_direction, mapped.platelet_normal], 1)
    assert np.abs(np.einsum("mij,mkj->mik", axes, axes) - np.eye(3)).max() < 1e-12
    assert np.allclose(np.linalg.det(axes), 1)


def unit_cells(x: np.ndarray) -> np.ndarray:
    """Return the cell of `centres` that each place lies in."""
    i, j, k = np.floor(x).astype(int).T
    return np.asarray((i * 6 + j) * 3 + k)


def test_average_conserves_volume_and_the_whole_tensor() -> None:
    s, c = cloud(), centres()
    mapped = map_to_elements(c, [s.select(np.arange(k, 4000, 2)) for k in range(2)], unit_cells)
    assert mapped.material_volume.sum() == pytest.approx(s.volume.sum(), rel=1e-12)
    assert mapped.particle_count.sum() == len(s)
    whole = np.einsum("m,mij->ij", mapped.material_volume, mapped.fibre_tensor) / mapped.material_volume.sum()
    assert np.allclose(whole, orientation_tensor(s.fibre_direction, s.volume), atol=1e-12)
    assert np.allclose(np.trace(mapped.normal_tensor, axis1=1, axis2=2), 1)
    assert np.allclose(np.einsum("mijkk->mij", mapped.fibre_tensor4), mapped.fibre_tensor, atol=1e-12)
    whole4 = np.einsum("m,mijkl->ijkl", mapped.material_volume, mapped.fibre_tensor4) / mapped.material_volume.sum()
    assert np.allclose(whole4, orientation_tensor4(s.fibre_direction, s.volume), atol=1e-12)


def test_elements_average_as_boxes_do() -> None:
    """The same cell as a box region: count, volume, tensors of both orders, spread."""
    s, c = cloud(), centres()
    mapped = map_to_elements(c, [s], unit_cells)
    at = 40
    a = region_averages(s, [box("cell", c[at] - 0.5, c[at] + 0.5)])
    assert mapped.particle_count[at] == a.particle_count[0] > 5
    assert mapped.material_volume[at] == pytest.approx(a.material_volume[0])
    for name in ("fibre_tensor", "normal_tensor", "fibre_tensor4", "normal_tensor4", "fibre_spread", "normal_spread"):
        assert np.allclose(getattr(mapped, name)[at], getattr(a, name)[0], atol=1e-12)


def test_elements_without_material_stay_empty_unless_asked() -> None:
    s = cloud(50)
    far = np.array([[100.0, 0, 0], [5, 3, 1.5]])
    for owners in (None, lambda x: np.ones(len(x), dtype=np.int64)):
        mapped = map_to_elements(far, [s], owners, within=5.0)
        assert mapped.particle_count[0] == 0 and mapped.distance[0] > 80 and mapped.material_volume[0] == 0
        for values in (mapped.fibre_direction, mapped.platelet_normal, mapped.fibre_tensor, mapped.fibre_tensor4):
            assert np.isnan(values[0]).all() and np.isfinite(values[1]).all()
        filled = map_to_elements(far, [s], owners, within=5.0, fill=True)
        assert filled.particle_count[0] == 0 and np.isfinite(filled.fibre_direction).all()
        assert np.isfinite(filled.fibre_tensor).all() and filled.material_volume[0] == 0


def test_the_first_of_equally_near_points_counts_whatever_the_last_digits() -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    s = Particles("s", x, np.ones(3), np.eye(3), np.eye(3)[[1, 2, 0]])
    for shift in (-1e-9, 0.0, 1e-9):
        mapped = map_to_elements(np.array([[0.5 + shift, 0, 0], [1.5 - shift, 0, 0]]), [s])
        assert np.array_equal(mapped.fibre_direction, np.eye(3)[:2])


def test_missing_normals_stay_unknown() -> None:
    s = cloud(100)
    bare = Particles("s", s.positions, s.volume, s.fibre_direction)
    for owners in (None, unit_cells):
        mapped = map_to_elements(centres(), [bare], owners)
        own = mapped.particle_count > 0
        assert np.isnan(mapped.platelet_normal).all() and np.isfinite(mapped.fibre_tensor[own]).all()


def test_nothing_to_map_is_an_error() -> None:
    with pytest.raises(InputFileError):
        map_to_elements(centres(), [])


def test_averaged_stiffness_is_the_average_of_turned_stiffnesses() -> None:
    p = normalise(RNG.normal(size=(400, 3)))
    A, A4 = orientation_tensor(p), orientation_tensor4(p)
    C1 = averaged_stiffness(np.diag([1.0, 0, 0]), np.einsum("i,j,k,l->ijkl", *([np.array([1.0, 0, 0])] * 4)), LAMINA)
    assert np.allclose(stiffness_matrix(C1), LAMINA.stiffness(), rtol=1e-12)
    total = np.zeros((3, 3, 3, 3))
    for v in p:
        u = normalise(np.cross(v, [0.3, 0.5, 0.8]))
        R = np.stack([v, u, np.cross(v, u)], axis=1)
        total += np.einsum("ia,jb,kc,ld,abcd->ijkl", R, R, R, R, C1, optimize=True) / len(p)
    assert np.abs(averaged_stiffness(A, A4, LAMINA) - total).max() < 1e-9 * np.abs(total).max()


def test_moduli_of_the_aligned_lamina_are_its_constants() -> None:
    moduli = engineering_moduli(LAMINA.stiffness())
    assert np.allclose(moduli, [140e9, 9e9, 9e9, 5e9, 9e9 / 2.8, 5e9])
    with pytest.raises(ValueError, match="stable"):
        Lamina(1e9, 1e9, 0.3, 1.2, 1e9).stiffness()
