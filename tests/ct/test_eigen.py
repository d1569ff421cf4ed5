import numpy as np
import pytest

from ppmc.ct.eigen import eigen_systems
from ppmc.orientation import angle_between_axes


def six(T):
    return np.stack([T[..., 0, 0], T[..., 1, 1], T[..., 2, 2], T[..., 0, 1], T[..., 1, 2], T[..., 0, 2]], axis=-1)


def random_tensors(n, eigenvalues):
    Q, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((n, 3, 3)))
    return np.einsum("nij,j,nkj->nik", Q, eigenvalues, Q), Q


@pytest.mark.parametrize(
    "eigenvalues", [(1, 2, 3), (0, 1, 1), (1, 1, 2), (0, 0, 1), (1e-4, 0.5, 1), (1, 1.001, 1.002), (0, 1e-3, 1)]
)
def test_agrees_with_lapack_also_where_eigenvalues_merge(eigenvalues):
    T, Q = random_tensors(3000, np.array(eigenvalues, float))
    values, p, r = eigen_systems(six(T).astype(np.float32))
    assert np.max(np.abs(values - eigenvalues)) < 3e-6 * eigenvalues[2]
    scale = eigenvalues[2] / np.diff(eigenvalues).clip(1e-9)
    if scale[0] < 1e4:
        assert angle_between_axes(p, Q[:, :, 0]).max() < 1e-4 * scale[0]
    if scale[1] < 1e4:
        assert angle_between_axes(r, Q[:, :, 2]).max() < 1e-4 * scale[1]


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_unit_and_orthogonal_at_every_scale(scale):
    T, _ = random_tensors(1000, np.array([0.1, 0.4, 1.0]))
    values, p, r = eigen_systems((scale * six(T)).astype(np.float32))
    assert np.max(np.abs(np.linalg.norm(p, axis=1) - 1)) < 1e-6
    assert np.max(np.abs(np.linalg.norm(r, axis=1) - 1)) < 1e-6
    assert np.max(np.abs(np.sum(p * r, axis=1))) < 1e-6
    assert np.allclose(values / scale, [0.1, 0.4, 1.0], rtol=1e-5)


@pytest.mark.parametrize(
    "tensor",
    [np.zeros(6), np.eye(6)[0], np.eye(6)[1], np.eye(6)[2], [1, 1, 0, 0, 0, 0], [1, 1, 1, 0, 0, 0], [1] * 6,
     [0, 1, 1, 0, 1, 0], [1e-30] * 6, [2, 2, 2, 1e-7, 0, 0]],
)  # fmt: skip
def test_never_nan_never_short(tensor):
    values, p, r = eigen_systems(np.array([tensor], np.float32))
    assert np.isfinite(values).all()
    assert np.linalg.norm(p) == pytest.approx(1.0, abs=1e-6)
    assert np.linalg.norm(r) == pytest.approx(1.0, abs=1e-6)
    assert abs(np.sum(p * r)) < 1e-6
