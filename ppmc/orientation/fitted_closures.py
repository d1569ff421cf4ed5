"""Closures that are no exact distribution's: simple blends and published fits, each a function of A alone.

Shapes (..., 3, 3) in, (..., 3, 3, 3, 3) out. `CLOSURES` names them all, the exact natural closure first.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ppmc.orientation.closures import Closure, natural, rotate_fourth

Array = NDArray[np.float64]

_I = np.eye(3)
_ISOTROPIC = (
    np.einsum("ij,kl->ijkl", _I, _I) + np.einsum("ik,jl->ijkl", _I, _I) + np.einsum("il,jk->ijkl", _I, _I)
) / 35.0  # fmt: skip


def linear(second: Array) -> Array:
    """Return the linear closure, exact for isotropic A (Hand 1962; Advani and Tucker, J. Rheol. 31 (1987) 751)."""
    return np.asarray(6.0 / 7.0 * symmetrise(np.einsum("...ij,kl->...ijkl", second, _I)) - _ISOTROPIC)


def quadratic(second: Array) -> Array:
    """Return A⊗A, exact for perfect alignment (Doi 1981); it lacks full symmetry."""
    return np.asarray(np.einsum("...ij,...kl->...ijkl", second, second))


def hybrid(second: Array) -> Array:
    """Return the blend of linear and quadratic by f = 1 − 27 det A (Advani and Tucker, J. Rheol. 34 (1990) 367)."""
    f = (1.0 - 27.0 * np.linalg.det(second))[..., None, None, None, None]
    return np.asarray((1.0 - f) * linear(second) + f * quadratic(second))


def ibof(second: Array) -> Array:
    """Return the invariant-based optimal fit (Chung and Kwon, J. Rheol. 46 (2002) 169, doi 10.1122/1.1423312)."""
    A = np.asarray(second, dtype=np.float64)
    square = A @ A
    II = 0.5 * (1.0 - np.trace(square, axis1=-2, axis2=-1))
    III = np.linalg.det(A)
    powers = np.stack([II**m * III**n for m, n in _IBOF_POWERS], axis=-1)
    b3, b4, b6 = (powers @ c for c in _IBOF)
    b1 = 0.6 * (
        -1 / 7
        + b3 * (1 / 7 + 4 / 7 * II + 8 / 3 * III) / 5
        - b4 * (1 / 5 - 8 / 15 * II - 14 / 15 * III)
        - b6 * (1 / 35 - 24 / 105 * III - 4 / 35 * II + 16 / 15 * II * III + 8 / 35 * II**2)
    )
    b2 = (6 / 7) * (
        1 - b3 * (1 + 4 * II) / 5 + 7 / 5 * b4 * (1 / 6 - II) - b6 * (-1 / 5 + 2 / 3 * III + 4 / 5 * II - 8 / 5 * II**2)
    )
    b5 = -4 / 5 * b3 - 7 / 5 * b4 - 6 / 5 * b6 * (1 - 4 / 3 * II)

    def dyad(s: Array, t: Array) -> Array:
        return np.asarray(np.einsum("...ij,...kl->...ijkl", s, t))

    unit = np.broadcast_to(_I, A.shape)
    terms = (dyad(unit, unit), dyad(unit, A), dyad(A, A), dyad(unit, square), dyad(A, square), dyad(square, square))
    total = sum(
        np.asarray(b)[..., None, None, None, None] * t for b, t in zip((b1, b2, b3, b4, b5, b6), terms, strict=True)
    )
    return symmetrise(np.asarray(total))


def orthotropic_fitted(second: Array) -> Array:
    """Return the orthotropic fitted closure ORF (Cintra and Tucker, J. Rheol. 39 (1995) 1095, doi 10.1122/1.550630)."""
    return _orthotropic(second, _ORF, ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 1)))


def verweyst(second: Array) -> Array:
    """Return the fourth-degree orthotropic fit to the natural closure that J uses (VerWeyst, thesis, Illinois 1998)."""
    return _orthotropic(second, _VERWEYST, _VERWEYST_POWERS)


def _orthotropic(second: Array, coefficients: Array, powers: tuple[tuple[int, int], ...]) -> Array:
    """Evaluate polynomials of the two larger eigenvalues for A1111, A2222, A3333; the rest follows from the trace."""
    a, axes = np.linalg.eigh(second)
    a, axes = a[..., ::-1], axes[..., ::-1]
    values = np.stack([a[..., 0] ** m * a[..., 1] ** n for m, n in powers], axis=-1)
    diagonal = values @ coefficients.T
    rest = a - diagonal
    principal = np.zeros((*a.shape, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        principal[..., i, i] = diagonal[..., i]
        principal[..., j, k] = principal[..., k, j] = 0.5 * (rest[..., j] + rest[..., k] - rest[..., i])
    return rotate_fourth(principal, axes)


def symmetrise(fourth: Array) -> Array:
    """Return the fully symmetric part of tensors (..., 3, 3, 3, 3)."""
    lead = tuple(range(fourth.ndim - 4))
    n = fourth.ndim - 4
    return np.asarray(sum(np.transpose(fourth, (*lead, *(n + k for k in p))) for p in permutations(range(4))) / 24.0)


_IBOF_POWERS = (
    (0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 1), (2, 1), (1, 2), (3, 0), (0, 3), (3, 1),
    (2, 2), (1, 3), (4, 0), (0, 4), (4, 1), (3, 2), (2, 3), (1, 4), (5, 0), (0, 5),
)  # fmt: skip
_IBOF = np.array(
    [
        [
            0.24940908165786e2, -0.435101153160329e3, 0.372389335663877e4, 0.703443657916476e4, 0.823995187366106e6,
            -0.133931929894245e6, 0.880683515327916e6, -0.991630690741981e7, -0.159392396237307e5, 0.800970026849796e7,
            -0.237010458689252e7, 0.379010599355267e8, -0.337010820273821e8, 0.322219416256417e5, -0.257258805870567e9,
            0.214419090344474e7, -0.449275591851490e8, -0.213133920223355e8, 0.157076702372204e10, -0.232153488525298e5,
            -0.395769398304473e10,
        ],
        [
            -0.497217790110754e0, 0.234980797511405e2, -0.391044251397838e3, 0.153965820593506e3, 0.152772950743819e6,
            -0.213755248785646e4, -0.400138947092812e4, -0.185949305922308e7, 0.296004865275814e4, 0.247717810054366e7,
            0.101013983339062e6, 0.732341494213578e7, -0.147919027644202e8, -0.104092072189767e5, -0.635149929624336e8,
            -0.247435106210237e6, -0.902980378929272e7, 0.724969796807399e7, 0.487093452892595e9, 0.138088690964946e5,
            -0.160162178614234e10,
        ],
        [
            0.234146291570999e2, -0.412048043372534e3, 0.319553200392089e4, 0.573259594331015e4, -0.485212803064813e5,
            -0.605006113515592e5, -0.477173740017567e5, 0.599066486689836e7, -0.110656935176569e5, -0.460543580680696e8,
            0.203042960322874e7, -0.556606156734835e8, 0.567424911007837e9, 0.128967058686204e5, -0.152752854956514e10,
            -0.499321746092534e7, 0.132124828143333e9, -0.162359994620983e10, 0.792526849882218e10, 0.466767581292985e4,
            -0.128050778279459e11,
        ],
    ]
)  # fmt: skip
_ORF = np.array(
    [
        [0.060964, 0.371243, 0.555301, -0.369160, 0.318266, 0.371218],
        [0.124711, -0.389402, 0.258844, 0.086169, 0.796080, 0.544992],
        [1.228982, -2.054116, 0.821548, -2.260574, 1.053907, 1.819756],
    ]
)
_VERWEYST_POWERS = (
    (0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2),
    (3, 0), (0, 3), (2, 2), (3, 1), (1, 3), (4, 0), (0, 4),
)  # fmt: skip
_VERWEYST = np.array(
    [
        [
            0.636256796880687, -1.872662963738140, -4.479708731937380, 11.958956233232000, 3.844596924200860,
            11.342092427815900, -10.958262606969100, -20.727799468413200, -2.116232144710040, -12.387563285561900,
            9.815983897167480, 3.479015105674390, 11.749291117702600, 0.508041387366637, 4.883665977714890,
        ],
        [
            0.636256796880687, -3.315272297421460, -3.037099398254060, 11.827328596885200, 6.881539520580440,
            8.436777467783250, -15.912066715764100, -15.151587260630700, -6.487289336419260, -8.638914192840160,
            9.325203434526610, 7.746837517132950, 7.481468706244410, 2.284765316379580, 3.597722511342540,
        ],
        [
            2.740532895602530, -9.121965097826920, -12.257058703625400, 34.319901891698700, 13.829469912194000,
            25.868475525388400, -37.702911802938400, -50.275643192748500, -10.880176113317400, -26.963691523971600,
            27.334679805448800, 15.265068614865100, 26.113491400537500, 3.432138403347790, 10.611741806606000,
        ],
    ]
)  # fmt: skip

CLOSURES: dict[str, Closure] = {
    "natural": natural,
    "linear": linear,
    "quadratic": quadratic,
    "hybrid": hybrid,
    "ibof": ibof,
    "orthotropic_fitted": orthotropic_fitted,
    "verweyst": verweyst,
}
