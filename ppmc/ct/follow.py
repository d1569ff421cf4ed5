"""Windows for p that follow the fibre: a few round windows along it, averaged, the least disturbed counting most.

A round window has to be small, for the next fibre is near, and then holds few gradients. Along the fibre there is room:
nothing changes but the noise. From the direction that its round window sees, each voxel therefore looks at the windows
about the voxels a few steps along it to either side, and averages their tensors with weights that fall with the
distance and with their least eigenvalue, which would be zero were there one direction only: where the fibre ends, bends
or passes another, the windows that see something else hardly count. Their tensors are those of the voxels in their
middle, so nothing is filtered anew. The direction and its opposite take the same voxels, and a step takes the voxel
nearest to it, so a turned or mirrored volume has the same windows. Kernels work on a chunk of voxels of a row (see
:mod:`ppmc.ct.eigen`).
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.eigen import CHUNK, R1, R2, R3, R4, R5, WORK, solve
from ppmc.ct.passes import entry, kernel
from ppmc.ct.sides import FLOOR, TINY, load

N, U = np.int64, np.uint64
ZERO, ONE = np.float32(0.0), np.float32(1.0)
STEP = 4
"""Voxels from window to window along the fibre. Windows overlap: three windows to a side three voxels apart are no
better than two that are four apart."""
STEPS = 2
"""Windows to either side."""
REACH = STEP * STEPS
"""Voxels that windows are looked for at, at most, in any direction."""
PACKED = 8
"""Floats of a voxel in `packed`: six components, the least eigenvalue, and one for whole vectors."""
NOWHERE = np.float32(1e15)
"""Least eigenvalue where there is no tensor; its square is still a number."""
ROUNDER = np.float32(12582912.0)
"""1.5 times 2^23: adding and subtracting it rounds a small number to an integer."""
BUFFERS = (6, WORK // CHUNK, 9)
"""Rows of the arrays that :func:`pack_planes` works on."""


def weights_along() -> NDArray[np.float32]:
    """Return the weights of the windows at 1, 2, ... steps; that in the middle has one."""
    away = np.arange(1, STEPS + 1) / (STEPS + 1)
    return ((1.0 - away**2) ** 2).astype(np.float32)


def variance_along() -> float:
    """Return the variance of the windows' places along the fibre, voxels squared."""
    weights = weights_along().astype(float)
    away = STEP * np.arange(1, STEPS + 1)
    return float(2.0 * (weights * away**2).sum() / (1.0 + 2.0 * weights.sum()))


@entry()
def pack_planes(tensors, channels, planes, count, at_plane, shape, rows, voxels, packed, buffers):
    """Put the tensors of some planes, voxel by voxel, and their least eigenvalues where :func:`blend_along` looks.

    Parameters
    ----------
    tensors : (count * channels * ny * pitch,) float32
    channels : int
        Channels of a plane.
    planes : two ints
        First of ``tensors``' planes within the volume, and the end.
    count, at_plane : int
        Planes to do, and the plane of ``packed`` at which the first goes.
    shape : two ints
        Rows and pitch of a channel.
    rows, voxels : two ints each
        First row, and first voxel of a row, within the volume, and the ends.
    packed : (planes * ny * pitch * PACKED,) float32
        Filled.
    buffers : tuple of arrays
        :func:`~ppmc.ct.eigen.scratch` of ``BUFFERS`` rows.
    """
    ny, pitch = shape
    size = ny * pitch
    chunk, work, solved = buffers
    for plane in range(count):
        base = (at_plane + plane) * size
        for row in range(ny):
            here = planes[0] <= plane < planes[1] and rows[0] <= row < rows[1]
            o = U((base + row * pitch) * PACKED)
            if not here:
                for i in range(U(pitch)):
                    for c in range(U(PACKED)):
                        packed[o + i * U(PACKED) + c] = NOWHERE if c == U(6) else ZERO
                continue
            for at in range(0, pitch, CHUNK):
                n = min(CHUNK, pitch - at)
                load(tensors, plane * channels * size + row * pitch + at, size, N(1), n, chunk)
                solve(chunk, work, solved)
                o = U((base + row * pitch + at) * PACKED)
                for i in range(U(n)):
                    trace = chunk[i] + chunk[U(R1) + i] + chunk[U(R2) + i]
                    inside = (at + i >= voxels[0]) & (at + i < voxels[1]) & (trace > ZERO)
                    a = o + i * U(PACKED)
                    packed[a] = chunk[i]
                    packed[a + U(1)] = chunk[U(R1) + i]
                    packed[a + U(2)] = chunk[U(R2) + i]
                    packed[a + U(3)] = chunk[U(R3) + i]
                    packed[a + U(4)] = chunk[U(R4) + i]
                    packed[a + U(5)] = chunk[U(R5) + i]
                    packed[a + U(6)] = max(solved[i], ZERO) if inside else NOWHERE
                    packed[a + U(7)] = ZERO


@kernel()
def load_packed(packed, first, step, n, out):
    """Copy n packed tensors, ``step`` voxels apart, into a chunk."""
    for i in range(n):
        a = U((first + i * step) * PACKED)
        for c in range(6):
            out[c * CHUNK + i] = packed[a + U(c)]


@kernel()
def blend_along(packed, first, step, n, row, plane, solved, steps, weights, out):
    """Blend tensors of a chunk of n voxels with those along their fibres.

    Parameters
    ----------
    packed : float32 array
        See :func:`pack_planes`; ``REACH`` voxels beyond the chunk's in all directions are read.
    first, step, n : int
        The chunk's first voxel, and the distance and number of its voxels.
    row, plane : int
        Voxels from row to row, and from plane to plane.
    solved : (9 * CHUNK,) float32
        Their eigenvalues and directions p.
    steps : (3,) float32
        One step along each axis (x, y, z), voxels.
    weights : (k,) float32
        Of the windows 1, 2, ... k steps away.
    out : (6 * CHUNK,) float32
        Filled.
    """
    for i in range(n):
        a = (first + i * step) * PACKED
        o = U(a)
        t0, t1, t2 = packed[o], packed[o + U(1)], packed[o + U(2)]
        t3, t4, t5 = packed[o + U(3)], packed[o + U(4)], packed[o + U(5)]
        score = packed[o + U(6)]
        floor = FLOOR * max(t0 + t1 + t2, ZERO) + TINY
        # no other window stands in for one that is not there
        better = score + floor if score < NOWHERE else ZERO
        total = ONE
        x, y, z = solved[R3 + i] * steps[0], solved[R4 + i] * steps[1], solved[R5 + i] * steps[2]
        for k in range(weights.shape[0]):
            far = np.float32(k + 1)
            dx = N((x * far + ROUNDER) - ROUNDER)
            dy = N((y * far + ROUNDER) - ROUNDER)
            dz = N((z * far + ROUNDER) - ROUNDER)
            away = (dz * plane + dy * row + dx) * PACKED
            b, c = U(a + away), U(a - away)
            one, other = packed[b + U(6)] + floor, packed[c + U(6)] + floor
            share = weights[k] * better / (one * other)
            p, q = share * other, share * one
            # the sum of both is made first: it must not depend on which is which
            t0 += p * packed[b] + q * packed[c]
            t1 += p * packed[b + U(1)] + q * packed[c + U(1)]
            t2 += p * packed[b + U(2)] + q * packed[c + U(2)]
            t3 += p * packed[b + U(3)] + q * packed[c + U(3)]
            t4 += p * packed[b + U(4)] + q * packed[c + U(4)]
            t5 += p * packed[b + U(5)] + q * packed[c + U(5)]
            total += p + q
        total = ONE / total
        out[i] = total * t0
        out[R1 + i] = total * t1
        out[R2 + i] = total * t2
        out[R3 + i] = total * t3
        out[R4 + i] = total * t4
        out[R5 + i] = total * t5
