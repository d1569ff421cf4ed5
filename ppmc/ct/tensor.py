"""The structure tensor of a block: gradient, products and window in one streaming pass.

The block is walked plane by plane along z. Each plane gives gradient products, which are windowed along x and y at
once and kept in a ring of as many planes as the z window is long; nothing of the size of the block is stored but the
result. The order of operations on a voxel does not depend on where the block begins or ends, so any cut of a volume
into blocks gives the same bits.

All filters run on flat arrays with offsets: results are weighted sums of stretches that begin at ``base + offsets[t]``.
Along z, y and x these are neighbouring planes, rows and voxels; a stretch is a whole plane, and what a filter makes of
the ends of rows is never used. With a stride k, a plane is stored in k phases (voxels 0, k, 2k, ... of its rows, then
1, k + 1, ...), so that every k-th voxel is again contiguous. Offsets are unsigned: numba then needs no test for
negative indices, and the loops vectorise.

Products may be contracted with the sum they are added to, but every sum below adds one product at a time: ``a * b +
c * d`` could be contracted in two ways, and the compiler takes one in a loop's body and the other in its remainder.

Component order XX, YY, ZZ, XY, YZ, XZ, and the windowed weight as a seventh where votes differ from voxel to voxel.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from functools import partial

import numpy as np

from ppmc.compile_cache import njit

U = np.uint64
kernel = partial(njit, nogil=True, no_cpython_wrapper=True)
"""Decorator of kernels that only kernels call: without the wrapper for Python they compile sooner."""
ZERO = np.float32(0.0)
LEAST_WEIGHT = np.float32(1e-6)
BATCH = 8
"""Planes that are windowed along z together, so that the ring is fetched from afar only once for all of them."""
STRETCH = 512
"""Floats of each plane that are windowed along z at a time: the ring's part of them fits the innermost cache."""


@kernel(fastmath={"contract"})
def _scale(src, a, c, out, o, n):
    for i in range(n):
        out[o + i] = c * src[a + i]


@kernel(fastmath={"contract"})
def _add_one(src, a0, b0, c0, out, o, n):
    for i in range(n):
        out[o + i] += c0 * (src[a0 + i] + src[b0 + i])


@kernel(fastmath={"contract"})
def _add_three(src, a0, b0, c0, a1, b1, c1, a2, b2, c2, out, o, n):
    for i in range(n):
        total = out[o + i] + c0 * (src[a0 + i] + src[b0 + i])
        total += c1 * (src[a1 + i] + src[b1 + i])
        out[o + i] = total + c2 * (src[a2 + i] + src[b2 + i])


@kernel(fastmath={"contract"})
def _set_three(src, a, c, a0, b0, c0, a1, b1, c1, a2, b2, c2, out, o, n):
    for i in range(n):
        total = ZERO + c * src[a + i]
        total += c0 * (src[a0 + i] + src[b0 + i])
        total += c1 * (src[a1 + i] + src[b1 + i])
        out[o + i] = total + c2 * (src[a2 + i] + src[b2 + i])


@kernel()
def _even(src, base, offsets, taps, out, o, n):
    """Correlate with symmetric taps: rows at ``base + offsets`` of ``src`` into ``out[o : o + n]``."""
    k = taps.shape[0] // 2
    t = 1
    if k >= 3:
        _set_three(
            src, base + offsets[k], taps[k],
            base + offsets[k + 1], base + offsets[k - 1], taps[k + 1],
            base + offsets[k + 2], base + offsets[k - 2], taps[k + 2],
            base + offsets[k + 3], base + offsets[k - 3], taps[k + 3], out, o, n,
        )  # fmt: skip
        t = 4
    else:
        _scale(src, base + offsets[k], taps[k], out, o, n)
    while t + 2 <= k:
        _add_three(
            src,
            base + offsets[k + t], base + offsets[k - t], taps[k + t],
            base + offsets[k + t + 1], base + offsets[k - t - 1], taps[k + t + 1],
            base + offsets[k + t + 2], base + offsets[k - t - 2], taps[k + t + 2], out, o, n,
        )  # fmt: skip
        t += 3
    while t <= k:
        _add_one(src, base + offsets[k + t], base + offsets[k - t], taps[k + t], out, o, n)
        t += 1


@kernel(fastmath={"contract"})
def _set_slope(src, a0, b0, d0, out, o, n):
    for i in range(n):
        out[o + i] = d0 * (src[a0 + i] - src[b0 + i])


@kernel(fastmath={"contract"})
def _add_slope(src, a0, b0, d0, out, o, n):
    for i in range(n):
        out[o + i] += d0 * (src[a0 + i] - src[b0 + i])


@kernel(fastmath={"contract"})
def _add_slope_three(src, a0, b0, d0, a1, b1, d1, a2, b2, d2, out, o, n):
    for i in range(n):
        total = out[o + i] + d0 * (src[a0 + i] - src[b0 + i])
        total += d1 * (src[a1 + i] - src[b1 + i])
        out[o + i] = total + d2 * (src[a2 + i] - src[b2 + i])


@kernel()
def _odd(src, base, offsets, taps, out, o, n):
    """Correlate with antisymmetric taps."""
    k = taps.shape[0] // 2
    _set_slope(src, base + offsets[k + 1], base + offsets[k - 1], taps[k + 1], out, o, n)
    t = 2
    while t + 2 <= k:
        _add_slope_three(
            src,
            base + offsets[k + t], base + offsets[k - t], taps[k + t],
            base + offsets[k + t + 1], base + offsets[k - t - 1], taps[k + t + 1],
            base + offsets[k + t + 2], base + offsets[k - t - 2], taps[k + t + 2], out, o, n,
        )  # fmt: skip
        t += 3
    while t <= k:
        _add_slope(src, base + offsets[k + t], base + offsets[k - t], taps[k + t], out, o, n)
        t += 1


@kernel(fastmath={"contract"})
def _set_both(src, a, c, a0, b0, c0, d0, even, odd, o, n):
    for i in range(n):
        u = src[a0 + i]
        v = src[b0 + i]
        total = ZERO + c * src[a + i]
        even[o + i] = total + c0 * (u + v)
        odd[o + i] = d0 * (u - v)


@kernel(fastmath={"contract"})
def _add_both(src, a0, b0, c0, d0, even, odd, o, n):
    for i in range(n):
        u = src[a0 + i]
        v = src[b0 + i]
        even[o + i] += c0 * (u + v)
        odd[o + i] += d0 * (u - v)


@kernel(fastmath={"contract"})
def _add_both_three(src, a0, b0, c0, d0, a1, b1, c1, d1, a2, b2, c2, d2, even, odd, o, n):
    for i in range(n):
        u0 = src[a0 + i]
        v0 = src[b0 + i]
        u1 = src[a1 + i]
        v1 = src[b1 + i]
        u2 = src[a2 + i]
        v2 = src[b2 + i]
        total = even[o + i] + c0 * (u0 + v0)
        total += c1 * (u1 + v1)
        even[o + i] = total + c2 * (u2 + v2)
        slant = odd[o + i] + d0 * (u0 - v0)
        slant += d1 * (u1 - v1)
        odd[o + i] = slant + d2 * (u2 - v2)


@kernel()
def _both(src, base, offsets, smooth, slope, even, odd, o, n):
    """Smooth and differentiate in one go."""
    k = smooth.shape[0] // 2
    _set_both(
        src, base + offsets[k], smooth[k], base + offsets[k + 1], base + offsets[k - 1], smooth[k + 1], slope[k + 1],
        even, odd, o, n,
    )  # fmt: skip
    t = 2
    while t + 2 <= k:
        _add_both_three(
            src,
            base + offsets[k + t], base + offsets[k - t], smooth[k + t], slope[k + t],
            base + offsets[k + t + 1], base + offsets[k - t - 1], smooth[k + t + 1], slope[k + t + 1],
            base + offsets[k + t + 2], base + offsets[k - t - 2], smooth[k + t + 2], slope[k + t + 2], even, odd, o, n,
        )  # fmt: skip
        t += 3
    while t <= k:
        _add_both(src, base + offsets[k + t], base + offsets[k - t], smooth[k + t], slope[k + t], even, odd, o, n)
        t += 1


@kernel(fastmath={"contract"})
def _products(gx, gy, gz, vote, first, c, size, n, out):
    """Write the six products of the gradient, weighted by ``c * vote[first:]``, ``size`` floats apart."""
    xx, yy, zz, xy, yz, xz = U(0), size, U(2) * size, U(3) * size, U(4) * size, U(5) * size
    for i in range(n):
        v = c * vote[first + i]
        a = gx[i]
        b = gy[i]
        d = gz[i]
        va = v * a
        vb = v * b
        out[xx + i] = va * a
        out[yy + i] = vb * b
        out[zz + i] = v * d * d
        out[xy + i] = va * b
        out[yz + i] = vb * d
        out[xz + i] = va * d


@kernel(fastmath={"contract"})
def _store(plane, base, size, c, inverse, noise, out, o, n):
    """Copy a row of averages: divide by the separable weight (given inverted), take the noise's share off."""
    for channel in range(6):
        a = base + U(channel) * size
        first = o + U(channel) * n
        share = noise[channel]
        for i in range(n):
            out[first + i] = plane[a + i] * (c * inverse[i]) - share


@kernel(fastmath={"contract"})
def _store_weighted(plane, base, size, averaged, noise, out, o, n):
    """Copy a row with its windowed votes; divide by them, if averages are wanted; nothing where nobody voted."""
    votes = base + U(6) * size
    for i in range(n):
        out[o + U(6) * n + i] = plane[votes + i]
    for channel in range(6):
        a = base + U(channel) * size
        first = o + U(channel) * n
        if averaged:
            share = noise[channel]
            for i in range(n):
                w = plane[votes + i]
                out[first + i] = plane[a + i] / w - share if w > LEAST_WEIGHT else ZERO
        else:
            for i in range(n):
                out[first + i] = plane[a + i]


@kernel()
def _offsets(count, step):
    """Return where ``count`` stretches begin that are ``step`` apart."""
    offsets = np.empty(count, np.uint64)
    for t in range(count):
        offsets[t] = t * step
    return offsets


@kernel()
def _phase_offsets(first, count, phases, size):
    """Return where voxels first .. first + count - 1 of a row stand that is stored in phases of ``size`` floats."""
    offsets = np.empty(count, np.uint64)
    for t in range(count):
        offsets[t] = ((first + t) % phases) * size + (first + t) // phases
    return offsets


@njit(nogil=True)
def tensor_block(grey, ny, smooth, slope, window, vote, vote_z, votes, inverse, noise, stride, out_shape, out):
    """Fill ``out`` with windowed gradient products of one block.

    Parameters
    ----------
    grey, ny : (nz * stride[0] * ny * m,) float32, int
        The block with its halo, ``n = (o - 1) * stride + 1 + 2 * (gradient radius + window radius)`` voxels along
        each axis, axes (z, phase of x, y, x); each phase of a row padded to m.
    smooth, slope : three float32 arrays (x, y, z)
        Taps of the Gaussian and of its derivative along each axis, the latter divided by the voxel size.
    window : three float32 arrays (x, y, z)
        Taps of the window.
    vote, vote_z : (stride[0] * ny * m,) and (pz,) float32
        A gradient's weight is ``vote * vote_z[z]``, both for the block less the gradient radius; ``vote`` laid out
        as a plane of ``grey``.
    votes : (pz * stride[0] * ny * m,) float32, or empty
        Weights by voxel instead of ``vote``; then ``out`` has a seventh channel, the windowed weight.
    inverse : three float32 arrays (x, y, z)
        One over the windowed votes at the output voxels, to make the window an average; empty to leave sums.
    noise : (6,) float32
        Tensor subtracted from averages.
    stride : three ints (x, y, z)
        Distance of output voxels.
    out_shape : four ints
        oz, oy, channels (6 or 7), ox.
    out : (oz * oy * channels * ox,) float32
        Filled.
    """
    oz, oy, channels, ox = out_shape
    phases, stride_y, stride_z = stride
    smooth_x, smooth_y, smooth_z = smooth
    slope_x, slope_y, slope_z = slope
    window_x, window_y, window_z = window
    inverse_x, inverse_y, inverse_z = inverse
    weighted = votes.shape[0] > 0
    averaged = inverse_x.shape[0] > 0
    length = window_z.shape[0]
    pz = (oz - 1) * stride_z + length
    py = (oy - 1) * stride_y + window_y.shape[0]
    size = grey.shape[0] // ((pz + smooth_z.shape[0] - 1) * phases)  # of one phase of a plane
    pitch = size // ny
    even = np.empty(phases * size, np.float32)
    odd = np.empty(phases * size, np.float32)
    along_x = np.zeros(phases * size, np.float32)
    along_y = np.zeros(phases * size, np.float32)
    along_z = np.zeros(phases * size, np.float32)
    gx = np.zeros(phases * size, np.float32)
    gy = np.zeros(phases * size, np.float32)
    gz = np.zeros(phases * size, np.float32)
    product = np.zeros(channels * phases * size, np.float32)
    rows = np.zeros(channels * py * pitch, np.float32)
    slot_size = channels * oy * pitch
    batch = max(1, BATCH // stride_z)
    slots = length + (batch - 1) * stride_z
    ring = np.empty(slots * slot_size, np.float32)
    mean = np.empty(batch * slot_size, np.float32)
    by_plane = _offsets(smooth_z.shape[0], phases * size)
    by_row = _offsets(smooth_y.shape[0], pitch)
    by_window_row = _offsets(window_y.shape[0], pitch)
    by_window_voxel = _phase_offsets(0, window_x.shape[0], phases, size)
    none = U(0)
    all_ = U(phases * size)
    # a filter along y or x leaves the last rows of the last phase alone, lest it read beyond the plane
    along = U(phases * size - (smooth_y.shape[0] - 1) * pitch)
    across = U(py * pitch)
    voxels = U((phases - 1) * size + py * pitch)
    by_slot = np.empty(length, np.uint64)
    done = 0
    for plane in range(pz):
        _both(grey, U(plane * phases * size), by_plane, smooth_z, slope_z, even, odd, none, all_)
        _both(even, none, by_row, smooth_y, slope_y, along_x, along_y, none, along)
        _even(odd, none, by_row, smooth_y, along_z, none, along)
        for s in range(phases):
            by_voxel = _phase_offsets(s, smooth_x.shape[0], phases, size)
            o = U(s * size)
            _odd(along_x, none, by_voxel, slope_x, gx, o, across)
            _even(along_y, none, by_voxel, smooth_x, gy, o, across)
            _even(along_z, none, by_voxel, smooth_x, gz, o, across)
        if weighted:
            first = U(plane * phases * size)
            _products(gx, gy, gz, votes, first, vote_z[plane], all_, voxels, product)
            _scale(votes, first, vote_z[plane], product, U(6) * all_, voxels)
        else:
            _products(gx, gy, gz, vote, none, vote_z[plane], all_, voxels, product)
        for c in range(channels):
            _even(product, U(c) * all_, by_window_voxel, window_x, rows, U(c) * across, across)
        slot = (plane % slots) * slot_size
        for c in range(channels):
            if stride_y == 1:
                o = U(slot + c * oy * pitch)
                _even(rows, U(c) * across, by_window_row, window_y, ring, o, U(oy * pitch))
            else:
                for y in range(oy):
                    o = U(slot + (c * oy + y) * pitch)
                    _even(rows, U(c) * across + U(y * stride_y * pitch), by_window_row, window_y, ring, o, U(pitch))
        ready = (plane - (length - 1)) // stride_z + 1 if plane >= length - 1 else 0
        if ready - done == batch or (plane == pz - 1 and ready > done):
            # several planes at a time, a stretch of each while the ring's part of it is near at hand
            for at in range(0, slot_size, STRETCH):
                n = U(min(STRETCH, slot_size - at))
                for z in range(done, ready):
                    for t in range(length):
                        by_slot[t] = ((z * stride_z + t) % slots) * slot_size + at
                    _even(ring, none, by_slot, window_z, mean, U((z - done) * slot_size + at), n)
            for z in range(done, ready):
                first = U((z - done) * slot_size)
                for y in range(oy):
                    o = U((z * oy + y) * channels * ox)
                    a = first + U(y * pitch)
                    if weighted:
                        _store_weighted(mean, a, U(oy * pitch), averaged, noise, out, o, U(ox))
                    elif averaged:
                        c = inverse_z[z] * inverse_y[y]
                        _store(mean, a, U(oy * pitch), c, inverse_x, noise, out, o, U(ox))
            done = ready
