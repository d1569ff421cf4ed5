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

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
ROUNDING = np.float32(1e-4)
"""Share of the largest eigenvalue below which differences of eigenvalues mean nothing in float32."""
FLATNESS = np.float32(10.0)
"""Penalty on p leaving the plane of r, in units of the least eigenvalue: nothing where p is certain, decisive where
two platelets mix (at 10 the mean tensors of the phantom err by less than half of what they do without)."""
PARALLEL = np.float32(0.05)
"""Sine below which a normal is too close to p to be made orthogonal to it; the small window's normal serves then."""


@njit(nogil=True, fastmath={"contract"})
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


@njit(nogil=True, fastmath={"contract"})
def _keep_better(score, best_score, tensor, best):
    for i in range(score.shape[0]):
        if score[i] < best_score[i]:
            best_score[i] = score[i]
            for c in range(6):
                best[c, i] = tensor[c, i]


@njit(nogil=True, fastmath={"contract"})
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
def _frame_row(
    small, large, scale, least_energy, least_confidence, fibre, normal, values, confidence, planarity, valid
):
    """Write the results of one row: frames orthonormal by construction, eigenvalues in the caller's unit."""
    for i in range(small.shape[1]):
        l1 = max(small[0, i], ZERO)
        l2 = max(small[1, i], ZERO)
        l3 = max(small[2, i], ZERO)
        px, py, pz = small[3, i], small[4, i], small[5, i]
        rx, ry, rz = large[6, i], large[7, i], large[8, i]
        dot = px * rx + py * ry + pz * rz
        rx -= dot * px
        ry -= dot * py
        rz -= dot * pz
        length = np.sqrt(rx * rx + ry * ry + rz * rz)
        if length < PARALLEL:
            rx, ry, rz = small[6, i], small[7, i], small[8, i]
            dot = px * rx + py * ry + pz * rz
            rx -= dot * px
            ry -= dot * py
            rz -= dot * pz
            length = np.sqrt(rx * rx + ry * ry + rz * rz)
        # one sign for each axis: p towards +x, r towards +z, so that neighbours look alike
        sign = ONE if px > ZERO or (px == ZERO and (py > ZERO or (py == ZERO and pz >= ZERO))) else -ONE
        fibre[i, 0] = sign * px
        fibre[i, 1] = sign * py
        fibre[i, 2] = sign * pz
        sign = ONE if rz > ZERO or (rz == ZERO and (ry > ZERO or (ry == ZERO and rx >= ZERO))) else -ONE
        sign /= length
        normal[i, 0] = sign * rx
        normal[i, 1] = sign * ry
        normal[i, 2] = sign * rz
        values[i, 0] = l1 * scale
        values[i, 1] = l2 * scale
        values[i, 2] = l3 * scale
        linear = (l2 - l1) / (l1 + l2 + ROUNDING * l3) if l3 > ZERO else ZERO
        confidence[i] = linear
        m1 = max(large[0, i], ZERO)
        m2 = max(large[1, i], m1)
        m3 = max(large[2, i], m2)
        planarity[i] = (m3 - m2) / (m2 + m3) if m3 > ZERO else ZERO
        valid[i] = 1 if l1 + l2 + l3 > least_energy and linear >= least_confidence else 0


@njit(nogil=True)
def orient_block(tensors, corner, step, inverse_h, side_steps, coarse, voxel, stride, start, cell, scale, least_energy,
                 least_confidence, fibre, normal, values, confidence, planarity, valid):  # fmt: skip
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
        Unit of the eigenvalues; trace and linearity below which a voxel is invalid.
    fibre, normal, values : (oz, oy, ox, 3) float32
    confidence, planarity : (oz, oy, ox) float32
    valid : (oz, oy, ox) uint8
        Filled; ``valid`` keeps zeros it has on entry.
    """
    oz, oy, ox = valid.shape
    two_scales = coarse.shape[0] > 0
    best = np.empty((6, ox), np.float32)
    other = np.empty((6, ox), np.float32)
    small = np.empty((9, ox), np.float32)
    large = np.empty((9, ox), np.float32)
    score = np.empty(ox, np.float32)
    best_score = np.empty(ox, np.float32)
    ok = np.empty(ox, np.uint8)
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
            if not two_scales and side_steps == 0:
                large[:, :] = small
            _frame_row(
                small, large, scale, least_energy, least_confidence, fibre[k, j], normal[k, j], values[k, j],
                confidence[k, j], planarity[k, j], ok,
            )  # fmt: skip
            for i in range(ox):
                valid[k, j, i] &= ok[i]
