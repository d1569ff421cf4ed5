"""From structure tensors of a block to p, r and how certain they are.

p is the direction of least gradient in its own small window. Next to an interface that window also sees the
neighbouring platelet; so windows displaced along the normal compete, and the one whose least eigenvalue is smallest,
the one least disturbed by another direction, wins. r comes from a larger window; a doubtful p is kept in the plane
orthogonal to it, and in the end r is made orthogonal to p.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from ppmc.compile_cache import njit
from ppmc.ct.eigen import smallest_row, solve_row

ZERO, ONE, TINY = np.float32(0.0), np.float32(1.0), np.float32(1e-30)
ROUNDING = np.float32(1e-4)
"""Share of the largest eigenvalue below which differences of eigenvalues mean nothing in float32."""
FLATNESS = np.float32(10.0)
"""Penalty on p leaving the plane of r, in units of the least eigenvalue: nothing where p is certain, decisive where
two platelets mix (at 10 the mean tensors of the phantom err by less than half of what they do without)."""
PARALLEL = np.float32(0.05)
"""Sine below which a normal is too close to p to be made orthogonal to it; the small window's normal serves then."""


@njit(nogil=True)
def interpolate_row(coarse, voxel, start, cell, stride, scratch, out):
    """Interpolate a coarse field (cz, cy, 6, cx) linearly at every ``stride``-th voxel of a row.

    ``voxel`` (x, y, z) is the row's first voxel, ``start`` the voxel in the middle of the first cell, ``cell`` the
    distance of cells; all integers, so that a position does not depend on where a block begins.
    """
    cz, cy, cx = coarse.shape[0], coarse.shape[1], coarse.shape[3]
    z = min(max(np.float32(voxel[2] - start[2]) / np.float32(cell[2]), ZERO), np.float32(cz - 1))
    y = min(max(np.float32(voxel[1] - start[1]) / np.float32(cell[1]), ZERO), np.float32(cy - 1))
    k = min(int(z), max(cz - 2, 0))
    j = min(int(y), max(cy - 2, 0))
    k1 = min(k + 1, cz - 1)
    j1 = min(j + 1, cy - 1)
    a = z - np.float32(k)
    b = y - np.float32(j)
    last = np.float32(cx - 1)
    width = np.float32(cell[0])
    for c in range(6):
        low, low1 = coarse[k, j, c], coarse[k, j1, c]
        high, high1 = coarse[k1, j, c], coarse[k1, j1, c]
        for i in range(cx):
            scratch[i] = (ONE - a) * ((ONE - b) * low[i] + b * low1[i]) + a * ((ONE - b) * high[i] + b * high1[i])
        for i in range(out.shape[1]):
            x = min(max(np.float32(voxel[0] + i * stride - start[0]) / width, ZERO), last)
            m = min(int(x), max(cx - 2, 0))
            n = min(m + 1, cx - 1)
            f = x - np.float32(m)
            out[c, i] = (ONE - f) * scratch[m] + f * scratch[n]


@njit(nogil=True)
def _gather_row(tensors, z, y, x0, step, normal, inverse_h, move, out):
    """Copy the tensors that lie ``move`` voxels along the normal; its largest component moves by whole voxels."""
    nz, ny, nx = tensors.shape[0], tensors.shape[1], tensors.shape[3]
    for i in range(out.shape[1]):
        ax = normal[0, i] * inverse_h[0]
        ay = normal[1, i] * inverse_h[1]
        az = normal[2, i] * inverse_h[2]
        scale = move / max(abs(ax), max(abs(ay), abs(az)))
        ix = min(max(x0 + i * step + int(np.rint(scale * ax)), 0), nx - 1)
        iy = min(max(y + int(np.rint(scale * ay)), 0), ny - 1)
        iz = min(max(z + int(np.rint(scale * az)), 0), nz - 1)
        for c in range(6):
            out[c, i] = tensors[iz, iy, c, ix]


@njit(nogil=True)
def _keep_better(score, best_score, tensor, best):
    for i in range(score.shape[0]):
        if score[i] < best_score[i]:
            best_score[i] = score[i]
            for c in range(6):
                best[c, i] = tensor[c, i]


@njit(nogil=True)
def _press_flat_row(tensor, least, normal):
    """Add to each tensor along r what is left of it along p: a doubtful p is kept in the platelet's plane."""
    for i in range(tensor.shape[1]):
        x, y, z = normal[0, i], normal[1, i], normal[2, i]
        press = FLATNESS * max(least[i], ZERO)
        tensor[0, i] += press * x * x
        tensor[1, i] += press * y * y
        tensor[2, i] += press * z * z
        tensor[3, i] += press * x * y
        tensor[4, i] += press * y * z
        tensor[5, i] += press * x * z


@njit(nogil=True)
def _frame_row(small, large, scale, frame):
    """Turn solved rows (9, n) into rows (11, n): p, r, eigenvalues, linearity, planarity; orthonormal by construction.

    One sign for each axis: p towards +x, r towards +z, so that neighbours look alike.
    """
    l1s, l2s, l3s, pxs, pys, pzs, sxs, sys, szs = (
        small[0], small[1], small[2], small[3], small[4], small[5], small[6], small[7], small[8],
    )  # fmt: skip
    m1s, m2s, m3s, rxs, rys, rzs = large[0], large[1], large[2], large[6], large[7], large[8]
    f0, f1, f2, f3, f4, f5 = frame[0], frame[1], frame[2], frame[3], frame[4], frame[5]
    f6, f7, f8, f9, f10 = frame[6], frame[7], frame[8], frame[9], frame[10]
    for i in range(small.shape[1]):
        px, py, pz = pxs[i], pys[i], pzs[i]
        rx, ry, rz = rxs[i], rys[i], rzs[i]
        dot = px * rx + py * ry + pz * rz
        rx -= dot * px
        ry -= dot * py
        rz -= dot * pz
        parallel = rx * rx + ry * ry + rz * rz < PARALLEL * PARALLEL
        rx = sxs[i] if parallel else rx
        ry = sys[i] if parallel else ry
        rz = szs[i] if parallel else rz
        # once more, so that rounding leaves nothing of p
        dot = px * rx + py * ry + pz * rz
        rx -= dot * px
        ry -= dot * py
        rz -= dot * pz
        back_p = (px < ZERO) | ((px == ZERO) & ((py < ZERO) | ((py == ZERO) & (pz < ZERO))))
        back_r = (rz < ZERO) | ((rz == ZERO) & ((ry < ZERO) | ((ry == ZERO) & (rx < ZERO))))
        sign = -ONE if back_p else ONE
        f0[i] = sign * px
        f1[i] = sign * py
        f2[i] = sign * pz
        sign = (-ONE if back_r else ONE) / np.sqrt(rx * rx + ry * ry + rz * rz)
        f3[i] = sign * rx
        f4[i] = sign * ry
        f5[i] = sign * rz
        l1 = max(l1s[i], ZERO)
        l2 = max(l2s[i], ZERO)
        l3 = max(l3s[i], ZERO)
        f6[i] = l1 * scale
        f7[i] = l2 * scale
        f8[i] = l3 * scale
        f9[i] = (l2 - l1) / (l1 + l2 + ROUNDING * l3 + TINY)
        m1 = max(m1s[i], ZERO)
        m2 = max(m2s[i], m1)
        m3 = max(m3s[i], m2)
        f10[i] = (m3 - m2) / (m2 + m3 + TINY)


@njit(nogil=True)
def _store_row(frame, x0, least_energy, least_confidence, fibre, normal, values, confidence, planarity, valid):
    """Copy a row of results to the fields; ``valid`` keeps zeros it has on entry."""
    x0 = np.uint64(x0)
    for i in range(np.uint64(frame.shape[1])):
        o = x0 + i
        for c in range(3):
            fibre[o, c] = frame[c, i]
            normal[o, c] = frame[3 + c, i]
            values[o, c] = frame[6 + c, i]
        confidence[o] = frame[9, i]
        planarity[o] = frame[10, i]
        energetic = frame[6, i] + frame[7, i] + frame[8, i] > least_energy
        valid[o] &= energetic and frame[9, i] >= least_confidence


@njit(nogil=True)
def orient_block(tensors, corner, step, inverse_h, side_steps, coarse, voxel, stride, start, cell, scale, least_energy,
                 least_confidence, place, count, fibre, normal, values, confidence, planarity, valid):  # fmt: skip
    """Turn the tensors of a block into orientations.

    Parameters
    ----------
    tensors : (tz, ty, 6 or 7, tx) float32
        Tensors of the small window, at every voxel if ``stride`` is above 1, else as the outputs, plus a border.
    corner, step : (3,) int64 (x, y, z), int
        Index in ``tensors`` of the first output voxel, and distance of output voxels there.
    inverse_h : (3,) float32
        One over the voxel size.
    side_steps : int
        Windows displaced by up to this many voxels compete.
    coarse : (cz, cy, 6, cx) float32
        Tensors of the large window, or empty to take r from the small one.
    voxel, stride : (3,) int64 (x, y, z), int
        The first output voxel in the volume, and distance of output voxels there.
    start, cell : (3,) int64 (x, y, z)
        Voxel in the middle of the first coarse cell, and distance of cells.
    scale, least_energy, least_confidence : float32
        Unit of the eigenvalues; trace (in that unit) and linearity below which a voxel is invalid.
    place, count : (3,) int64 (x, y, z)
        Where the block's output begins in the fields, and its number of voxels.
    fibre, normal, values : (nz, ny, nx, 3) float32
    confidence, planarity : (nz, ny, nx) float32
    valid : (nz, ny, nx) uint8
        Filled; ``valid`` keeps zeros it has on entry.
    """
    ox, oy, oz = count
    two_scales = coarse.shape[0] > 0
    best = np.empty((6, ox), np.float32)
    other = np.empty((6, ox), np.float32)
    small = np.empty((9, ox), np.float32)
    large = np.empty((9, ox), np.float32)
    frame = np.empty((11, ox), np.float32)
    score = np.empty(ox, np.float32)
    best_score = np.empty(ox, np.float32)
    scratch = np.empty(coarse.shape[3] if two_scales else 1, np.float32)
    here = voxel.copy()
    for k in range(oz):
        z = corner[2] + k * step
        here[2] = voxel[2] + k * stride
        for j in range(oy):
            y = corner[1] + j * step
            here[1] = voxel[1] + j * stride
            for c in range(6):
                row = tensors[z, y, c]
                for i in range(ox):
                    best[c, i] = row[corner[0] + i * step]
            if two_scales:
                interpolate_row(coarse, here, start, cell, stride, scratch, other)
                solve_row(other, large)
            elif side_steps > 0:
                solve_row(best, large)
            if two_scales or side_steps > 0:
                smallest_row(best, best_score)
            if side_steps > 0:
                for away in range(1, side_steps + 1):
                    for side in (-1, 1):
                        move = np.float32(side * away)
                        _gather_row(tensors, z, y, corner[0], step, large[6:], inverse_h, move, other)
                        smallest_row(other, score)
                        _keep_better(score, best_score, other, best)
            if two_scales:
                _press_flat_row(best, best_score, large[6:])
            solve_row(best, small)
            _frame_row(small, large if two_scales or side_steps > 0 else small, scale, frame)
            z1, y1 = place[2] + k, place[1] + j
            _store_row(
                frame, place[0], least_energy, least_confidence, fibre[z1, y1], normal[z1, y1], values[z1, y1],
                confidence[z1, y1], planarity[z1, y1], valid[z1, y1],
            )  # fmt: skip
