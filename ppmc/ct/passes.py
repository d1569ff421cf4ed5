"""Symmetric and antisymmetric filters on flat float32 arrays, several taps in each sweep.

Results are weighted sums of stretches that begin at ``base + offsets[t]``: neighbouring planes, rows or voxels. The
taps at either side of the middle share a product. A sweep takes four or six pairs of taps, for the time goes into
loads and stores of what earlier sweeps left; pairs that a filter does not have count with weight zero.

Offsets are unsigned: numba then needs no test for negative indices, and the loops vectorise. Products and sums are
contracted where :func:`~ppmc.compile_cache.fma` says so: left to itself the compiler may do it in a loop's body and not
in its remainder, and results would depend on how a volume is cut.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import fma, njit

U = np.uint64
entry = partial(njit, nogil=True, no_cfunc_wrapper=True)
"""Decorator of kernels that Python calls; nothing needs them as C functions."""
kernel = partial(entry, no_cpython_wrapper=True)
"""Decorator of kernels that only kernels call: without the wrapper for Python they compile sooner."""
inlined = partial(kernel, forceinline=True)
"""Decorator of sweeps: handing over their many arguments would take a fifth of their time."""
ZERO = np.float32(0.0)


@kernel()
def scale(src, a, c, out, o, n):
    """Write ``c * src[a:]`` into ``out[o : o + n]``."""
    for i in range(n):
        out[o + i] = c * src[a + i]


@inlined()
def _set_four(src, a, c, a0, b0, c0, a1, b1, c1, a2, b2, c2, a3, b3, c3, out, o, n):
    for i in range(n):
        total = fma(c0, src[a0 + i] + src[b0 + i], c * src[a + i])
        total = fma(c1, src[a1 + i] + src[b1 + i], total)
        total = fma(c2, src[a2 + i] + src[b2 + i], total)
        out[o + i] = fma(c3, src[a3 + i] + src[b3 + i], total)


@inlined()
def _set_six(src, a, c, a0, b0, c0, a1, b1, c1, a2, b2, c2, a3, b3, c3, a4, b4, c4, a5, b5, c5, out, o, n):
    for i in range(n):
        total = fma(c0, src[a0 + i] + src[b0 + i], c * src[a + i])
        total = fma(c1, src[a1 + i] + src[b1 + i], total)
        total = fma(c2, src[a2 + i] + src[b2 + i], total)
        total = fma(c3, src[a3 + i] + src[b3 + i], total)
        total = fma(c4, src[a4 + i] + src[b4 + i], total)
        out[o + i] = fma(c5, src[a5 + i] + src[b5 + i], total)


@inlined()
def _add_four(src, a0, b0, c0, a1, b1, c1, a2, b2, c2, a3, b3, c3, out, o, n):
    for i in range(n):
        total = fma(c0, src[a0 + i] + src[b0 + i], out[o + i])
        total = fma(c1, src[a1 + i] + src[b1 + i], total)
        total = fma(c2, src[a2 + i] + src[b2 + i], total)
        out[o + i] = fma(c3, src[a3 + i] + src[b3 + i], total)


def pairs_of(radius: int) -> int:
    """Return the number of pairs of taps, rounded up to what sweeps of four and at most one of six take."""
    return max(4, radius + radius % 2)


def weights(taps: NDArray[np.float32], pairs: int) -> NDArray[np.float32]:
    """Return the middle tap and those to its right, zeros behind."""
    out = np.zeros(pairs + 1, np.float32)
    half = taps[len(taps) // 2 :]
    out[: len(half)] = half
    return out


def stretches(radius: int, pairs: int, step: int) -> NDArray[np.uint64]:
    """Return where stretches ``step`` apart begin, as filters want them: the middle, then right and left by turns.

    Pairs beyond the radius are the middle again; their weight is zero.
    """
    away = np.arange(pairs + 1, dtype=np.int64)
    away[radius + 1 :] = 0
    turns = np.stack([radius + away, radius - away], axis=1).ravel()[1:]
    return (turns * step).astype(np.uint64)


@kernel()
def even(src, base, at, w, out, o, n):
    """Correlate with symmetric taps: stretches at ``base + at`` of ``src`` into ``out[o : o + n]``.

    ``at`` and the weights ``w`` are made by :func:`stretches` and :func:`weights`.
    """
    pairs = w.shape[0] - 1
    t = 4
    if pairs % 4 == 0:
        _set_four(
            src, base + at[0], w[0], base + at[1], base + at[2], w[1], base + at[3], base + at[4], w[2],
            base + at[5], base + at[6], w[3], base + at[7], base + at[8], w[4], out, o, n,
        )  # fmt: skip
    else:
        _set_six(
            src, base + at[0], w[0], base + at[1], base + at[2], w[1], base + at[3], base + at[4], w[2],
            base + at[5], base + at[6], w[3], base + at[7], base + at[8], w[4],
            base + at[9], base + at[10], w[5], base + at[11], base + at[12], w[6], out, o, n,
        )  # fmt: skip
        t = 6
    while t < pairs:
        m = 2 * t
        _add_four(
            src, base + at[m + 1], base + at[m + 2], w[t + 1], base + at[m + 3], base + at[m + 4], w[t + 2],
            base + at[m + 5], base + at[m + 6], w[t + 3], base + at[m + 7], base + at[m + 8], w[t + 4], out, o, n,
        )  # fmt: skip
        t += 4


@inlined()
def _set_slope(src, a0, b0, c0, a1, b1, c1, a2, b2, c2, a3, b3, c3, out, o, n):
    for i in range(n):
        total = fma(c1, src[a1 + i] - src[b1 + i], c0 * (src[a0 + i] - src[b0 + i]))
        total = fma(c2, src[a2 + i] - src[b2 + i], total)
        out[o + i] = fma(c3, src[a3 + i] - src[b3 + i], total)


@inlined()
def _add_slope(src, a0, b0, c0, a1, b1, c1, a2, b2, c2, a3, b3, c3, out, o, n):
    for i in range(n):
        total = fma(c0, src[a0 + i] - src[b0 + i], out[o + i])
        total = fma(c1, src[a1 + i] - src[b1 + i], total)
        total = fma(c2, src[a2 + i] - src[b2 + i], total)
        out[o + i] = fma(c3, src[a3 + i] - src[b3 + i], total)


@kernel()
def odd(src, base, at, w, out, o, n):
    """Correlate with antisymmetric taps; the number of pairs is a multiple of four."""
    _set_slope(
        src, base + at[1], base + at[2], w[1], base + at[3], base + at[4], w[2],
        base + at[5], base + at[6], w[3], base + at[7], base + at[8], w[4], out, o, n,
    )  # fmt: skip
    _more_slope(src, base, at, w, out, o, n)


@inlined()
def _more_slope(src, base, at, w, out, o, n):
    for t in range(4, w.shape[0] - 1, 4):
        m = 2 * t
        _add_slope(
            src, base + at[m + 1], base + at[m + 2], w[t + 1], base + at[m + 3], base + at[m + 4], w[t + 2],
            base + at[m + 5], base + at[m + 6], w[t + 3], base + at[m + 7], base + at[m + 8], w[t + 4], out, o, n,
        )  # fmt: skip


@inlined()
def _set_both(
    src, a, c, a0, b0, c0, d0, a1, b1, c1, d1, a2, b2, c2, d2, a3, b3, c3, d3, smoothed, u, sloped, v, n
):  # fmt: skip
    for i in range(n):
        f0, g0 = src[a0 + i], src[b0 + i]
        f1, g1 = src[a1 + i], src[b1 + i]
        f2, g2 = src[a2 + i], src[b2 + i]
        f3, g3 = src[a3 + i], src[b3 + i]
        total = fma(c0, f0 + g0, c * src[a + i])
        total = fma(c1, f1 + g1, total)
        total = fma(c2, f2 + g2, total)
        smoothed[u + i] = fma(c3, f3 + g3, total)
        slope = fma(d1, f1 - g1, d0 * (f0 - g0))
        slope = fma(d2, f2 - g2, slope)
        sloped[v + i] = fma(d3, f3 - g3, slope)


@kernel()
def both(src, base, at, w, v, smoothed, o, sloped, q, n):
    """Smooth with weights ``w`` and differentiate with ``v``; the number of pairs is a multiple of four."""
    _set_both(
        src, base + at[0], w[0], base + at[1], base + at[2], w[1], v[1], base + at[3], base + at[4], w[2], v[2],
        base + at[5], base + at[6], w[3], v[3], base + at[7], base + at[8], w[4], v[4], smoothed, o, sloped, q, n,
    )  # fmt: skip
    for t in range(4, w.shape[0] - 1, 4):
        m = 2 * t
        _add_four(
            src, base + at[m + 1], base + at[m + 2], w[t + 1], base + at[m + 3], base + at[m + 4], w[t + 2],
            base + at[m + 5], base + at[m + 6], w[t + 3], base + at[m + 7], base + at[m + 8], w[t + 4], smoothed, o, n,
        )  # fmt: skip
    _more_slope(src, base, at, v, sloped, q, n)
