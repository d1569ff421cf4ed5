"""The structure tensor of a block: gradient, products and window in one streaming pass.

The block is walked plane by plane along z. :func:`push_planes` makes gradient products of a plane, windows them along
x and y at once and keeps the result in a ring of planes; :func:`pull_planes` windows the ring along z. Nothing of the
size of the block is stored. The order of operations on a voxel does not depend on where the block begins or ends, so
any cut of a volume into blocks gives the same bits.

A plane is worked on in bands of a few rows, so that what passes from one filter to the next stays in the innermost
cache. Filters run on flat arrays (see :mod:`ppmc.ct.passes`); a stretch is a whole band, and what a filter makes of the
ends of rows is never used. With a stride k, a plane is stored in k phases (voxels 0, k, 2k, ... of its rows, then
1, k + 1, ...), so that every k-th voxel is again contiguous.

Component order XX, YY, ZZ, XY, YZ, XZ, and the windowed weight as a seventh where votes differ from voxel to voxel.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from ppmc.ct.passes import U, both, entry, even, kernel, odd, pairs_of, scale, stretches, weights

N = np.int64
"""A literal number would have a kernel compiled for itself."""
ZERO = np.float32(0.0)
LEAST_WEIGHT = np.float32(1e-6)
BAND = 1024
"""Floats of a plane that are worked on at a time, at least one row of each phase."""
LINE = 16
"""Floats of a line of the cache, of which there are 64 places."""
GROUP = 16
"""Rows that are windowed along y together, at least."""
STRETCH = 512
"""Floats of each plane that are windowed along z at a time: the ring's part of them fits the innermost cache."""


@kernel()
def _products(band, gx, gy, gz, vote, first, c, n, out, apart):
    """Write the six products of gradients, weighted by ``c * vote[first:]``, ``apart`` floats apart."""
    xx, yy, zz = out, out + apart, out + U(2) * apart
    xy, yz, xz = out + U(3) * apart, out + U(4) * apart, out + U(5) * apart
    for i in range(n):
        v = c * vote[first + i]
        a = band[gx + i]
        b = band[gy + i]
        d = band[gz + i]
        va = v * a
        vb = v * b
        band[xx + i] = va * a
        band[yy + i] = vb * b
        band[zz + i] = v * d * d
        band[xy + i] = va * b
        band[yz + i] = vb * d
        band[xz + i] = va * d


def band_rows(phases, pitch):
    """Return the number of rows of a band."""
    return max(1, BAND // (phases * pitch))


def slot_size(size):
    """Return the floats from slot to slot of the ring: some more than a plane, lest slots contend for cache lines."""
    return size + (LINE * 17 - size) % (LINE * 64)


def work_sizes(shape, window_x):
    """Return the sizes of ``work`` and ``band`` of :func:`push_planes` for a window.

    Behind a band there are floats that the window along x may read; what it makes of them is never used.
    """
    ny, pitch, _, channels, phases, _ = shape
    band = phases * band_rows(phases, pitch) * pitch
    return (2 * phases + channels) * ny * pitch, (6 + channels) * band + window_x.shape[0]


def sweeps(smooth, slope, window, shape):
    """Return taps and places of :func:`push_planes`; made outside of it, for that compiles in no time.

    Parameters
    ----------
    smooth, slope : three float32 arrays (x, y, z)
        Taps of the Gaussian and of its derivative along each axis, the latter divided by the voxel size.
    window : three float32 arrays (x, y, z)
        Taps of the window.
    shape : ints
        See :func:`push_planes`.

    Returns
    -------
    taps : eight float32 arrays
        Of :func:`~ppmc.ct.passes.weights`: Gaussian x, y, z, derivative x, y, z, window x, y.
    places : five uint64 arrays
        Of :func:`~ppmc.ct.passes.stretches`: planes, rows, the window's voxels and rows; and voxels for each phase.
    """
    ny, pitch, _, _, phases, _ = shape
    size = ny * pitch
    part = band_rows(phases, pitch) * pitch
    reach = [len(taps) // 2 for taps in smooth]
    pairs = [-(-r // 4) * 4 for r in reach]
    half = [len(taps) // 2 for taps in window]
    gradient = [weights(taps, n) for filters in (smooth, slope) for taps, n in zip(filters, pairs, strict=True)]
    mean = [weights(taps, pairs_of(n)) for taps, n in zip(window[:2], half[:2], strict=True)]
    by_voxel = _phased(np.arange(phases)[:, None] + stretches(reach[0], pairs[0], 1).astype(np.int64), phases, part)
    by_window_voxel = _phased(stretches(half[0], pairs_of(half[0]), 1).astype(np.int64), phases, part)
    places = (
        stretches(reach[2], pairs[2], phases * size),
        stretches(reach[1], pairs[1], pitch),
        by_window_voxel,
        stretches(half[1], pairs_of(half[1]), pitch),
        by_voxel,
    )
    return (*gradient, *mean), places


def _phased(voxels, phases, size):
    """Return where voxels are in a row that is stored in phases of ``size`` floats."""
    return (voxels % phases * size + voxels // phases).astype(np.uint64)


@entry()
def push_planes(first, last, grey, shape, length, rows, taps, places, vote, vote_z, votes, ring, slots, work, band):
    """Put planes of gradient products, windowed along x and y, into the ring.

    Parameters
    ----------
    first, last : int
        Planes of products, counted from the block's first; plane z is made from planes z to z + 2 * (gradient radius)
        of ``grey`` and goes to slot ``z % slots``.
    grey : (nz * stride_x * ny * pitch,) float32
        The block with its halo, axes (z, phase of x, y, x).
    shape : six ints
        ny, pitch, output rows, channels (6 or 7), stride along x, stride along y.
    length, rows : int
        Taps of the window along y, and :func:`band_rows`.
    taps, places
        See :func:`sweeps`.
    vote, vote_z : (stride_x * ny * pitch,) and (pz,) float32
        A gradient's weight is ``vote * vote_z[z]``, both for the block less the gradient radius; ``vote`` laid out
        as a plane of ``grey``.
    votes : (pz * stride_x * ny * pitch,) float32, or empty
        Weights by voxel instead of ``vote``; then the ring has a seventh channel, the windowed weight.
    ring : (slots * apart,) float32
    slots : two ints
        Number of slots, and :func:`slot_size` of channels * output rows * pitch, the distance ``apart``.
    work, band : float32 arrays of :func:`work_sizes`
        Finite values on entry.
    """
    ny, pitch, oy, channels, phases, stride_y = shape
    even_x, even_y, even_z, odd_x, odd_y, odd_z, mean_x, mean_y = taps
    by_plane, by_row, by_window_voxel, by_window_row, by_voxel_of = places
    count, apart = slots
    py = (oy - 1) * stride_y + length
    size = ny * pitch
    part = rows * pitch
    whole = phases * part
    weighted = votes.shape[0] > 0
    slant, sums = phases * size, 2 * phases * size
    along_x, along_y, along_z = U(0), U(whole), U(2 * whole)
    gx, gy, gz, products = U(3 * whole), U(4 * whole), U(5 * whole), U(6 * whole)
    for plane in range(first, last):
        start = plane * phases * size
        slot = (plane % count) * apart
        for at in range(0, phases * size, BAND):
            n = U(min(BAND, phases * size - at))
            both(grey, U(start + at), by_plane, even_z, odd_z, work, U(at), work, U(slant + at), n)
        done = 0
        for y in range(0, py, rows):
            new = min(rows, py - y)
            n = U(new * pitch)
            for s in range(phases):
                o = U(s * part)
                a = s * size + y * pitch
                both(work, U(a), by_row, even_y, odd_y, band, along_x + o, band, along_y + o, n)
                even(work, U(slant + a), by_row, even_y, band, along_z + o, n)
            for s in range(phases):
                o = U(s * part)
                by_voxel = by_voxel_of[s]
                odd(band, along_x, by_voxel, odd_x, band, gx + o, n)
                even(band, along_y, by_voxel, even_x, band, gy + o, n)
                even(band, along_z, by_voxel, even_x, band, gz + o, n)
                a = s * size + y * pitch
                c = vote_z[plane]
                if weighted:
                    _products(band, gx + o, gy + o, gz + o, votes, U(start + a), c, n, products + o, U(whole))
                    scale(votes, U(start + a), c, band, products + o + U(6 * whole), n)
                else:
                    _products(band, gx + o, gy + o, gz + o, vote, U(a), c, n, products + o, U(whole))
            for channel in range(channels):
                o = U(sums + channel * size + y * pitch)
                even(band, products + U(channel * whole), by_window_voxel, mean_x, work, o, n)
            ready = min((y + new - length) // stride_y + 1, oy) if y + new >= length else 0
            if ready - done >= GROUP or (ready > done and y + new == py):
                # many rows at a time, one channel after the other: what they have in common is near at hand
                for channel in range(channels):
                    a = sums + channel * size
                    o = slot + channel * oy * pitch
                    if stride_y == 1:
                        for at in range(done * pitch, ready * pitch, BAND):
                            n = U(min(BAND, ready * pitch - at))
                            even(work, U(a + at), by_window_row, mean_y, ring, U(o + at), n)
                    else:
                        for row in range(done, ready):
                            at = U(a + row * stride_y * pitch)
                            even(work, at, by_window_row, mean_y, ring, U(o + row * pitch), U(pitch))
                done = ready


@kernel()
def _divide(out, o, inverse, at, c, n):
    """Divide by the separable weight, given inverted."""
    for i in range(n):
        out[o + i] *= c * inverse[at + i]


@kernel()
def _divide_weighted(out, o, votes, n):
    """Divide by the windowed votes; nothing where nobody voted."""
    for i in range(n):
        w = out[votes + i]
        out[o + i] = out[o + i] / w if w > LEAST_WEIGHT else ZERO


@kernel()
def _subtract(out, o, share, n):
    """Take the noise's share off."""
    for i in range(n):
        out[o + i] -= share


@entry()
def pull_planes(
    first, last, ring, slots, shape, stride_z, mean_z, planes, by_slot, inverse, inverse_z, averaged, noise, out,
    at_plane,
):  # fmt: skip
    """Window planes of the ring along z.

    Parameters
    ----------
    first, last : int
        Output planes; plane z takes slots z * stride_z to z * stride_z + (length of the window) - 1.
    ring, slots : array, two ints
        See :func:`push_planes`.
    shape : three ints
        Rows, channels and pitch of a plane.
    stride_z : int
    mean_z, planes, by_slot : float32 and two uint64 arrays
        :func:`~ppmc.ct.passes.weights` and :func:`~ppmc.ct.passes.stretches` of the window along z, and room for as
        many places as the latter.
    inverse, inverse_z : float32 arrays
        One over the windowed votes by channel, row and voxel of a plane, and by plane; used with six channels.
    averaged : bool
        Divide by the votes; else leave sums.
    noise : (6,) float32
        Tensor subtracted from averages.
    out, at_plane : (planes * channels * rows * pitch,) float32, int
        Filled from that plane on.
    """
    rows, channels, pitch = shape
    size = rows * channels * pitch
    count, apart = slots
    noisy = False
    for channel in range(noise.shape[0]):
        noisy |= noise[channel] != ZERO
    for at in range(0, size, STRETCH):
        n = U(min(STRETCH, size - at))
        for z in range(first, last):
            begin = z * stride_z % count
            for t in range(by_slot.shape[0]):
                s = begin + np.int64(planes[t])
                by_slot[t] = (s if s < count else s - count) * apart + at
            o = U((at_plane + z - first) * size + at)
            even(ring, U(0), by_slot, mean_z, out, o, n)
            if averaged and channels == 6:
                _divide(out, o, inverse, U(at), inverse_z[z], n)
    if averaged and (noisy or channels == 7):
        n = U(rows * pitch)
        for plane in range(at_plane, at_plane + last - first):
            # a literal 6 would have the loop unrolled, which more than doubles the time to compile this kernel
            for channel in range(noise.shape[0]):
                o = U(plane * size) + U(channel) * n
                if channels == 7:
                    _divide_weighted(out, o, U(plane * size) + U(6) * n, n)
                if noisy:
                    _subtract(out, o, noise[channel], n)
