"""Windows displaced along the platelet normal, which compete with the centred one.

Next to an interface the window for p also sees the neighbouring platelet. Of the windows displaced by up to a few
voxels to either side, the one whose least eigenvalue is smallest is the one least disturbed by another direction; it
wins. Its tensor is that of the voxel in its middle, so nothing is filtered anew. Kernels work on a chunk of voxels
(see :mod:`ppmc.ct.eigen`).
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from ppmc.compile_cache import njit
from ppmc.ct.eigen import CHUNK, R1, R2, R3, R4, R5, R6, R7, R8, inlined, kernel, smallest

U = np.uint64
ZERO, ONE = np.float32(0.0), np.float32(1.0)


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
def score_planes(tensors, first, last, channels, size, scores):
    """Write the least eigenvalue of every tensor of some planes.

    Parameters
    ----------
    tensors : (planes * channels * size,) float32
    first, last : int
        Planes to do.
    channels, size : int
        Channels of a plane, and floats of a channel.
    scores : (planes * size,) float32
        Filled.
    """
    chunk = np.empty(6 * CHUNK, np.float32)
    for i in range(6 * CHUNK):
        chunk[i] = ZERO
    score = np.empty(CHUNK, np.float32)
    for plane in range(first, last):
        for at in range(0, size, CHUNK):
            n = min(CHUNK, size - at)
            load(tensors, plane * channels * size + at, size, 1, n, chunk)
            smallest(chunk, score)
            o = U(plane * size + at)
            for i in range(U(n)):
                scores[o + i] = score[i]


@inlined()
def _aim(normal, inverse_h, aim):
    """Scale normals so that their largest component, counted in voxels, is one: a step moves by whole voxels."""
    hx, hy, hz = inverse_h[0], inverse_h[1], inverse_h[2]
    for i in range(CHUNK):
        x = normal[R6 + i] * hx
        y = normal[R7 + i] * hy
        z = normal[R8 + i] * hz
        scale = ONE / max(abs(x), max(abs(y), abs(z)))
        aim[i] = x * scale
        aim[R1 + i] = y * scale
        aim[R2 + i] = z * scale


@inlined()
def _place(aim, move, x0, step, y, z, nx, ny, nz, pitch, channels, places):
    """Write where the voxels ``move`` steps along the aims stand, within the border: in the scores, in the tensors."""
    fy, fz = np.float32(y), np.float32(z)
    lx, ly, lz = np.float32(nx - 1), np.float32(ny - 1), np.float32(nz - 1)
    for i in range(CHUNK):
        x = np.float32(np.int32(x0) + np.int32(i) * np.int32(step)) + np.rint(move * aim[i])
        row = np.int64(min(max(fy + np.rint(move * aim[R1 + i]), ZERO), ly))
        plane = np.int64(min(max(fz + np.rint(move * aim[R2 + i]), ZERO), lz))
        inside = row * pitch + np.int64(min(max(x, ZERO), lx))
        places[i] = plane * (ny * pitch) + inside
        places[CHUNK + i] = plane * (channels * ny * pitch) + inside


@inlined()
def _take_scores(scores, places, out):
    for i in range(CHUNK):
        out[i] = scores[U(places[i])]


@inlined()
def _take_tensors(tensors, places, apart, out):
    for c in range(6):
        o = U(c * CHUNK)
        shift = U(c * apart)
        for i in range(CHUNK):
            out[o + i] = tensors[U(places[CHUNK + i]) + shift]


@inlined()
def _keep_better(score, places, best_score, best_places):
    for i in range(CHUNK):
        better = score[i] < best_score[i]
        best_places[CHUNK + i] = places[CHUNK + i] if better else best_places[CHUNK + i]
        best_score[i] = score[i] if better else best_score[i]


@kernel()
def choose_side(
    tensors, scores, normal, inverse_h, side_steps, x0, step, y, z, nx, ny, nz, pitch, channels, aim, places,
    best_places, other, score, best_score, best,
):  # fmt: skip
    """Replace tensors of a chunk by those of better displaced windows, and their scores too.

    ``scores`` is empty where the least eigenvalues have not been computed for every voxel.
    """
    _aim(normal, inverse_h, aim)
    _place(aim, ZERO, x0, step, y, z, nx, ny, nz, pitch, channels, best_places)
    for away in range(1, side_steps + 1):
        for side in (-1, 1):
            move = np.float32(side * away)
            _place(aim, move, x0, step, y, z, nx, ny, nz, pitch, channels, places)
            if scores.shape[0] > 0:
                _take_scores(scores, places, score)
            else:
                _take_tensors(tensors, places, ny * pitch, other)
                smallest(other, score)
            _keep_better(score, places, best_score, best_places)
    _take_tensors(tensors, best_places, ny * pitch, best)


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
