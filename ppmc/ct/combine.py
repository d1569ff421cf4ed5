"""From structure tensors of a block to p, r and how certain they are.

p is the direction of least gradient in its own small window. Next to an interface that window also sees the
neighbouring platelet; so windows displaced along the normal compete, and the one whose least eigenvalue is smallest,
the one least disturbed by another direction, wins. r comes from a larger window; a doubtful p is kept in the plane
orthogonal to it, and in the end r is made orthogonal to p.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from functools import partial

import numpy as np

from ppmc.compile_cache import njit
from ppmc.ct.eigen import smallest_row, solve_row

U = np.uint64
kernel = partial(njit, nogil=True, no_cpython_wrapper=True)
"""Decorator of kernels that only kernels call: without the wrapper for Python they compile sooner."""
ZERO, ONE, TINY = np.float32(0.0), np.float32(1.0), np.float32(1e-30)
ROUNDING = np.float32(1e-4)
"""Share of the largest eigenvalue below which differences of eigenvalues mean nothing in float32."""
FLATNESS = np.float32(10.0)
"""Penalty on p leaving the plane of r, in units of the least eigenvalue: nothing where p is certain, decisive where
two platelets mix (at 10 the mean tensors of the phantom err by less than half of what they do without)."""
DEGREES, RIGHT_ANGLE = np.float32(180.0 / np.pi), np.float32(90.0)
PARALLEL = np.float32(0.05)
"""Sine below which a normal is too close to p to be made orthogonal to it; the small window's normal serves then."""


@kernel()
def _cells_of_row(first, stride, start, cell, cells, count):
    """Return the lower cell of every ``stride``-th voxel from ``first`` on, and the share of the upper one.

    All from integers, so that a position does not depend on where a block begins.
    """
    lower = np.empty(count, np.uint64)
    share = np.empty(count, np.float32)
    for i in range(count):
        beyond = max(first + i * stride - start, 0)
        below = beyond // cell
        inside = below < cells - 1
        lower[i] = below if inside else max(cells - 2, 0)
        share[i] = np.float32(beyond % cell) / np.float32(cell) if inside else np.float32(cells > 1)
    return lower, share


@kernel()
def interpolate_row(coarse, k, a, j, b, lower, share, scratch, out):
    """Interpolate a coarse field (cz, cy, 6, cx) linearly along a row.

    Between planes k and k + 1 with share ``a`` of the latter, likewise rows j and cells ``lower``.
    """
    cz, cy, cx = coarse.shape[0], coarse.shape[1], coarse.shape[3]
    k1, j1, next_ = min(k + U(1), U(cz - 1)), min(j + U(1), U(cy - 1)), U(1 if cx > 1 else 0)
    for c in range(6):
        low, low1 = coarse[k, j, c], coarse[k, j1, c]
        high, high1 = coarse[k1, j, c], coarse[k1, j1, c]
        for i in range(cx):
            scratch[i] = (ONE - a) * ((ONE - b) * low[i] + b * low1[i]) + a * ((ONE - b) * high[i] + b * high1[i])
        n = U(lower.shape[0])
        o = U(c) * n
        for i in range(n):
            m = lower[i]
            out[o + i] = (ONE - share[i]) * scratch[m] + share[i] * scratch[m + next_]


@kernel()
def _copy_row(row, first, step, out):
    for i in range(U(out.shape[0])):
        out[i] = row[U(first) + i * U(step)]


@kernel()
def _aim_row(normal, inverse_h, ax, ay, az):
    """Scale normals so that their largest component, counted in voxels, is one: a step moves by whole voxels."""
    n = U(ax.shape[0])
    hx, hy, hz = inverse_h[0], inverse_h[1], inverse_h[2]
    for i in range(n):
        x = normal[i] * hx
        y = normal[n + i] * hy
        z = normal[U(2) * n + i] * hz
        scale = ONE / max(abs(x), max(abs(y), abs(z)))
        ax[i] = x * scale
        ay[i] = y * scale
        az[i] = z * scale


@kernel()
def _place_row(ax, ay, az, move, x0, step, y, z, nx, ny, nz, width, places):
    """Write where in the flat tensors the voxels ``move`` steps along the aims stand; not beyond the border."""
    fy, fz = np.float32(y), np.float32(z)
    lx, ly, lz = np.float32(nx - 1), np.float32(ny - 1), np.float32(nz - 1)
    for i in range(U(ax.shape[0])):
        x = np.float32(np.int32(x0) + np.int32(i) * np.int32(step)) + np.rint(move * ax[i])
        row = min(max(fy + np.rint(move * ay[i]), ZERO), ly)
        plane = min(max(fz + np.rint(move * az[i]), ZERO), lz)
        x = min(max(x, ZERO), lx)
        places[i] = (np.int64(plane) * ny + np.int64(row)) * width + np.int64(x)


@kernel()
def _take_row(tensors, places, nx, out):
    """Copy the six components of the tensors at ``places``, which are ``nx`` apart."""
    n = U(places.shape[0])
    for c in range(6):
        o = U(c) * n
        shift = U(c * nx)
        for i in range(n):
            out[o + i] = tensors[U(places[i]) + shift]


@kernel()
def _keep_better(score, best_score, tensor, best):
    n = U(score.shape[0])
    for c in range(6):
        o = U(c) * n
        for i in range(n):
            best[o + i] = tensor[o + i] if score[i] < best_score[i] else best[o + i]
    for i in range(n):
        best_score[i] = min(score[i], best_score[i])


@kernel()
def _press_flat_row(tensor, press, normal):
    """Add to each tensor ``press`` times its normal's dyad: a doubtful p is kept in the platelet's plane."""
    n = U(press.shape[0])
    for i in range(n):
        x, y, z = normal[i], normal[n + i], normal[U(2) * n + i]
        c = press[i]
        tensor[i] += c * x * x
        tensor[n + i] += c * y * y
        tensor[U(2) * n + i] += c * z * z
        tensor[U(3) * n + i] += c * x * y
        tensor[U(4) * n + i] += c * y * z
        tensor[U(5) * n + i] += c * x * z


@kernel()
def _release_row(small, press, normal):
    """Take the pressure out of the eigenvalues again: mean squared gradients along the axes that were found."""
    n = U(press.shape[0])
    n2, n3, n4, n5, n6, n7, n8 = U(2) * n, U(3) * n, U(4) * n, U(5) * n, U(6) * n, U(7) * n, U(8) * n
    for i in range(n):
        x, y, z = normal[i], normal[n + i], normal[n2 + i]
        a = small[n3 + i] * x + small[n4 + i] * y + small[n5 + i] * z
        b = small[n6 + i] * x + small[n7 + i] * y + small[n8 + i] * z
        l1 = small[i] - press[i] * a * a
        l3 = small[n2 + i] - press[i] * b * b
        l2 = small[n + i] - press[i] * max(ONE - a * a - b * b, ZERO)
        low, high = min(l2, l3), max(l2, l3)
        small[i] = min(l1, low)
        small[n + i] = max(l1, low)
        small[n2 + i] = high


@kernel()
def _axis_row(row, first, lead_order, out, o):
    """Copy unit vectors from component ``first`` of a row on, the leading component that is not zero made positive."""
    n = U(row.shape[0] // 9)
    x, y, z = U(first) * n, U(first + 1) * n, U(first + 2) * n
    a, b, c = (x, y, z) if lead_order > 0 else (z, y, x)
    ox, oy, oz = U(o) * n, U(o + 1) * n, U(o + 2) * n
    for i in range(n):
        lead = row[b + i] if row[b + i] != ZERO else row[c + i]
        lead = row[a + i] if row[a + i] != ZERO else lead
        sign = -ONE if lead < ZERO else ONE
        out[ox + i] = sign * row[x + i]
        out[oy + i] = sign * row[y + i]
        out[oz + i] = sign * row[z + i]


@kernel()
def _orthogonal_row(small, large):
    """Make the normals of ``large`` orthogonal to p of ``small``; where they are parallel to it, take ``small``'s."""
    n = U(small.shape[0] // 9)
    n3, n4, n5, n6, n7, n8 = U(3) * n, U(4) * n, U(5) * n, U(6) * n, U(7) * n, U(8) * n
    for i in range(n):
        px, py, pz = small[n3 + i], small[n4 + i], small[n5 + i]
        rx, ry, rz = large[n6 + i], large[n7 + i], large[n8 + i]
        sx, sy, sz = small[n6 + i], small[n7 + i], small[n8 + i]
        dot = px * rx + py * ry + pz * rz
        rx -= dot * px
        ry -= dot * py
        rz -= dot * pz
        parallel = rx * rx + ry * ry + rz * rz < PARALLEL * PARALLEL
        rx = sx if parallel else rx
        ry = sy if parallel else ry
        rz = sz if parallel else rz
        # once more, so that rounding leaves nothing of p
        dot = px * rx + py * ry + pz * rz
        rx -= dot * px
        ry -= dot * py
        rz -= dot * pz
        norm = ONE / np.sqrt(rx * rx + ry * ry + rz * rz)
        large[n6 + i] = norm * rx
        large[n7 + i] = norm * ry
        large[n8 + i] = norm * rz


@kernel()
def _certainty_row(small, large, scale, samples, out):
    """Write eigenvalues, linearity of p, planarity of r and predicted error of p into rows 6 to 11 of ``out``."""
    n = U(small.shape[0] // 9)
    n2, n6, n7, n8 = U(2) * n, U(6) * n, U(7) * n, U(8) * n
    n3, n4, n5, n9, n10, n11 = U(3) * n, U(4) * n, U(5) * n, U(9) * n, U(10) * n, U(11) * n
    for i in range(n):
        l1 = max(small[i], ZERO)
        l2 = max(small[n + i], ZERO)
        l3 = max(small[n2 + i], ZERO)
        out[n6 + i] = l1 * scale
        out[n7 + i] = l2 * scale
        out[n8 + i] = l3 * scale
        out[n9 + i] = (l2 - l1) / (l1 + l2 + ROUNDING * l3 + TINY)
        m2 = max(large[n + i], ZERO)
        m3 = max(large[n2 + i], m2)
        out[n10 + i] = (m3 - m2) / (m2 + m3 + TINY)
        # l1 / (l2 - l1) and its like, guarded by rounding; beyond a right angle an axis cannot err
        a = l2 - l1 + ROUNDING * l3 + TINY
        b = l3 - l1 + ROUNDING * l3 + TINY
        px, py, pz = small[n3 + i], small[n4 + i], small[n5 + i]
        count = samples[0] * (ONE + samples[1] * px * px + samples[2] * py * py + samples[3] * pz * pz)
        error = DEGREES * np.sqrt((l1 * l2 / (a * a) + l1 * l3 / (b * b)) / count)
        out[n11 + i] = error if error < RIGHT_ANGLE else RIGHT_ANGLE


@kernel()
def _store_row(frame, least_energy, least_confidence, fibre, normal, values, confidence, planarity, predicted, valid):
    """Copy a row of results to the fields; ``valid`` keeps zeros it has on entry."""
    n = U(frame.shape[0] // 12)
    for i in range(n):
        for c in range(3):
            fibre[i, c] = frame[U(c) * n + i]
            normal[i, c] = frame[U(3 + c) * n + i]
            values[i, c] = frame[U(6 + c) * n + i]
        confidence[i] = frame[U(9) * n + i]
        planarity[i] = frame[U(10) * n + i]
        predicted[i] = frame[U(11) * n + i]
        energetic = frame[U(6) * n + i] + frame[U(7) * n + i] + frame[U(8) * n + i] > least_energy
        valid[i] &= energetic and frame[U(9) * n + i] >= least_confidence


@njit(nogil=True)
def orient_block(
    tensors, flat, corner, step, inverse_h, side_steps, coarse, voxel, stride, start, cell, scale, least_energy,
    least_confidence, samples, fibre, normal, values, confidence, planarity, predicted, valid,
):  # fmt: skip
    """Turn the tensors of a block into orientations.

    Parameters
    ----------
    tensors, flat : (tz, ty, 6 or 7, tx) float32
        Tensors of the small window, at every voxel if ``stride`` is above 1, else as the outputs, plus a border;
        once as they are and once flat.
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
    samples : (4,) float32
        Independent gradients that the small window averages, and how many more if p is along x, y or z.
    fibre, normal, values : (oz, oy, ox, 3) float32
    confidence, planarity, predicted : (oz, oy, ox) float32
    valid : (oz, oy, ox) uint8
        Filled; ``valid`` keeps zeros it has on entry.
    """
    oz, oy, ox = valid.shape
    two_scales = coarse.shape[0] > 0
    best = np.empty(6 * ox, np.float32)
    other = np.empty(6 * ox, np.float32)
    small = np.empty(9 * ox, np.float32)
    large = np.empty(9 * ox, np.float32)
    normal_row = large[6 * ox :]
    ax = np.empty(ox, np.float32)
    ay = np.empty(ox, np.float32)
    az = np.empty(ox, np.float32)
    places = np.empty(ox, np.int64)
    nz, ny, channels, nx = tensors.shape
    frame = np.empty(12 * ox, np.float32)
    score = np.empty(ox, np.float32)
    best_score = np.empty(ox, np.float32)
    scratch = np.empty(coarse.shape[3] if two_scales else 1, np.float32)
    at_z, share_z = _cells_of_row(voxel[2], stride, start[2], cell[2], coarse.shape[0], oz)
    at_y, share_y = _cells_of_row(voxel[1], stride, start[1], cell[1], coarse.shape[1], oy)
    at_x, share_x = _cells_of_row(voxel[0], stride, start[0], cell[0], coarse.shape[3], ox)
    for k in range(oz):
        z = corner[2] + k * step
        for j in range(oy):
            y = corner[1] + j * step
            for c in range(6):
                _copy_row(tensors[z, y, c], corner[0], step, best[c * ox : (c + 1) * ox])
            if two_scales:
                interpolate_row(coarse, at_z[k], share_z[k], at_y[j], share_y[j], at_x, share_x, scratch, other)
                solve_row(other, large)
            elif side_steps > 0:
                solve_row(best, large)
            if two_scales or side_steps > 0:
                smallest_row(best, best_score)
            if side_steps > 0:
                _aim_row(normal_row, inverse_h, ax, ay, az)
                for away in range(1, side_steps + 1):
                    for side in (-1, 1):
                        move = np.float32(side * away)
                        _place_row(ax, ay, az, move, corner[0], step, y, z, nx, ny, nz, channels * nx, places)
                        _take_row(flat, places, nx, other)
                        smallest_row(other, score)
                        _keep_better(score, best_score, other, best)
            if two_scales:
                for i in range(ox):
                    best_score[i] = FLATNESS * max(best_score[i], ZERO)
                _press_flat_row(best, best_score, normal_row)
            solve_row(best, small)
            if two_scales:
                _release_row(small, best_score, normal_row)
            if two_scales or side_steps > 0:
                _orthogonal_row(small, large)
            else:
                _copy_row(small, 0, 1, large)
            # one sign for each axis: p towards +x, r towards +z, so that neighbours look alike
            _axis_row(small, 3, 1, frame, 0)
            _axis_row(large, 6, -1, frame, 3)
            _certainty_row(small, large, scale, samples, frame)
            _store_row(
                frame, least_energy, least_confidence, fibre[k, j], normal[k, j], values[k, j], confidence[k, j],
                planarity[k, j], predicted[k, j], valid[k, j],
            )  # fmt: skip
