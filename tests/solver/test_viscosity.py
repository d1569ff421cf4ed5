"""Constitutive identities of the orientation-averaged viscosity (model.md 2.2), to 1e-12 at R up to 61,215."""

from fractions import Fraction

import numpy as np
import pytest

from ppmc.materials.planar_uniform import three_axes
from ppmc.materials.relations import (
    axial_viscosity,
    ratio_from_aspect,
    ratio_from_viscosities,
    shear_factor,
    transverse_viscosity,
)
from ppmc.solver.sph.viscosity import viscosity_tensor, viscous_stress

RATIOS = [1.0, 7.3, 116.0, 1000.0, 61215.0]
E1, E2, E3 = np.eye(3)
PLANAR = np.stack([np.cos(np.pi / 3 * np.arange(3)), np.sin(np.pi / 3 * np.arange(3)), np.zeros(3)], axis=1)


def stress(rate, ratio, directions, fractions=None):
    directions = np.atleast_2d(directions)
    k = len(directions)
    share = np.full(k, 1.0 / k) if fractions is None else np.asarray(fractions)
    fibre = 4.0 * (ratio - 1.0) * share
    return viscous_stress(np.asarray(rate, float)[None], np.ones(1), fibre[None], directions[None])[0]


def compliance_pseudo_inverse(ratio: float) -> np.ndarray:
    """Beaussart's incompressible compliance along e1 (eta12 = eta23 = 1), inverted on deviators (Kelvin notation).

    In fractions: at R = 61,215 its condition number alone takes five digits from an inverse in floating point.
    """
    eta11 = Fraction(axial_viscosity(ratio, 1.0))
    eta22 = 4 * eta11 / (eta11 + 1)
    along, across = 1 / eta11, 1 / eta22
    # Pressure does not strain; with a third of a one in every entry it strains by itself, which is taken off again.
    third = Fraction(1, 3)
    block = [
        [along + third, third - along / 2, third - along / 2],
        [third - along / 2, across + third, third + along / 2 - across],
        [third - along / 2, third + along / 2 - across, across + third],
    ]
    out = np.diag([0.0, 0.0, 0.0, 2.0, 2.0, 2.0])
    out[:3, :3] = [[float(value - third) for value in row] for row in inverse_of(block)]
    return out


def inverse_of(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Inverse of a 3 x 3 matrix by cofactors."""

    def cofactor(i: int, j: int) -> Fraction:
        (a, b), (c, d) = ([matrix[(i + k) % 3][(j + m) % 3] for m in (1, 2)] for k in (1, 2))
        return a * d - b * c

    determinant = sum(matrix[0][j] * cofactor(0, j) for j in range(3))
    return [[cofactor(j, i) / determinant for j in range(3)] for i in range(3)]


def kelvin(tensor: np.ndarray) -> np.ndarray:
    s = np.sqrt(0.5)
    basis = [np.outer(e, e) for e in np.eye(3)]
    basis += [s * (np.outer(a, b) + np.outer(b, a)) for a, b in ((E2, E3), (E1, E3), (E1, E2))]
    return np.array([[np.einsum("ij,ijkl,kl", a, tensor, b) for b in basis] for a in basis])


@pytest.mark.parametrize("ratio", RATIOS)
def test_equals_the_inverse_of_the_compliance(ratio):
    mine = kelvin(viscosity_tensor(1.0, ratio, E1[None], np.ones(1)))
    np.testing.assert_allclose(mine, compliance_pseudo_inverse(ratio), rtol=0, atol=1e-12 * ratio)
    eigenvalues = np.sort(np.linalg.eigvalsh(mine))
    np.testing.assert_allclose(eigenvalues, [0, 2, 2, 2, 2, 2 + 8 * (ratio - 1) / 3], rtol=0, atol=1e-12 * ratio)
    assert transverse_viscosity(ratio, 1.0) == pytest.approx(axial_viscosity(ratio, 1.0) / ratio, rel=1e-15)


@pytest.mark.parametrize("ratio", RATIOS)
def test_rank_one_form_equals_the_tensor(ratio):
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fractions = rng.dirichlet(np.ones(4))
    rate = rng.normal(size=(3, 3))
    tensor = viscosity_tensor(1.0, ratio, directions, fractions)
    expected = np.einsum("ijkl,kl->ij", tensor, rate)
    np.testing.assert_allclose(stress(rate, ratio, directions, fractions), expected, rtol=1e-12, atol=1e-12 * ratio)


@pytest.mark.parametrize("ratio", RATIOS)
def test_uniaxial_squeeze_and_shear_identities(ratio):
    def close(value: float, exact: float) -> None:
        assert value == pytest.approx(exact, rel=1e-12)

    t = stress(np.diag([1.0, -0.5, -0.5]), ratio, E1)
    close(t[0, 0] - t[1, 1], 4 * ratio - 1)  # eta11
    # Collimated along 1, squeezed along 3, sides free: D11 = 1/(2R).
    d = np.diag([0.5 / ratio, 1 - 0.5 / ratio, -1.0])
    t = stress(d, ratio, E1)
    assert t[0, 0] == pytest.approx(t[1, 1], abs=1e-12 * ratio)
    close(t[1, 1] - t[2, 2], 4 - 1 / ratio)
    # Planar random.
    t = stress(np.diag([0.5, 0.5, -1.0]), ratio, PLANAR)
    close(t[0, 0] - t[2, 2], ratio + 2)
    close(stress([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]], ratio, PLANAR)[0, 1], 0.5 * (ratio + 1))
    close(stress([[0, 0, 0.5], [0, 0, 0], [0.5, 0, 0]], ratio, PLANAR)[0, 2], 1.0)
    t = stress(np.diag([1.0, 0.0, -1.0]), ratio, PLANAR)
    close(t[0, 0] - t[2, 2], 1.5 * ratio + 2.5)
    # Isotropic in space: six axes of the icosahedron integrate fourth-order polynomials exactly.
    golden = (1 + np.sqrt(5)) / 2
    axes = np.array([[0, 1, golden], [0, 1, -golden], [1, golden, 0], [1, -golden, 0], [golden, 0, 1], [golden, 0, -1]])
    t = stress(np.diag([0.5, 0.5, -1.0]), ratio, axes / np.linalg.norm(axes, axis=1, keepdims=True))
    close(t[0, 0] - t[2, 2], 3 * (1 + 4 * (ratio - 1) / 15))


def test_the_papers_numbers():
    assert shear_factor(0.60) == pytest.approx(5.35862, abs=1e-5)
    assert shear_factor(0.50) == pytest.approx(3.88373, abs=1e-5)
    assert shear_factor(0.65) == pytest.approx(6.51880, abs=1e-5)
    assert axial_viscosity(61215.0, 1.0) == 244859.0
    assert ratio_from_viscosities(463.0, 1.0) == 116.0
    assert axial_viscosity(116.0, 2.0) / transverse_viscosity(116.0, 2.0) == pytest.approx(116.0, rel=1e-14)
    assert axial_viscosity(1.0, 5.0) == 15.0  # Trouton
    assert ratio_from_aspect(903.4, "pipes", 0.6) == pytest.approx(61215.0, rel=1e-3)
    assert ratio_from_aspect(43.0, "shear_lag") == pytest.approx(116.0, rel=3e-3)
    assert ratio_from_aspect(0.5, "pipes") == 1.0
    with pytest.raises(ValueError, match="rule"):
        ratio_from_aspect(10.0, "square")
    with pytest.raises(ValueError, match="fraction"):
        shear_factor(0.95)


def test_three_axes_reproduce_the_planar_tensors():
    # D4, D5: A = (I - nn)/2, fourth order by quadrature over the plane.
    normal = np.array([[0.36, 0.48, 0.8], [0.0, 0.0, 1.0]])
    for n, axes in zip(normal, three_axes(normal), strict=True):
        a2 = np.einsum("ki,kj->ij", axes, axes) / 3
        np.testing.assert_allclose(a2, 0.5 * (np.eye(3) - np.outer(n, n)), atol=1e-15)
        first = axes[0]
        second = np.cross(n, first)
        angles = 2 * np.pi * np.arange(64) / 64
        ring = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
        a4 = np.einsum("ki,kj,kl,km->ijlm", axes, axes, axes, axes) / 3
        np.testing.assert_allclose(a4, np.einsum("ki,kj,kl,km->ijlm", ring, ring, ring, ring) / 64, atol=1e-15)
