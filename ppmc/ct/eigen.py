"""Closed-form eigen-decomposition of many symmetric 3x3 tensors in float32, branch-free so that it vectorises.

Method: the normalised deviator has eigenvalues ``2 cos((acos h + 2 pi k) / 3)`` with ``h`` half its determinant. The
eigenvalue that stands apart from the other two (the largest for ``h >= 0``, else the smallest) gives its vector by the
largest column of an adjugate; the remaining two come from a 2x2 problem in the plane orthogonal to it, which stays
exact when they merge (Eberly, "A robust eigensolver for 3x3 symmetric matrices"). No trigonometry: ``cos(acos(h)/3)``
is smooth in ``sqrt(1 + h)`` and a polynomial of degree 8 has an error below 1e-8.

Tensors are solved ``CHUNK`` at a time, component by component, in three short loops: one long loop is a chain of
dependent operations that leaves the processor waiting, while several turns of a short one overlap (a third of the
time). Loops of fixed length have no remainder, and products and sums are contracted where
:func:`~ppmc.compile_cache.fma` says so and nowhere else, so a tensor's result does not depend on its place.

Never returns NaN and never a vector that is not of unit length: an isotropic (or zero) tensor gives a coordinate axis.
Component order of a tensor is XX, YY, ZZ, XY, YZ, XZ throughout.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import fma, njit
from ppmc.ct.passes import entry, inlined, kernel

F = np.float32
CHUNK = 64
"""Tensors solved together; a component of theirs is a stretch of so many floats, a row."""
R1, R2, R3, R4, R5, R6, R7, R8, R9, R10, R11 = (row * CHUNK for row in range(1, 12))
WORK = 12 * CHUNK
"""Floats that :func:`solve` works on."""
_ROOT = np.sqrt(1.0 + np.cos(np.linspace(0.0, np.pi, 400)))
_C = np.polynomial.chebyshev.Chebyshev.fit(_ROOT, np.cos(np.arccos(np.clip(_ROOT**2 - 1.0, -1.0, 1.0)) / 3.0), 8)
C0, C1, C2, C3, C4, C5, C6, C7, C8 = (
    F(c) for c in _C.convert(kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]).coef
)
ZERO, HALF, ONE, TWO, SIXTH, THIRD = F(0.0), F(0.5), F(1.0), F(2.0), F(1.0 / 6.0), F(1.0 / 3.0)
TINY = F(1e-30)
FLAT = F(1e-12)
"""Deviators with a squared norm below this share of the squared trace are treated as exactly isotropic."""


def scratch(*rows: int) -> tuple[NDArray[np.float32], ...]:
    """Return arrays of some rows each, for a kernel to work on; made outside, for that compiles in no time.

    They hold zeros, for a chunk is always worked on whole, whatever its last part holds.
    """
    return tuple(np.zeros(n * CHUNK, np.float32) for n in rows)


@njit(inline="always")
def _third_cosine(h):
    """Return ``cos(acos(h) / 3)`` for ``-1 <= h <= 1``."""
    t = np.sqrt(ONE + h)
    total = fma(t, fma(t, fma(t, fma(t, C8, C7), C6), C5), C4)
    return fma(t, fma(t, fma(t, fma(t, total, C3), C2), C1), C0)


@njit(inline="always")
def _deviator(xx, yy, zz, xy, yz, xz):
    """Return mean, scale and the six components of the deviator divided by the scale (zero if isotropic), and h."""
    mean = (xx + yy + zz) * THIRD
    a = xx - mean
    b = yy - mean
    c = zz - mean
    mixed = fma(xy, xy, fma(yz, yz, xz * xz))
    square = fma(TWO, mixed, fma(a, a, fma(b, b, c * c))) * SIXTH
    sound = square > fma(FLAT * mean, mean, TINY)
    root = np.sqrt(square)
    scale = root if sound else ZERO
    inverse = ONE / root if sound else ZERO
    a *= inverse
    b *= inverse
    c *= inverse
    d = xy * inverse
    e = yz * inverse
    f = xz * inverse
    bc = fma(b, c, -(e * e))
    dc = fma(d, c, -(e * f))
    de = fma(d, e, -(b * f))
    h = HALF * fma(a, bc, fma(f, de, -(d * dc)))
    return mean, scale, a, b, c, d, e, f, min(max(h, -ONE), ONE)


@inlined()
def _deviators(tensor, work):
    """Write normalised deviators (rows 0 to 5), the eigenvalue of each that stands apart, mean and scale."""
    for i in range(CHUNK):
        mean, scale, a, b, c, d, e, f, h = _deviator(
            tensor[i], tensor[R1 + i], tensor[R2 + i], tensor[R3 + i], tensor[R4 + i], tensor[R5 + i]
        )
        apart = TWO * _third_cosine(abs(h))
        work[i] = a
        work[R1 + i] = b
        work[R2 + i] = c
        work[R3 + i] = d
        work[R4 + i] = e
        work[R5 + i] = f
        work[R6 + i] = apart if h >= ZERO else -apart
        work[R7 + i] = mean
        work[R8 + i] = scale


@inlined()
def _vectors_apart(work):
    """Write the unit vector of the eigenvalue that stands apart into rows 9 to 11.

    The adjugate of (deviator - apart I) is that vector's dyad; its largest diagonal entry shows the largest column.
    """
    for i in range(CHUNK):
        d, e, f, apart = work[R3 + i], work[R4 + i], work[R5 + i], work[R6 + i]
        m0 = work[i] - apart
        m1 = work[R1 + i] - apart
        m2 = work[R2 + i] - apart
        xx = fma(m1, m2, -(e * e))
        yy = fma(m0, m2, -(f * f))
        zz = fma(m0, m1, -(d * d))
        xy = fma(e, f, -(d * m2))
        yz = fma(f, d, -(m0 * e))
        xz = fma(d, e, -(m1 * f))
        better = yy > zz
        x = xy if better else xz
        y = yy if better else yz
        z = yz if better else zz
        best = yy if better else zz
        better = xx > best
        x = xx if better else x
        y = xy if better else y
        z = xz if better else z
        norm = ONE / np.sqrt(fma(x, x, fma(y, y, z * z)))
        work[R9 + i] = x * norm
        work[R10 + i] = y * norm
        work[R11 + i] = z * norm


@inlined()
def _remaining(work, out):
    """Solve for the other two eigenvalues, and write l1, l2, l3 and the unit vectors of l1 and of l3."""
    for i in range(CHUNK):
        a, b, c, d, e, f = work[i], work[R1 + i], work[R2 + i], work[R3 + i], work[R4 + i], work[R5 + i]
        apart, mean, scale = work[R6 + i], work[R7 + i], work[R8 + i]
        ux, uy, uz = work[R9 + i], work[R10 + i], work[R11 + i]
        top = apart >= ZERO
        # an orthonormal pair (s, t) of the plane orthogonal to u (Duff et al., JCGT 6 (2017) 1)
        sign = ONE if uz >= ZERO else -ONE
        q = -ONE / (sign + uz)
        tx = ux * uy * q
        ty = fma(q * uy, uy, sign)
        tz = -uy
        sx = fma(sign * q * ux, ux, ONE)
        sy = sign * tx
        sz = -sign * ux
        bx = fma(a, sx, fma(d, sy, f * sz))
        by = fma(d, sx, fma(b, sy, e * sz))
        bz = fma(f, sx, fma(e, sy, c * sz))
        # the deviator has no trace: the mean of the two is minus half of the first
        mid = -HALF * apart
        half = fma(sx, bx, fma(sy, by, sz * bz)) - mid
        st = fma(tx, bx, fma(ty, by, tz * bz))
        gap = np.sqrt(fma(half, half, st * st))
        large = gap + abs(half)
        sound = large > TINY
        norm = ONE / np.sqrt(fma(large, large, st * st))
        large = large * norm if sound else ONE
        small = st * norm if sound else ZERO
        upper = half >= ZERO
        cosine = large if upper else small
        sine = small if upper else large
        # of the two only the end opposite to u is wanted
        along = -sine if top else cosine
        across = cosine if top else sine
        wx = fma(along, sx, across * tx)
        wy = fma(along, sy, across * ty)
        wz = fma(along, sz, across * tz)
        low = mid - gap
        high = mid + gap
        out[i] = fma(scale, low if top else apart, mean)
        out[R1 + i] = fma(scale, high if top else low, mean)
        out[R2 + i] = fma(scale, apart if top else high, mean)
        out[R3 + i] = wx if top else ux
        out[R4 + i] = wy if top else uy
        out[R5 + i] = wz if top else uz
        out[R6 + i] = ux if top else wx
        out[R7 + i] = uy if top else wy
        out[R8 + i] = uz if top else wz


@kernel()
def solve(tensor, work, out):
    """Solve a chunk of tensors: 6 rows -> 9 rows: l1 <= l2 <= l3, the unit vector p of l1 and r of l3."""
    _deviators(tensor, work)
    _vectors_apart(work)
    _remaining(work, out)


@entry()
def _solve_all(tensors, out):
    work = np.empty(WORK, np.float32)
    for n in range(tensors.shape[0]):
        solve(tensors[n], work, out[n])


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
    flat = tensors.reshape(-1, 6)
    padded = np.zeros((-(-len(flat) // CHUNK) * CHUNK, 6), np.float32)
    padded[: len(flat)] = flat
    chunks = np.ascontiguousarray(padded.reshape(-1, CHUNK, 6).transpose(0, 2, 1)).reshape(-1, 6 * CHUNK)
    out = np.empty((len(chunks), 9 * CHUNK), np.float32)
    _solve_all(chunks, out)
    columns = out.reshape(-1, 9, CHUNK).transpose(0, 2, 1).reshape(-1, 9)[: len(flat)]
    return columns[:, :3].reshape(*shape, 3), columns[:, 3:6].reshape(*shape, 3), columns[:, 6:].reshape(*shape, 3)
