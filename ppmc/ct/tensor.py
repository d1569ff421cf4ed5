"""The structure tensor of a block: gradient, products and window in one streaming pass.

The block is walked plane by plane along z. Each plane gives gradient products, which are windowed along x and y at
once and kept in a ring of as many planes as the z window is long; nothing of the size of the block is stored but the
result. The order of operations on a voxel does not depend on where the block begins or ends, so any cut of a volume
into blocks gives the same bits.

Component order XX, YY, ZZ, XY, YZ, XZ, and the windowed weight as a seventh where votes differ from voxel to voxel.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from ppmc.compile_cache import njit

ZERO = np.float32(0.0)
LEAST_WEIGHT = np.float32(1e-6)


# Rows are handed over as slices of equal length: numba then knows that no index is negative, and the loops vectorise.
# Pairs of taps are added four, two or one at a time to spare loads and stores of the running sum.


@njit(nogil=True, fastmath={"contract"})
def _scale(a, c, out):
    for i in range(out.shape[0]):
        out[i] = c * a[i]


@njit(nogil=True, fastmath={"contract"})
def _add_one(a0, b0, c0, out):
    for i in range(out.shape[0]):
        out[i] += c0 * (a0[i] + b0[i])


@njit(nogil=True, fastmath={"contract"})
def _add_two(a0, b0, c0, a1, b1, c1, out):
    for i in range(out.shape[0]):
        out[i] += c0 * (a0[i] + b0[i]) + c1 * (a1[i] + b1[i])


@njit(nogil=True, fastmath={"contract"})
def _add_four(a0, b0, c0, a1, b1, c1, a2, b2, c2, a3, b3, c3, out):
    for i in range(out.shape[0]):
        near = c0 * (a0[i] + b0[i]) + c1 * (a1[i] + b1[i])
        far = c2 * (a2[i] + b2[i]) + c3 * (a3[i] + b3[i])
        out[i] += near + far


@njit(nogil=True, fastmath={"contract"})
def _add_difference(a, b, c, out):
    for i in range(out.shape[0]):
        out[i] += c * (a[i] - b[i])


@njit(nogil=True, fastmath={"contract"})
def _add_both(a, b, c, d, even, odd):
    """Add a pair of rows to a smoothed and to a differentiated row in one go."""
    for i in range(even.shape[0]):
        even[i] += c * (a[i] + b[i])
        odd[i] += d * (a[i] - b[i])


@njit(nogil=True, fastmath={"contract"})
def _add_both_two(a0, b0, c0, d0, a1, b1, c1, d1, even, odd):
    for i in range(even.shape[0]):
        even[i] += c0 * (a0[i] + b0[i]) + c1 * (a1[i] + b1[i])
        odd[i] += d0 * (a0[i] - b0[i]) + d1 * (a1[i] - b1[i])


@njit(nogil=True)
def _even(row, taps, out):
    """Correlate a row with symmetric taps; ``out`` is shorter than ``row`` by twice the radius."""
    k = taps.shape[0] // 2
    n = out.shape[0]
    _scale(row[k : k + n], taps[k], out)
    t = 1
    while t + 3 <= k:
        _add_four(
            row[k + t : k + t + n], row[k - t : k - t + n], taps[k + t],
            row[k + t + 1 : k + t + 1 + n], row[k - t - 1 : k - t - 1 + n], taps[k + t + 1],
            row[k + t + 2 : k + t + 2 + n], row[k - t - 2 : k - t - 2 + n], taps[k + t + 2],
            row[k + t + 3 : k + t + 3 + n], row[k - t - 3 : k - t - 3 + n], taps[k + t + 3], out,
        )  # fmt: skip
        t += 4
    if t + 1 <= k:
        _add_two(
            row[k + t : k + t + n], row[k - t : k - t + n], taps[k + t],
            row[k + t + 1 : k + t + 1 + n], row[k - t - 1 : k - t - 1 + n], taps[k + t + 1], out,
        )  # fmt: skip
        t += 2
    if t <= k:
        _add_one(row[k + t : k + t + n], row[k - t : k - t + n], taps[k + t], out)


@njit(nogil=True)
def _odd(row, taps, out):
    """Correlate a row with antisymmetric taps."""
    k = taps.shape[0] // 2
    n = out.shape[0]
    out[:] = ZERO
    for t in range(1, k + 1):
        _add_difference(row[k + t : k + t + n], row[k - t : k - t + n], taps[k + t], out)


@njit(nogil=True)
def _even_across(rows, first, left, taps, out):
    """Correlate with symmetric taps across ``rows`` (m, n), from row ``first`` (cyclically) and column ``left`` on."""
    m = rows.shape[0]
    k = taps.shape[0] // 2
    i = first + k
    right = left + out.shape[0]
    _scale(rows[i % m, left:right], taps[k], out)
    t = 1
    while t + 3 <= k:
        _add_four(
            rows[(i + t) % m, left:right], rows[(i - t) % m, left:right], taps[k + t],
            rows[(i + t + 1) % m, left:right], rows[(i - t - 1) % m, left:right], taps[k + t + 1],
            rows[(i + t + 2) % m, left:right], rows[(i - t - 2) % m, left:right], taps[k + t + 2],
            rows[(i + t + 3) % m, left:right], rows[(i - t - 3) % m, left:right], taps[k + t + 3], out,
        )  # fmt: skip
        t += 4
    if t + 1 <= k:
        _add_two(
            rows[(i + t) % m, left:right], rows[(i - t) % m, left:right], taps[k + t],
            rows[(i + t + 1) % m, left:right], rows[(i - t - 1) % m, left:right], taps[k + t + 1], out,
        )  # fmt: skip
        t += 2
    if t <= k:
        _add_one(rows[(i + t) % m, left:right], rows[(i - t) % m, left:right], taps[k + t], out)


@njit(nogil=True)
def _both_across(rows, first, left, smooth, slope, even, odd):
    """Smooth and differentiate across ``rows`` (m, n), from row ``first`` and column ``left`` on."""
    k = smooth.shape[0] // 2
    i = first + k
    right = left + even.shape[0]
    _scale(rows[i, left:right], smooth[k], even)
    odd[:] = ZERO
    t = 1
    while t + 1 <= k:
        _add_both_two(
            rows[i + t, left:right], rows[i - t, left:right], smooth[k + t], slope[k + t],
            rows[i + t + 1, left:right], rows[i - t - 1, left:right], smooth[k + t + 1], slope[k + t + 1], even, odd,
        )  # fmt: skip
        t += 2
    if t <= k:
        _add_both(rows[i + t, left:right], rows[i - t, left:right], smooth[k + t], slope[k + t], even, odd)


@njit(nogil=True, fastmath={"contract"})
def _products(gx, gy, gz, vote, out):
    """Write the six products of the gradient, weighted by ``vote``."""
    xx, yy, zz, xy, yz, xz = out[0], out[1], out[2], out[3], out[4], out[5]
    for i in range(gx.shape[0]):
        a = gx[i]
        b = gy[i]
        c = gz[i]
        v = vote[i]
        va = v * a
        vb = v * b
        xx[i] = va * a
        yy[i] = vb * b
        zz[i] = v * c * c
        xy[i] = va * b
        yz[i] = vb * c
        xz[i] = va * c


@njit(nogil=True, fastmath={"contract"})
def _add_scaled(a, c, out):
    for i in range(out.shape[0]):
        out[i] += c * a[i]


@njit(nogil=True)
def _window_x(row, taps, stride, phases, out):
    """Window one row along x at every ``stride``-th voxel; ``phases`` (stride, m) is scratch."""
    if stride == 1:
        _even(row, taps, out)
        return
    n = out.shape[0]
    for s in range(stride):
        phase = phases[s]
        for i in range((row.shape[0] - s + stride - 1) // stride):
            phase[i] = row[i * stride + s]
    out[:] = ZERO
    for t in range(taps.shape[0]):
        shift = t // stride
        _add_scaled(phases[t % stride, shift : shift + n], taps[t], out)


@njit(nogil=True, fastmath={"contract"})
def _finish(row, c, weight, noise):
    """Divide a windowed row by its separable weight (given inverted) and take the noise's share off."""
    for i in range(row.shape[0]):
        row[i] = row[i] * (c * weight[i]) - noise


@njit(nogil=True, fastmath={"contract"})
def _finish_weighted(row, weight, noise):
    """Divide a windowed row by the windowed votes; nothing where nobody voted."""
    for i in range(row.shape[0]):
        voted = weight[i] > LEAST_WEIGHT
        row[i] = row[i] / weight[i] - noise if voted else ZERO


@njit(nogil=True)
def tensor_block(grey, smooth, slope, window, vote, votes, inverse, noise, stride, out):
    """Fill ``out`` with windowed gradient products of one block.

    Parameters
    ----------
    grey : (nz, ny, nx) float32
        The block with its halo: ``n = (o - 1) * stride + 1 + 2 * (gradient radius + window radius)`` along each axis.
    smooth, slope : three float32 arrays (x, y, z)
        Taps of the Gaussian and of its derivative along each axis, the latter divided by the voxel size.
    window : three float32 arrays (x, y, z)
        Taps of the window.
    vote : three float32 arrays (x, y, z)
        Weight of a voxel's gradient is ``vote[0][x] * vote[1][y] * vote[2][z]``; the block less the gradient radius.
    votes : (nz, ny, nx) float32, same extent as the votes above, or empty
        A further weight by voxel; then ``out`` has a seventh channel, the windowed weight.
    inverse : three float32 arrays (x, y, z)
        One over the windowed votes at the output voxels, to make the window an average; empty to leave sums.
    noise : (6,) float32
        Tensor subtracted from averages.
    stride : three ints (x, y, z)
        Distance of output voxels.
    out : (oz, oy, 6 or 7, ox) float32
        Filled.
    """
    weighted = votes.shape[0] > 0
    averaged = inverse[0].shape[0] > 0
    channels = out.shape[2]
    oy, ox = out.shape[1], out.shape[3]
    ny, nx = grey.shape[1], grey.shape[2]
    pz = grey.shape[0] - (smooth[2].shape[0] - 1)
    py = ny - (smooth[1].shape[0] - 1)
    px = nx - (smooth[0].shape[0] - 1)
    length = window[2].shape[0]
    even = np.empty((ny, nx), np.float32)
    odd = np.empty((ny, nx), np.float32)
    along_x = np.empty(nx, np.float32)
    along_y = np.empty(nx, np.float32)
    along_z = np.empty(nx, np.float32)
    gx = np.empty(px, np.float32)
    gy = np.empty(px, np.float32)
    gz = np.empty(px, np.float32)
    weight = np.empty(px, np.float32)
    product = np.empty((channels, px), np.float32)
    phases = np.empty((stride[0], px // stride[0] + 2), np.float32)
    rows = np.empty((py, channels * ox), np.float32)
    ring = np.empty((oy, length, channels * ox), np.float32)
    planes = grey.reshape(grey.shape[0], ny * nx)
    for plane in range(pz):
        for y in range(ny):
            _both_across(planes, plane, y * nx, smooth[2], slope[2], even[y], odd[y])
        for y in range(py):
            _both_across(even, y, 0, smooth[1], slope[1], along_x, along_y)
            _even_across(odd, y, 0, smooth[1], along_z)
            _odd(along_x, slope[0], gx)
            _even(along_y, smooth[0], gy)
            _even(along_z, smooth[0], gz)
            _scale(vote[0], vote[2][plane] * vote[1][y], weight)
            if weighted:
                own = votes[plane, y]
                for i in range(px):
                    weight[i] *= own[i]
                product[6, :] = weight
            _products(gx, gy, gz, weight, product)
            for c in range(channels):
                _window_x(product[c], window[0], stride[0], phases, rows[y, c * ox : (c + 1) * ox])
        slot = plane % length
        for y in range(oy):
            for c in range(channels):
                _even_across(rows, y * stride[1], c * ox, window[1], ring[y, slot, c * ox : (c + 1) * ox])
        first = plane - (length - 1)
        if first >= 0 and first % stride[2] == 0:
            z = first // stride[2]
            for y in range(oy):
                for c in range(channels):
                    _even_across(ring[y], first, c * ox, window[2], out[z, y, c])
                if averaged and weighted:
                    for c in range(6):
                        _finish_weighted(out[z, y, c], out[z, y, 6], noise[c])
                elif averaged:
                    for c in range(6):
                        _finish(out[z, y, c], inverse[2][z] * inverse[1][y], inverse[0], noise[c])
