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

from ppmc.ct.eigen import CHUNK, R1, R2, R3, R4, R5
from ppmc.ct.passes import kernel
from ppmc.ct.sides import FLOOR, TINY
from ppmc.ct.steer import NOWHERE

U = np.uint64
ZERO, ONE = np.float32(0.0), np.float32(1.0)
STEP = 3
"""Voxels from window to window along the fibre: windows of one and a half voxels and more leave no gap."""
STEPS = 3
"""Windows to either side."""
REACH = STEP * STEPS
"""Voxels that windows are looked for at, at most, in any direction."""
ROUNDER = np.float32(12582912.0)
"""1.5 times 2^23: adding and subtracting it rounds a small number to an integer, without a call that would keep loops
from vectorising."""


def weights_along() -> NDArray[np.float32]:
    """Return the weights of the windows at 1, 2, ... steps; that in the middle has one."""
    away = np.arange(1, STEPS + 1) / (STEPS + 1)
    return ((1.0 - away**2) ** 2).astype(np.float32)


def variance_along() -> float:
    """Return the variance of the windows' places along the fibre, voxels squared."""
    weights = weights_along().astype(float)
    away = STEP * np.arange(1, STEPS + 1)
    return float(2.0 * (weights * away**2).sum() / (1.0 + 2.0 * weights.sum()))


@kernel()
def _places(small, reach, x_step, y_step, z_step, row, plane, wide, there, scored):
    """Write how far away, in floats, the windows at a distance are in tensors and scores."""
    for i in range(CHUNK):
        x = (small[R3 + i] * (reach * x_step) + ROUNDER) - ROUNDER
        y = (small[R4 + i] * (reach * y_step) + ROUNDER) - ROUNDER
        z = (small[R5 + i] * (reach * z_step) + ROUNDER) - ROUNDER
        inside = np.int64(y) * row + np.int64(x)
        there[i] = np.int64(z) * wide + inside
        scored[i] = np.int64(z) * plane + inside


@kernel()
def _weigh(scores, at, step, scored, weight, floor, better, one, other, total):
    """Write the weights of the windows there and at the opposite places."""
    for i in range(CHUNK):
        here = at + i * step
        p = weight * better[i] / (scores[U(here + scored[i])] + floor[i])
        q = weight * better[i] / (scores[U(here - scored[i])] + floor[i])
        one[i] = p
        other[i] = q
        total[i] += p + q


@kernel()
def blend_along(
    tensors, scores, small, steps, weights, x, step, n, y, z, ny, pitch, channels, there, scored, one, other, floor,
    better, total, best,
):  # fmt: skip
    """Blend tensors of a chunk of n voxels with those along their fibres.

    Voxels x, x + step, ... of row y of plane z, whose tensors are in ``best`` and solved in ``small``; ``REACH`` voxels
    beyond them in all directions are read. ``steps`` (x, y, z) is one step along each axis, in voxels.
    """
    size = ny * pitch
    first = (z * channels * ny + y) * pitch + x
    at = z * size + y * pitch + x
    for i in range(CHUNK):
        floor[i] = FLOOR * max(best[i] + best[R1 + i] + best[R2 + i], ZERO) + TINY
        score = scores[U(at + i * step)] if i < n else NOWHERE
        # no other window stands in for one that is not there
        better[i] = score + floor[i] if score < NOWHERE else ZERO
        total[i] = ONE
        for c in range(3):
            # chunks end beyond rows; what is made of the rest is never used, but must be within the arrays
            small[R3 + c * CHUNK + i] = small[R3 + c * CHUNK + i] if i < n else ZERO
    for k in range(weights.shape[0]):
        reach = np.float32(k + 1)
        _places(small, reach, steps[0], steps[1], steps[2], pitch, size, channels * size, there, scored)
        _weigh(scores, at, step, scored, weights[k], floor, better, one, other, total)
        for c in range(best.shape[0] // CHUNK):
            o, a = c * CHUNK, first + c * size
            for i in range(CHUNK):
                here = a + i * step
                best[o + i] += one[i] * tensors[U(here + there[i])] + other[i] * tensors[U(here - there[i])]
    for i in range(CHUNK):
        total[i] = ONE / total[i]
    for c in range(best.shape[0] // CHUNK):
        for i in range(CHUNK):
            best[c * CHUNK + i] *= total[i]
