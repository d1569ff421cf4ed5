"""Closed-form eigen-decomposition of many symmetric 3x3 tensors in float32, branch-free so that it vectorises.

Method: the normalised deviator has eigenvalues ``2 cos((acos h + 2 pi k) / 3)`` with ``h`` half its determinant. The
eigenvalue that stands apart from the other two (the largest for ``h >= 0``, else the smallest) gives its vector by the
largest of three cross products; the remaining two come from a 2x2 problem in the plane orthogonal to it, which stays
exact when they merge (Eberly, "A robust eigensolver for 3x3 symmetric matrices"). No trigonometry: ``cos(acos(h)/3)``
is smooth in ``sqrt(1 + h)`` and a polynomial of degree 8 has an error below 1e-8.

No contraction of products and sums (fastmath) here: which product is contracted may differ between a loop's body and
its remainder, and results would then depend on how a volume is cut into rows.

Never returns NaN and never a vector that is not of unit length: an isotropic (or zero) tensor gives a coordinate axis.
Component order of a tensor is XX, YY, ZZ, XY, YZ, XZ throughout.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit

F = np.float32
U = np.uint64
_ROOT = np.sqrt(1.0 + np.cos(np.linspace(0.0, np.pi, 400)))
_C = np.polynomial.chebyshev.Chebyshev.fit(_ROOT, np.cos(np.arccos(np.clip(_ROOT**2 - 1.0, -1.0, 1.0)) / 3.0), 8)
C0, C1, C2, C3, C4, C5, C6, C7, C8 = (
    F(c) for c in _C.convert(kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]).coef
)
ZERO, HALF, ONE, TWO, SIXTH, THIRD = F(0.0), F(0.5), F(1.0), F(2.0), F(1.0 / 6.0), F(1.0 / 3.0)
TINY = F(1e-30)
FLAT = F(1e-12)
"""Deviators with a squared norm below this share of the squared trace are treated as exactly isotropic."""


@njit(inline="always")
def _third_cosine(h):
    """Return ``cos(acos(h) / 3)`` for ``-1 <= h <= 1``."""
    t = np.sqrt(ONE + h)
    return C0 + t * (C1 + t * (C2 + t * (C3 + t * (C4 + t * (C5 + t * (C6 + t * (C7 + t * C8)))))))


@njit(inline="always")
def _deviator(xx, yy, zz, xy, yz, xz):
    """Return mean, scale and the six components of the deviator divided by the scale (zero if isotropic), and h."""
    mean = (xx + yy + zz) * THIRD
    a = xx - mean
    b = yy - mean
    c = zz - mean
    square = (a * a + b * b + c * c + TWO * (xy * xy + yz * yz + xz * xz)) * SIXTH
    sound = square > FLAT * mean * mean + TINY
    scale = np.sqrt(square) if sound else ZERO
    inverse = ONE / np.sqrt(square) if sound else ZERO
    a *= inverse
    b *= inverse
    c *= inverse
    d = xy * inverse
    e = yz * inverse
    f = xz * inverse
    h = HALF * (a * (b * c - e * e) - d * (d * c - e * f) + f * (d * e - b * f))
    h = min(max(h, -ONE), ONE)
    return mean, scale, a, b, c, d, e, f, h


@njit(inline="always")
def smallest_eigenvalue(xx, yy, zz, xy, yz, xz):
    """Return the smallest eigenvalue alone (a quarter of the work of the whole solve)."""
    mean, scale, _a, _b, _c, _d, _e, _f, h = _deviator(xx, yy, zz, xy, yz, xz)
    return mean - TWO * scale * _third_cosine(-h)


@njit(inline="always")
def eigen_system(xx, yy, zz, xy, yz, xz):
    """Return eigenvalues l1 <= l2 <= l3, the unit vector of l1 and the unit vector of l3, as nine scalars."""
    mean, scale, a, b, c, d, e, f, h = _deviator(xx, yy, zz, xy, yz, xz)
    top = h >= ZERO
    apart = TWO * _third_cosine(h) if top else -TWO * _third_cosine(-h)
    # rows of (deviator - apart I) span the plane orthogonal to the wanted vector
    m0 = a - apart
    m1 = b - apart
    m2 = c - apart
    ux = d * e - f * m1
    uy = f * d - m0 * e
    uz = m0 * m1 - d * d
    vx = d * m2 - f * e
    vy = f * f - m0 * m2
    vz = m0 * e - d * f
    wx = m1 * m2 - e * e
    wy = e * f - d * m2
    wz = d * e - m1 * f
    uu = ux * ux + uy * uy + uz * uz
    vv = vx * vx + vy * vy + vz * vz
    ww = wx * wx + wy * wy + wz * wz
    better = vv > uu
    ux = vx if better else ux
    uy = vy if better else uy
    uz = vz if better else uz
    uu = vv if better else uu
    better = ww > uu
    ux = wx if better else ux
    uy = wy if better else uy
    uz = wz if better else uz
    uu = ww if better else uu
    norm = ONE / np.sqrt(uu)
    ux *= norm
    uy *= norm
    uz *= norm
    # an orthonormal pair (s, t) of the plane orthogonal to u
    wide = abs(ux) > abs(uy)
    sx = -uz if wide else ZERO
    sy = ZERO if wide else uz
    sz = ux if wide else -uy
    norm = ONE / np.sqrt(sx * sx + sy * sy + sz * sz)
    sx *= norm
    sy *= norm
    sz *= norm
    tx = uy * sz - uz * sy
    ty = uz * sx - ux * sz
    tz = ux * sy - uy * sx
    bsx = a * sx + d * sy + f * sz
    bsy = d * sx + b * sy + e * sz
    bsz = f * sx + e * sy + c * sz
    btx = a * tx + d * ty + f * tz
    bty = d * tx + b * ty + e * tz
    btz = f * tx + e * ty + c * tz
    ss = sx * bsx + sy * bsy + sz * bsz
    st = sx * btx + sy * bty + sz * btz
    tt = tx * btx + ty * bty + tz * btz
    half = HALF * (ss - tt)
    mid = HALF * (ss + tt)
    gap = np.sqrt(half * half + st * st)
    upper = half >= ZERO
    cc = half + gap if upper else st
    sn = st if upper else gap - half
    size = cc * cc + sn * sn
    sound = size > TINY
    cc = cc if sound else ONE
    sn = sn if sound else ZERO
    norm = ONE / np.sqrt(size) if sound else ONE
    cc *= norm
    sn *= norm
    hx = cc * sx + sn * tx
    hy = cc * sy + sn * ty
    hz = cc * sz + sn * tz
    lx = cc * tx - sn * sx
    ly = cc * ty - sn * sy
    lz = cc * tz - sn * sz
    e1 = mid - gap if top else apart
    e2 = mid + gap if top else mid - gap
    e3 = apart if top else mid + gap
    px = lx if top else ux
    py = ly if top else uy
    pz = lz if top else uz
    rx = ux if top else hx
    ry = uy if top else hy
    rz = uz if top else hz
    return mean + scale * e1, mean + scale * e2, mean + scale * e3, px, py, pz, rx, ry, rz


@njit(nogil=True)
def solve_row(tensor, out):
    """Solve a row of n tensors: ``tensor`` (6 n) float32, component by component -> ``out`` (9 n): l1, l2, l3, p, r."""
    n = U(tensor.shape[0] // 6)
    for i in range(n):
        r = eigen_system(
            tensor[i],
            tensor[n + i],
            tensor[U(2) * n + i],
            tensor[U(3) * n + i],
            tensor[U(4) * n + i],
            tensor[U(5) * n + i],
        )
        out[i] = r[0]
        out[n + i] = r[1]
        out[U(2) * n + i] = r[2]
        out[U(3) * n + i] = r[3]
        out[U(4) * n + i] = r[4]
        out[U(5) * n + i] = r[5]
        out[U(6) * n + i] = r[6]
        out[U(7) * n + i] = r[7]
        out[U(8) * n + i] = r[8]


@njit(nogil=True)
def smallest_row(tensor, out):
    """Write the smallest eigenvalue of a row of n tensors (6 n) into ``out`` (n,)."""
    n = U(out.shape[0])
    for i in range(n):
        out[i] = smallest_eigenvalue(
            tensor[i],
            tensor[n + i],
            tensor[U(2) * n + i],
            tensor[U(3) * n + i],
            tensor[U(4) * n + i],
            tensor[U(5) * n + i],
        )


def eigen_systems(tensors: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Solve an array of tensors.

    Parameters
    ----------
    tensors : ndarray, shape (..., 6)
        Components XX, YY, ZZ, XY, YZ, XZ.

    Returns
    -------
    eigenvalues : ndarray, shape (..., 3)
        Ascending.
    smallest : ndarray, shape (..., 3)
        Unit vector (x, y, z) of the smallest eigenvalue, sign arbitrary.
    largest : ndarray, shape (..., 3)
        Unit vector of the largest eigenvalue.
    """
    shape = tensors.shape[:-1]
    rows = np.ascontiguousarray(tensors.reshape(-1, 6).T, dtype=np.float32)
    out = np.empty(9 * rows.shape[1], np.float32)
    solve_row(rows.ravel(), out)
    columns = np.ascontiguousarray(out.reshape(9, -1).T)
    return columns[:, :3].reshape(*shape, 3), columns[:, 3:6].reshape(*shape, 3), columns[:, 6:].reshape(*shape, 3)
