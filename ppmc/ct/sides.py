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

from ppmc.compile_cache import njit
from ppmc.ct.eigen import CHUNK, R1, R2, R3, R4, R5, R6, R7, R8, inlined, kernel, smallest

U = np.uint64
ZERO, ONE = np.float32(0.0), np.float32(1.0)
FLOOR = np.float32(1e-4)
"""Share of the centred window's trace below which least eigenvalues do not count as different."""
NOWHERE = np.float32(1e30)
"""Score where there is no tensor: outside the volume or the mask."""
TINY = np.float32(1e-30)


@kernel()
def load(tensors, first, apart, step, n, out):
    """Copy six components, ``apart`` floats apart, of n tensors, ``step`` floats apart, into a chunk."""
    for c in range(6):
        o = U(c * CHUNK)
        a = U(first + c * apart)
        if step == 1:
            for i in range(U(n)):
                out[o + i] = tensors[a + i]
        else:
            for i in range(U(n)):
                out[o + i] = tensors[a + i * U(step)]


@njit(nogil=True)
def score_planes(tensors, planes, first, last, channels, shape, rows, voxels, scores):
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
    """
    ny, pitch = shape
    size = ny * pitch
    chunk = np.zeros(6 * CHUNK, np.float32)
    score = np.empty(CHUNK, np.float32)
    for plane in range(first, last):
        base = plane * size
        for i in range(U(size)):
            scores[U(base) + i] = NOWHERE
        if not planes[0] <= plane < planes[1]:
            continue
        for row in range(rows[0], rows[1]):
            for at in range(voxels[0], voxels[1], CHUNK):
                n = min(CHUNK, voxels[1] - at)
                load(tensors, plane * channels * size + row * pitch + at, size, 1, n, chunk)
                smallest(chunk, score)
                o = U(base + row * pitch + at)
                for i in range(U(n)):
                    there = chunk[i] + chunk[R1 + i] + chunk[R2 + i] > ZERO
                    scores[o + i] = max(score[i], ZERO) if there else NOWHERE


@inlined()
def _start(tensors, scores, at, score_at, apart, step, floor, better, total, best):
    """Take the centred windows with weight one; the floor is a share of their trace."""
    for c in range(U(6)):
        o, a = c * U(CHUNK), at + c * apart
        for i in range(U(CHUNK)):
            best[o + i] = tensors[a + i * step]
    for i in range(CHUNK):
        floor[i] = FLOOR * max(best[i] + best[R1 + i] + best[R2 + i], ZERO) + TINY
        better[i] = scores[score_at + U(i) * step] + floor[i]
        total[i] = ONE


@inlined()
def _tube(aim, x, y, z, inverse_reach, weight):
    """Write the weights of an offset for a chunk: one on the line along the aim, falling to zero a voxel beside it
    and ``side_steps + 1`` voxels along it. Return the largest."""
    square = x * x + y * y + z * z
    largest = ZERO
    for i in range(CHUNK):
        along = aim[i] * x + aim[R1 + i] * y + aim[R2 + i] * z
        beside = max(ONE - (square - along * along), ZERO)
        share = along * inverse_reach
        share *= share
        w = beside * beside * max(ONE - share * share, ZERO)
        weight[i] = w
        largest = max(largest, w)
    return largest


@inlined()
def _add(tensors, scores, at, score_at, apart, step, floor, better, weight, part, total, best):
    """Add displaced windows, weighted by how much better or worse than the centred ones they are."""
    for i in range(CHUNK):
        ratio = better[i] / (scores[score_at + U(i) * step] + floor[i])
        ratio *= ratio
        w = weight[i] * ratio * ratio
        part[i] = w
        total[i] += w
    for c in range(U(6)):
        o, a = c * U(CHUNK), at + c * apart
        for i in range(U(CHUNK)):
            best[o + i] += part[i] * tensors[a + i * step]


@inlined()
def _aim(normal, inverse_h, aim):
    """Write unit vectors along the normals, counted in voxels."""
    hx, hy, hz = inverse_h[0], inverse_h[1], inverse_h[2]
    for i in range(CHUNK):
        x = normal[R6 + i] * hx
        y = normal[R7 + i] * hy
        z = normal[R8 + i] * hz
        scale = ONE / np.sqrt(x * x + y * y + z * z)
        aim[i] = x * scale
        aim[R1 + i] = y * scale
        aim[R2 + i] = z * scale


@kernel()
def blend_sides(
    tensors, scores, normal, inverse_h, side_steps, x, step, y, z, ny, pitch, channels, aim, weight, part, floor,
    better, total, best,
):  # fmt: skip
    """Write tensors of a chunk of voxels, blended with those along their normals.

    Voxels x, x + step, ... of row y of plane z; ``side_steps + 1`` voxels beyond them in all directions are read.
    """
    _aim(normal, inverse_h, aim)
    size = ny * pitch
    inside = y * pitch + x
    _start(
        tensors, scores, U(z * channels * size + inside), U(z * size + inside), U(size), U(step), floor, better,
        total, best,
    )  # fmt: skip
    reach = side_steps + 1
    inverse_reach = ONE / np.float32(reach)
    for dz in range(reach + 1):
        for dy in range(-reach if dz > 0 else 0, reach + 1):
            for dx in range(-reach if dz > 0 or dy > 0 else 1, reach + 1):
                # of each offset and its opposite; none further away can have weight
                if dx * dx + dy * dy + dz * dz > reach * reach + 1:
                    continue
                largest = _tube(aim, np.float32(dx), np.float32(dy), np.float32(dz), inverse_reach, weight)
                if largest > ZERO:
                    for side in (-1, 1):
                        there = inside + side * (dy * pitch + dx)
                        plane = z + side * dz
                        _add(
                            tensors, scores, U(plane * channels * size + there), U(plane * size + there), U(size),
                            U(step), floor, better, weight, part, total, best,
                        )  # fmt: skip
    for i in range(CHUNK):
        total[i] = ONE / total[i]
    for c in range(6):
        for i in range(CHUNK):
            best[c * CHUNK + i] *= total[i]


@inlined()
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
