"""From tensors to orientations: p, r, and how certain they are.

p is the direction of least gradient in its own small window, or in those least disturbed among several (see
:mod:`ppmc.ct.follow` and :mod:`ppmc.ct.sides`). r comes from a larger window. Where there are platelets, a doubtful p
is kept in the plane orthogonal to it; nothing else pulls p anywhere. In the end r is made orthogonal to p. Kernels work
on a chunk of voxels of a row (see :mod:`ppmc.ct.eigen`).
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from ppmc.ct.eigen import CHUNK, R1, R2, R3, R4, R5, R6, R7, R8, R9, R10, R11, WORK, solve
from ppmc.ct.follow import blend_along, load_packed
from ppmc.ct.passes import entry, kernel
from ppmc.ct.sides import blend_sides, load, press_flat
from ppmc.ct.steer import interpolate

N, U = np.int64, np.uint64  # a literal number would have a kernel compiled for itself
ZERO, ONE, TINY = np.float32(0.0), np.float32(1.0), np.float32(1e-30)
ROUNDING = np.float32(1e-4)
"""Share of the largest eigenvalue below which differences of eigenvalues mean nothing in float32."""
FLATNESS = np.float32(10.0)
"""Penalty on p leaving the plane of r, in units of the least eigenvalue: nothing where p is certain, decisive where
two platelets mix (at 10 the mean tensors of the phantom err by less than half of what they do without)."""
BUFFERS = (6, 6, 9, 9, WORK // CHUNK, 12, 3, 1, 1, 1, 1, 1, 1)
"""Rows of the arrays that :func:`orient_planes` works on."""
DEGREES, RIGHT_ANGLE = np.float32(180.0 / np.pi), np.float32(90.0)
PARALLEL = np.float32(0.05)
"""Sine below which a normal is too close to p to be made orthogonal to it; the small window's normal serves then."""


@kernel()
def _release(small, press, normal):
    """Take the pressure out of the eigenvalues again: mean squared gradients along the axes that were found."""
    for i in range(CHUNK):
        x, y, z = normal[R6 + i], normal[R7 + i], normal[R8 + i]
        a = small[R3 + i] * x + small[R4 + i] * y + small[R5 + i] * z
        b = small[R6 + i] * x + small[R7 + i] * y + small[R8 + i] * z
        l1 = small[i] - press[i] * a * a
        l3 = small[R2 + i] - press[i] * b * b
        l2 = small[R1 + i] - press[i] * max(ONE - a * a - b * b, ZERO)
        low, high = min(l2, l3), max(l2, l3)
        small[i] = min(l1, low)
        small[R1 + i] = max(l1, low)
        small[R2 + i] = high


@kernel()
def _orthogonal(small, large):
    """Make the normals of ``large`` orthogonal to p of ``small``; where they are parallel to it, take ``small``'s."""
    for i in range(CHUNK):
        px, py, pz = small[R3 + i], small[R4 + i], small[R5 + i]
        rx, ry, rz = large[R6 + i], large[R7 + i], large[R8 + i]
        dot = px * rx + py * ry + pz * rz
        rx -= dot * px
        ry -= dot * py
        rz -= dot * pz
        parallel = rx * rx + ry * ry + rz * rz < PARALLEL * PARALLEL
        rx = small[R6 + i] if parallel else rx
        ry = small[R7 + i] if parallel else ry
        rz = small[R8 + i] if parallel else rz
        # once more, so that rounding leaves nothing of p
        dot = px * rx + py * ry + pz * rz
        rx -= dot * px
        ry -= dot * py
        rz -= dot * pz
        norm = ONE / np.sqrt(rx * rx + ry * ry + rz * rz)
        large[R6 + i] = norm * rx
        large[R7 + i] = norm * ry
        large[R8 + i] = norm * rz


@kernel()
def _axes(small, large, frame):
    """Write p and r into rows 0 to 5 of ``frame``, one sign for each axis: p towards +x, r towards +z."""
    for i in range(CHUNK):
        x, y, z = small[R3 + i], small[R4 + i], small[R5 + i]
        lead = y if y != ZERO else z
        lead = x if x != ZERO else lead
        sign = -ONE if lead < ZERO else ONE
        frame[i] = sign * x
        frame[R1 + i] = sign * y
        frame[R2 + i] = sign * z
        x, y, z = large[R6 + i], large[R7 + i], large[R8 + i]
        lead = y if y != ZERO else x
        lead = z if z != ZERO else lead
        sign = -ONE if lead < ZERO else ONE
        frame[R3 + i] = sign * x
        frame[R4 + i] = sign * y
        frame[R5 + i] = sign * z


@kernel()
def _certainty(small, large, scale, samples, frame):
    """Write eigenvalues, linearity of p, planarity of r and predicted error of p into rows 6 to 11 of ``frame``."""
    for i in range(CHUNK):
        l1 = max(small[i], ZERO)
        l2 = max(small[R1 + i], ZERO)
        l3 = max(small[R2 + i], ZERO)
        frame[R6 + i] = l1 * scale
        frame[R7 + i] = l2 * scale
        frame[R8 + i] = l3 * scale
        frame[R9 + i] = (l2 - l1) / (l1 + l2 + ROUNDING * l3 + TINY)
        m2 = max(large[R1 + i], ZERO)
        m3 = max(large[R2 + i], m2)
        frame[R10 + i] = (m3 - m2) / (m2 + m3 + TINY)
        # l1 / (l2 - l1) and its like, guarded by rounding; beyond a right angle an axis cannot err
        a = l2 - l1 + ROUNDING * l3 + TINY
        b = l3 - l1 + ROUNDING * l3 + TINY
        px, py, pz = small[R3 + i], small[R4 + i], small[R5 + i]
        count = samples[0] * (ONE + samples[1] * px * px + samples[2] * py * py + samples[3] * pz * pz)
        error = DEGREES * np.sqrt((l1 * l2 / (a * a) + l1 * l3 / (b * b)) / count)
        frame[R11 + i] = error if error < RIGHT_ANGLE else RIGHT_ANGLE


@kernel()
def _store_vectors(frame, row, out, first, n):
    a = U(row * CHUNK)
    b = U((row + 1) * CHUNK)
    c = U((row + 2) * CHUNK)
    o = U(3 * first)
    for i in range(U(n)):
        out[o + U(3) * i] = frame[a + i]
        out[o + U(3) * i + U(1)] = frame[b + i]
        out[o + U(3) * i + U(2)] = frame[c + i]


@kernel()
def _store_certainty(frame, confidence, planarity, predicted, first, n):
    o = U(first)
    for i in range(U(n)):
        confidence[o + i] = frame[R9 + i]
        planarity[o + i] = frame[R10 + i]
        predicted[o + i] = frame[R11 + i]


@kernel()
def _judge(frame, least_energy, least_confidence, valid, first, n):
    """Clear ``valid`` where there is too little texture or p is too uncertain; zeros on entry stay."""
    o = U(first)
    for i in range(U(n)):
        energy = frame[R6 + i] + frame[R7 + i] + frame[R8 + i]
        good = (energy > least_energy) & (frame[R9 + i] >= least_confidence)
        valid[o + i] = valid[o + i] if good else np.uint8(0)


@entry()
def orient_planes(
    tensors, scores, shape, corner, step, inverse_h, side_steps, along, weights_along, planar, coarse, coarse_shape,
    lower, share, scale, least_energy, least_confidence, samples, out_shape, first, fibre, normal, values, confidence,
    planarity, predicted, valid, buffers,
):  # fmt: skip
    """Turn planes of tensors into orientations.

    Parameters
    ----------
    tensors : (nz * channels * ny * pitch,) float32
        Tensors of the small window; if ``side_steps`` is above 0 at every voxel, up to one more than that outside. If
        windows follow the fibre, as :func:`ppmc.ct.follow.pack_planes` leaves them, up to its ``REACH`` outside.
    scores : (nz * ny * pitch,) float32, or empty
        Their least eigenvalues (see :func:`ppmc.ct.sides.score_planes`); needed if ``side_steps`` is above 0.
    shape : three ints
        ny, pitch, channels of ``tensors``; finite numbers for a further chunk must follow.
    corner, step : (3,) int64 (x, y, z), int
        Index in ``tensors`` of the first output voxel, and distance of output voxels there.
    inverse_h : (3,) float32
        One over the voxel size.
    side_steps : int
        Reach of windows displaced along r, voxels.
    along, weights_along : (3,) float32, (k,) float32
        One step along the fibre in voxels (x, y, z), and the weights of the windows 1 to k steps away; no weights for
        windows that do not follow the fibre.
    planar : bool
        Whether fibres lie in the platelets' plane.
    coarse, coarse_shape : (cz * cy * 6 * ox,) float32, three ints
        Tensors of the large window, in x at the output voxels, and cz, cy, ox; or empty to take r from the small one.
    lower, share : two arrays (z, y) each, int64 and float32
        The coarse plane and row below each output voxel, and the share of the one above.
    scale, least_energy, least_confidence : float32
        Unit of the eigenvalues; trace (in that unit) and linearity below which a voxel is invalid.
    samples : (4,) float32
        Independent gradients that the small window averages, and how many more if p is along x, y or z.
    out_shape : three ints
        Output voxels oz, oy, ox.
    first : int
        Place of the first of them in the fields.
    fibre, normal, values : (3 n,) float32
    confidence, planarity, predicted : (n,) float32
    valid : (n,) uint8
        Filled; ``valid`` keeps zeros it has on entry.
    buffers : tuple of arrays
        :func:`~ppmc.ct.eigen.scratch` of ``BUFFERS`` rows.
    """
    oz, oy, ox = out_shape
    ny, pitch, channels = shape
    cz, cy, cx = coarse_shape
    two_scales = coarse.shape[0] > 0
    follows = weights_along.shape[0] > 0
    best, blended, small, large, work, frame, aim, one, other, floor, better, total, press = buffers
    stretches = (ox + CHUNK - 1) // CHUNK
    for t in range(stretches * oy * oz):
        if follows:
            # stretch by stretch through all planes: the windows that its voxels look at stay in a near cache
            k, j, i = t % oz, t // oz % oy, t // (oz * oy) * CHUNK
        else:
            k, j, i = t // (stretches * oy), t // stretches % oy, t % stretches * CHUNK
        n = min(CHUNK, ox - i)
        x, y, z = corner[0] + i * step, corner[1] + j * step, corner[2] + k * step
        if follows:
            middle = (z * ny + y) * pitch + x
            load_packed(tensors, middle, step, n, best)
            solve(best, work, small)
            blend_along(tensors, middle, step, n, pitch, ny * pitch, small, along, weights_along, best)
        else:
            load(tensors, (z * channels * ny + y) * pitch + x, ny * pitch, step, n, best)
        if two_scales:
            k0, j0 = lower[0][k], lower[1][j]
            k1, j1 = min(k0 + 1, cz - 1), min(j0 + 1, cy - 1)
            plane, plane1, apart = k0 * cy, k1 * cy, 6 * cx
            interpolate(
                coarse, (plane + j0) * apart + i, (plane + j1) * apart + i, (plane1 + j0) * apart + i,
                (plane1 + j1) * apart + i, cx, share[1][j], share[0][k], n, blended,
            )  # fmt: skip
            solve(blended, work, large)
        elif side_steps > 0:
            solve(best, work, large)
        if side_steps > 0:
            blend_sides(
                tensors, scores, large, inverse_h, side_steps, x, step, n, y, z, ny, pitch, channels,
                aim, one, other, floor, better, total, best,
            )  # fmt: skip
        if two_scales and planar:
            solve(best, work, small)
            for m in range(CHUNK):
                press[m] = FLATNESS * max(small[m], ZERO)
            press_flat(best, press, large)
        solve(best, work, small)
        if two_scales and planar:
            _release(small, press, large)
        if two_scales or side_steps > 0:
            _orthogonal(small, large)
            judge_by = large
        else:
            judge_by = small
        _axes(small, judge_by, frame)
        _certainty(small, judge_by, scale, samples, frame)
        o = first + (k * oy + j) * ox + i
        _store_vectors(frame, N(0), fibre, o, n)
        _store_vectors(frame, N(3), normal, o, n)
        _store_vectors(frame, N(6), values, o, n)
        _store_certainty(frame, confidence, planarity, predicted, o, n)
        _judge(frame, least_energy, least_confidence, valid, o, n)
