"""Windows for p that lie in the plane of the platelet, whatever its tilt.

A window along the axes leaves a tilted platelet after a few voxels and mixes the next one in; the thinner the
platelets, the sooner. Here gradient products are averaged over a flat ellipsoid whose short axis is the local normal r:
the weight of the voxel at distance d is ``(1 - |d_in|^2 / reach^2 - |d_r|^2 / across^2)^2`` with d's parts in the plane
and along r, zero outside. It depends smoothly on r, so nothing jumps where r turns, and it knows no axes: a volume
turned by right angles has the same windows.

This is done twice: first over a few voxels, of which every fourth is used (all offsets even, or all odd), for gradients
nearer to each other say little new; then over a wide window on a sparser lattice (offsets even, with a sum divisible by
four), which joins the small windows. Together they are as good as one wide window at a third of the cost, and small
windows that are disturbed by another direction, at the edges of platelets above all, need not count as much: they are
weighted with one over the square of their least eigenvalue, which would be zero in an ideal platelet. Offsets d and -d
have the same weight, so the list holds one of each pair. Kernels work on a chunk of voxels of a row (see
:mod:`ppmc.ct.eigen`); pairs beyond the window of every voxel of a few rows are passed over, which changes no bit.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import fma
from ppmc.ct.eigen import CHUNK, R1, R2, R6, WORK, solve
from ppmc.ct.passes import entry, kernel

N, U = np.int64, np.uint64  # a literal number would have a kernel compiled for itself
ZERO, ONE = np.float32(0.0), np.float32(1.0)
LEAST_VOTES = np.float32(1e-20)
"""Sum of weights below which nobody voted."""
NOWHERE = np.float32(1e30)
"""Least eigenvalue where there is no tensor: outside the volume or the mask."""
FLOOR = np.float32(1e-3)
"""Least eigenvalue that counts as none, in units of the trace and of one unit of grey values per voxel."""
ROWS = 8
"""Rows that share a list of pairs."""
BUFFERS = (6, WORK // CHUNK, 9, 3 * ROWS, 2, 7)
"""Rows of the arrays that :func:`steer_planes` works on."""
SLACK = np.float32(1e-4)
"""Rounding allowed for where pairs are passed over; far more than float32 needs."""


@lru_cache
def offset_pairs(
    reach: float, across: float, spacing: tuple[float, float, float], *, sparse: bool
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return one offset of each pair of a window's lattice.

    Parameters
    ----------
    reach, across : float
        Half axes of the window in the plane and across it, mm.
    spacing : tuple of float
        Voxel size (x, y, z), mm.
    sparse : bool
        The second window's lattice instead of the first's.

    Returns
    -------
    steps : ndarray, shape (n, 3)
        Offsets (x, y, z), voxels; the pair of the first is itself, (0, 0, 0), and the last never has any weight.
    form : ndarray, shape (5, n)
        The weight for a normal r is ``max(c - (g . r)^2, 0)^2``: rows g_x, g_y, g_z, c and the length of g.
    """
    h = np.array(spacing)
    half = [int(reach / step + 1e-6) for step in spacing]
    # x last: neighbours in the list then read the same rows, which are still in the nearest cache
    z, y, x = np.meshgrid(*(np.arange(-n, n + 1) for n in half[::-1]), indexing="ij")
    steps = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    if sparse:
        steps = steps[(steps % 2 == 0).all(axis=1) & (steps.sum(axis=1) % 4 == 0)]
    else:
        steps = steps[(steps % 2 == steps[:, :1] % 2).all(axis=1)]
    square = np.sum((steps * h) ** 2, axis=1)
    x, y, z = steps.T
    one_of_two = (z > 0) | ((z == 0) & ((y > 0) | ((y == 0) & (x > 0))))
    near = square < reach**2
    steps = np.concatenate([np.zeros((1, 3), np.int64), steps[one_of_two & near]])
    c = 1.0 - np.sum((steps * h) ** 2, axis=1) / reach**2
    g = steps * h * np.sqrt(1.0 / across**2 - 1.0 / reach**2)
    form = np.concatenate([g.T, [c, np.linalg.norm(g, axis=1)]])
    # last comes a pair that never counts
    steps, form = np.vstack([steps, [0, 0, 0]]), np.hstack([form, [[0.0], [0.0], [0.0], [-1.0], [0.0]]])
    return steps.astype(np.int64), np.ascontiguousarray(form, np.float32)


@kernel()
def interpolate(coarse, low, low1, high, high1, apart, b, a, n, out):
    """Interpolate six components, ``apart`` floats apart, between four stretches: rows with share b, planes with a.

    A share of one gives the upper value to the last bit, as a share of zero does in the next cell.
    """
    for c in range(out.shape[0] // CHUNK):
        o = U(c * CHUNK)
        shift = U(c * apart)
        p, p1, q, q1 = U(low) + shift, U(low1) + shift, U(high) + shift, U(high1) + shift
        for i in range(U(n)):
            first = (ONE - b) * coarse[p + i] + b * coarse[p1 + i]
            second = (ONE - b) * coarse[q + i] + b * coarse[q1 + i]
            out[o + i] = (ONE - a) * first + a * second


@kernel()
def spread_of(normals, rows, n):
    """Return the normal in the middle of some rows, and the largest distance of the others from it, signs apart."""
    middle = U((rows // 2) * 3 * CHUNK + n // 2)
    x, y, z = normals[middle], normals[middle + U(R1)], normals[middle + U(R2)]
    worst = ZERO
    for row in range(rows):
        a = U(row * 3 * CHUNK)
        for i in range(U(n)):
            u, v, w = normals[a + i], normals[a + U(R1) + i], normals[a + U(R2) + i]
            same = abs(u * x + v * y + w * z)
            worst = max(worst, u * u + v * v + w * w + x * x + y * y + z * z - (same + same))
    return x, y, z, np.sqrt(max(worst, ZERO)) + SLACK


@kernel()
def _within(form, x, y, z, spread, chosen):
    """Write the pairs that are within the window of some normal near (x, y, z); return their number."""
    count = 0
    for k in range(U(form.shape[1])):
        along = abs(form[0, k] * x + form[1, k] * y + form[2, k] * z) - spread * form[4, k]
        chosen[count] = k
        count += 1 if along < ZERO or along * along < form[3, k] + SLACK else 0
    # the last of the list has no weight for anybody: it makes the number even
    chosen[count] = form.shape[1] - 1
    return count + count % 2


@kernel()
def _add(sums, a, b, p, q, form, m, n, normals, first, weight, apart, channels, total):
    """Add two pairs of the list, m and n, of windows to all channels, weighted for each normal of a chunk."""
    gx, gy, gz, c = form[0, m], form[1, m], form[2, m], form[3, m]
    hx, hy, hz, d = form[0, n], form[1, n], form[2, n], form[3, n]
    for i in range(U(CHUNK)):
        x, y, z = normals[first + i], normals[first + U(R1) + i], normals[first + U(R2) + i]
        one = fma(gx, x, fma(gy, y, gz * z))
        two = fma(hx, x, fma(hy, y, hz * z))
        one = max(fma(-one, one, c), ZERO)
        two = max(fma(-two, two, d), ZERO)
        weight[i] = one * one
        weight[U(CHUNK) + i] = two * two
    for channel in range(channels):
        o, shift = channel * U(CHUNK), channel * apart
        for i in range(U(CHUNK)):
            t = fma(weight[i], sums[a + shift + i] + sums[b + shift + i], total[o + i])
            total[o + i] = fma(weight[U(CHUNK) + i], sums[p + shift + i] + sums[q + shift + i], t)


@kernel()
def _gather(
    sums, middle, plane_at, z, row_pitch, apart, channels, steps, form, chosen, count, normals, first, weight, total
):
    """Sum a chunk of windows about the voxels from ``middle`` (in its plane) on; ``count`` is even.

    The pair of the voxel itself counts it twice: hence the first term.
    """
    here = plane_at[z]
    for c in range(channels):
        a = U(here + middle) + c * apart
        for i in range(U(CHUNK)):
            total[c * U(CHUNK) + i] = -sums[a + i]
    for k in range(0, count, 2):
        m, n = chosen[k], chosen[k + 1]
        at_m = steps[m, 1] * row_pitch + steps[m, 0]
        at_n = steps[n, 1] * row_pitch + steps[n, 0]
        _add(
            sums, U(plane_at[z + steps[m, 2]] + middle + at_m), U(plane_at[z - steps[m, 2]] + middle - at_m),
            U(plane_at[z + steps[n, 2]] + middle + at_n), U(plane_at[z - steps[n, 2]] + middle - at_n),
            form, m, n, normals, first, weight, apart, channels, total,
        )  # fmt: skip


@kernel()
def _finish(total, work, solved, noise, unit, final):
    """Turn sums and votes into what is kept of them.

    In the end that is the average, less the noise's share, or nothing where nobody voted. Before that it is sums and
    votes, weighted by how little the direction that they see is disturbed. Least eigenvalues are left in ``solved``.
    """
    solve(total, work, solved)
    for i in range(CHUNK):
        votes = total[R6 + i]
        one = ONE / votes if votes > LEAST_VOTES else ZERO
        trace = (total[i] + total[R1 + i] + total[R2 + i]) * one
        solved[i] = max(solved[i] * one, ZERO) if votes > LEAST_VOTES else NOWHERE
        w = unit / (solved[i] + FLOOR * (trace + unit))
        work[i] = one if final else w * w
    for c in range(noise.shape[0]):
        share = noise[c]
        for i in range(CHUNK):
            total[c * CHUNK + i] = total[c * CHUNK + i] * work[i] - share


@entry()
def steer_planes(
    sums, plane_at, shape, steps, form, reach, coarse, coarse_shape, lower, share, planes, rows, voxels, noise, unit,
    out, channels, out_pitch, first, last, at_plane, scores, chosen, buffers,
):  # fmt: skip
    """Write the tensors of some planes, averaged in the planes of their platelets.

    Parameters
    ----------
    sums : (slots * 7 * rows * pitch,) float32
        A ring of planes of gradient products and votes, each (7, rows, pitch), ``reach`` voxels larger at all ends;
        finite numbers for a further chunk.
    plane_at : (planes,) int64
        Where each plane begins, from that ``reach`` before plane ``first``'s on.
    shape : two ints
        Rows and pitch.
    steps, form : arrays
        See :func:`offset_pairs`.
    reach : three ints (x, y, z)
        Largest steps.
    coarse, coarse_shape, lower, share
        Tensors of the large window at the voxels' x, and where they stand: see :meth:`ppmc.ct.block.Coarse.at`.
    planes, rows : (n,) uint8, (ny,) uint8
        Non-zero for those that are wanted and within the volume; others get no tensor.
    voxels : two ints
        First voxel of a row that is within the volume, and the end.
    noise : (7,) float32
        What to subtract.
    unit : float32
        Mean squared gradient of one unit of grey values per voxel.
    out, channels, out_pitch : (planes * channels * ny * out_pitch,) float32, int, int
        Planes (channels, ny, out_pitch), filled where there are tensors: six components averaged, or seven sums.
    first, last, at_plane : int
        Planes to do, counted as ``planes`` and ``lower`` are, and the plane of ``out`` at which the first goes.
    scores : (planes * ny * out_pitch,) float32, or empty
        Filled there with the least eigenvalues of ``out``.
    chosen, buffers : (pairs + 1,) int64, tuple of arrays
        Place for a list of pairs, and :func:`~ppmc.ct.eigen.scratch` of ``BUFFERS`` rows.
    """
    pitch = shape[1]
    ny = rows.shape[0]
    cz, cy, cx = coarse_shape
    apart, out_apart, far = U(shape[0] * pitch), U(ny * out_pitch), 6 * cx
    scored = scores.shape[0] > 0
    blended, work, large, normals, weight, total = buffers
    # a few rows of a chunk through all planes: what their windows have in common stays in a near cache
    for i in range(voxels[0], voxels[1], CHUNK):
        n = min(CHUNK, voxels[1] - i)
        for j in range(0, ny, ROWS):
            for plane in range(first, last):
                many = 0
                low, high = lower[0][plane] * cy, min(lower[0][plane] + 1, cz - 1) * cy
                for row in range(j, min(j + ROWS, ny)):
                    if planes[plane] > 0 and rows[row] > 0:
                        j0 = lower[1][row]
                        j1 = min(j0 + 1, cy - 1)
                        interpolate(
                            coarse, (low + j0) * far + i, (low + j1) * far + i, (high + j0) * far + i,
                            (high + j1) * far + i, cx, share[1][row], share[0][plane], n, blended,
                        )  # fmt: skip
                        solve(blended, work, large)
                        for m in range(3 * CHUNK):
                            normals[many * 3 * CHUNK + m] = large[R6 + m]
                        many += 1
                if many == 0:
                    continue
                x, y, z, spread = spread_of(normals, N(many), n)
                count = _within(form, x, y, z, spread, chosen)
                many = 0
                for row in range(j, min(j + ROWS, ny)):
                    if rows[row] > 0:
                        middle = (row + reach[1]) * pitch + i + reach[0]
                        _gather(
                            sums, middle, plane_at, plane - first + reach[2], pitch, apart, U(7), steps, form, chosen,
                            count, normals, U(many * 3 * CHUNK), weight, total,
                        )  # fmt: skip
                        _finish(total, work, large, noise, unit, channels == 6)
                        o = U(((at_plane + plane - first) * channels * ny + row) * out_pitch + i)
                        for c in range(U(channels)):
                            for m in range(U(n)):
                                out[o + c * out_apart + m] = total[c * U(CHUNK) + m]
                        if scored:
                            o = U(((at_plane + plane - first) * ny + row) * out_pitch + i)
                            for m in range(U(n)):
                                scores[o + m] = large[m]
                        many += 1
