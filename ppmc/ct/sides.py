"""Windows displaced along the platelet normal, which stand in for the centred one where they see a purer direction.

Next to an interface the window for p also sees the neighbouring platelet. The windows about the voxels along the
normal, up to a few voxels to either side, are averaged with weights that fall with the fourth power of their least
eigenvalue: the one least disturbed by another direction decides, and equally good ones share. Weights depend smoothly
on eigenvalues and normal, so that no window wins or loses by a rounding error. Their tensors are those of the voxels in
their middle, so nothing is filtered anew. Kernels work on a chunk of voxels (see :mod:`ppmc.ct.eigen`).
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from ppmc.ct.eigen import CHUNK, R1, R2, R3, R4, R5, R6, R7, R8, WORK, solve
from ppmc.ct.passes import entry, kernel
from ppmc.ct.steer import NOWHERE, spread_of

N, U = np.int64, np.uint64  # a literal number would have a kernel compiled for itself
ZERO, ONE = np.float32(0.0), np.float32(1.0)
FLOOR = np.float32(3e-4)
"""Share of the centred window's trace below which least eigenvalues do not count as different."""
TINY = np.float32(1e-30)
BUFFERS = (6, WORK // CHUNK, 9)
"""Rows of the arrays that :func:`score_planes` works on."""


@kernel()
def load(tensors, first, apart, step, n, out):
    """Copy six components, ``apart`` floats apart, of n tensors, ``step`` floats apart, into a chunk."""
    for c in range(out.shape[0] // CHUNK):
        o = U(c * CHUNK)
        a = U(first + c * apart)
        if step == 1:
            for i in range(U(n)):
                out[o + i] = tensors[a + i]
        else:
            for i in range(U(n)):
                out[o + i] = tensors[a + i * U(step)]


@entry()
def score_planes(tensors, planes, first, last, channels, shape, rows, voxels, scores, buffers):
    """Write the least eigenvalue of every tensor of some planes, at least zero.

    Parameters
    ----------
    tensors : (planes * channels * ny * pitch,) float32
    planes : two ints
        First plane within the volume, and the end.
    first, last : int
        Planes to do.
    channels : int
        Channels of a plane.
    shape : two ints
        Rows and pitch of a channel.
    rows, voxels : two ints each
        First row, and first voxel of a row, within the volume, and the ends.
    scores : (planes * ny * pitch,) float32
        Filled.
    buffers : tuple of arrays
        :func:`~ppmc.ct.eigen.scratch` of ``BUFFERS`` rows.
    """
    ny, pitch = shape
    size = ny * pitch
    chunk, work, solved = buffers
    for plane in range(first, last):
        base = plane * size
        for i in range(U(size)):
            scores[U(base) + i] = NOWHERE
        if not planes[0] <= plane < planes[1]:
            continue
        for row in range(rows[0], rows[1]):
            for at in range(voxels[0], voxels[1], CHUNK):
                n = min(CHUNK, voxels[1] - at)
                load(tensors, plane * channels * size + row * pitch + at, size, N(1), n, chunk)
                solve(chunk, work, solved)
                o = U(base + row * pitch + at)
                for i in range(U(n)):
                    there = chunk[i] + chunk[R1 + i] + chunk[R2 + i] > ZERO
                    scores[o + i] = max(solved[i], ZERO) if there else NOWHERE


@kernel()
def _prepare(normal, inverse_h, scores, at, step, best, aim, floor, better, total):
    """Write unit vectors along the normals, counted in voxels, and give the centred windows weight one.

    The floor is a share of their trace; nothing stands in for a window that is not there.
    """
    hx, hy, hz = inverse_h[0], inverse_h[1], inverse_h[2]
    for i in range(CHUNK):
        x = normal[R6 + i] * hx
        y = normal[R7 + i] * hy
        z = normal[R8 + i] * hz
        scale = ONE / np.sqrt(x * x + y * y + z * z)
        aim[i] = x * scale
        aim[R1 + i] = y * scale
        aim[R2 + i] = z * scale
        floor[i] = FLOOR * max(best[i] + best[R1 + i] + best[R2 + i], ZERO) + TINY
        score = scores[at + U(i) * step]
        better[i] = score + floor[i] if score < NOWHERE else ZERO
        total[i] = ONE


@kernel()
def _weigh(aim, x, y, z, inverse_reach, scores, a, b, step, floor, better, one, other, total):
    """Write the weights of two windows, displaced by (x, y, z) and by its opposite.

    They are one on the line along the aim and fall to zero a voxel beside it and ``side_steps + 1`` voxels along it;
    times how much better or worse than the centred windows they are.
    """
    square = x * x + y * y + z * z
    for i in range(CHUNK):
        along = aim[i] * x + aim[R1 + i] * y + aim[R2 + i] * z
        beside = max(ONE - (square - along * along), ZERO)
        share = along * inverse_reach
        share *= share
        weight = beside * beside * max(ONE - share * share, ZERO)
        p = better[i] / (scores[a + U(i) * step] + floor[i])
        q = better[i] / (scores[b + U(i) * step] + floor[i])
        p *= p
        q *= q
        p *= p * weight
        q *= q * weight
        one[i] = p
        other[i] = q
        total[i] += p + q


@kernel()
def _add(tensors, a, b, apart, step, channels, one, other, best):
    """Add two displaced windows; the sum of both is made first, for it must not depend on which is which."""
    for c in range(channels):
        o, shift = c * U(CHUNK), c * apart
        for i in range(U(CHUNK)):
            best[o + i] += one[i] * tensors[a + shift + i * step] + other[i] * tensors[b + shift + i * step]


@kernel()
def blend_sides(
    tensors, scores, normal, inverse_h, side_steps, x, step, n, y, z, ny, pitch, channels, aim, one, other,
    floor, better, total, best,
):  # fmt: skip
    """Blend tensors of a chunk of n voxels with those along their normals.

    Voxels x, x + step, ... of row y of plane z, whose tensors are in ``best``; ``side_steps + 1`` voxels beyond them in
    all directions are read.
    """
    size = ny * pitch
    inside = y * pitch + x
    _prepare(normal, inverse_h, scores, U(z * size + inside), U(step), best, aim, floor, better, total)
    reach = side_steps + 1
    inverse_reach = ONE / np.float32(reach)
    ax, ay, az, spread = spread_of(aim, N(1), n)
    for dz in range(reach + 1):
        for dy in range(-reach if dz > 0 else 0, reach + 1):
            for dx in range(-reach if dz > 0 or dy > 0 else 1, reach + 1):
                # of each offset and its opposite; none further away, or too far beside all aims, can have weight
                square = np.float32(dx * dx + dy * dy + dz * dz)
                middle = abs(ax * np.float32(dx) + ay * np.float32(dy) + az * np.float32(dz))
                along = middle + spread * np.sqrt(square)
                least = middle - spread * np.sqrt(square)
                if square - along * along > ONE or least > np.float32(reach):
                    continue
                a, b = dy * pitch + dx, dz * size
                _weigh(
                    aim, np.float32(dx), np.float32(dy), np.float32(dz), inverse_reach, scores,
                    U((z * size + b) + inside + a), U((z * size - b) + inside - a), U(step), floor, better, one, other,
                    total,
                )  # fmt: skip
                a += inside
                above = U((z + dz) * channels * size + a)
                below = U((z - dz) * channels * size + inside + inside - a)
                _add(tensors, above, below, U(size), U(step), U(6), one, other, best)
    for i in range(CHUNK):
        total[i] = ONE / total[i]
    for c in range(best.shape[0] // CHUNK):
        for i in range(CHUNK):
            best[c * CHUNK + i] *= total[i]


@kernel()
def press_flat(tensor, press, normal):
    """Add to each tensor ``press`` times its normal's dyad: a doubtful p is kept in the platelet's plane."""
    for i in range(CHUNK):
        x, y, z = normal[R6 + i], normal[R7 + i], normal[R8 + i]
        c = press[i]
        tensor[i] += c * x * x
        tensor[R1 + i] += c * y * y
        tensor[R2 + i] += c * z * z
        tensor[R3 + i] += c * x * y
        tensor[R4 + i] += c * y * z
        tensor[R5 + i] += c * x * z
