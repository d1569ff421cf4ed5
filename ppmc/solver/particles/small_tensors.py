"""Inverse and eigenvectors of small symmetric matrices in kernels."""

# mypy: disable-error-code="no-untyped-def"

import math

from ppmc.compile_cache import njit

MOST_SWEEPS = 12  # of Jacobi rotations; four or five do


@njit(cache=True)
def symmetric_eigenvalues(a, b, c, d, e, f):
    """Smallest and largest eigenvalue of the symmetric matrix XX, YY, ZZ, XY, YZ, XZ (trigonometric formula)."""
    mean = (a + b + c) / 3.0
    p = math.sqrt(((a - mean) ** 2 + (b - mean) ** 2 + (c - mean) ** 2 + 2.0 * (d * d + e * e + f * f)) / 6.0)
    if p < 1e-14 * abs(mean) or p == 0.0:
        return mean, mean
    aa, bb, cc, dd, ee, ff = (a - mean) / p, (b - mean) / p, (c - mean) / p, d / p, e / p, f / p
    half_det = 0.5 * (aa * (bb * cc - ee * ee) - dd * (dd * cc - ee * ff) + ff * (dd * ee - bb * ff))
    angle = math.acos(min(1.0, max(-1.0, half_det))) / 3.0
    return mean + 2.0 * p * math.cos(angle + 2.0 * math.pi / 3.0), mean + 2.0 * p * math.cos(angle)


@njit(cache=True)
def unpack(six, out):
    """Write the symmetric matrix XX, YY, ZZ, XY, YZ, XZ (6,) to `out` (3, 3)."""
    out[0, 0], out[1, 1], out[2, 2] = six[0], six[1], six[2]
    out[0, 1] = out[1, 0] = six[3]
    out[1, 2] = out[2, 1] = six[4]
    out[0, 2] = out[2, 0] = six[5]


@njit(cache=True)
def diagonalise(t, vectors):
    """Turn the symmetric 3x3 matrix `t` into a diagonal one by Jacobi rotations; columns of `vectors` are its axes."""
    for a in range(3):
        for b in range(3):
            vectors[a, b] = 1.0 if a == b else 0.0
    for _ in range(MOST_SWEEPS):
        off = abs(t[0, 1]) + abs(t[1, 2]) + abs(t[0, 2])
        if off <= 1e-300 + 1e-17 * (abs(t[0, 0]) + abs(t[1, 1]) + abs(t[2, 2])):
            break
        for turn in range(3):
            a, b = (0, 1) if turn == 0 else (0, 2) if turn == 1 else (1, 2)
            if t[a, b] == 0.0:
                continue
            half = 0.5 * (t[b, b] - t[a, a]) / t[a, b]
            tangent = (1.0 if half >= 0.0 else -1.0) / (abs(half) + math.sqrt(half * half + 1.0))
            cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
            sine, c = tangent * cosine, 3 - a - b
            t[a, a] -= tangent * t[a, b]
            t[b, b] += tangent * t[a, b]
            t[a, b] = t[b, a] = 0.0
            t[a, c], t[b, c] = cosine * t[a, c] - sine * t[b, c], sine * t[a, c] + cosine * t[b, c]
            t[c, a], t[c, b] = t[a, c], t[b, c]
            for k in range(3):
                va, vb = vectors[k, a], vectors[k, b]
                vectors[k, a], vectors[k, b] = cosine * va - sine * vb, sine * va + cosine * vb


@njit(cache=True, inline="always")
def _write_inverse(a, b, c, d, e, f, x, y, z, determinant, out):
    # Of the symmetric matrix with diagonal a, b, c and 01, 12, 02 = d, e, f; x, y, z are its first row of cofactors.
    inverse_det = 1.0 / determinant
    out[0, 0] = x * inverse_det
    out[0, 1] = y * inverse_det
    out[0, 2] = z * inverse_det
    out[1, 0] = out[0, 1]
    out[1, 1] = (a * c - f * f) * inverse_det
    out[1, 2] = (f * d - a * e) * inverse_det
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]
    out[2, 2] = (a * b - d * d) * inverse_det


@njit(cache=True)
def invert_symmetric(m, floor, out):
    """Write the inverse of a symmetric positive 3x3 matrix to `out`.

    If its smallest eigenvalue is below `floor` times its largest, the identity times the missing amount is added first:
    a particle whose neighbours lie in a plane or on a line has no gradient across them. A well-conditioned matrix is
    left alone to the last bit, for even a thousandth of it would break the exactness under rigid rotation.
    """
    a, b, c, d, e, f = m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[1, 2], m[0, 2]
    x, y, z = b * c - e * e, f * e - d * c, d * e - f * b
    trace, determinant = a + b + c, a * x + d * y + f * z
    # The least eigenvalue is at least det/(trace/2)^2 and the largest at most the trace: most matrices need no more.
    if not (a > 0.0 and a * b > d * d and 4.0 * determinant > floor * trace**3):
        low, high = symmetric_eigenvalues(a, b, c, d, e, f)
        if high <= 0.0:
            out[:] = 0.0
            return
        if low < floor * high:
            add = floor * high - low
            a, b, c = a + add, b + add, c + add
            x, y, z = b * c - e * e, f * e - d * c, d * e - f * b
            determinant = a * x + d * y + f * z
    _write_inverse(a, b, c, d, e, f, x, y, z, determinant, out)


@njit(cache=True)
def least_and_most(first, second, third):
    """Smallest and largest root of x^3 - first x^2 + second x - third, all of them real (trigonometric formula)."""
    mean = first / 3.0
    p = math.sqrt(max(mean * mean - second / 3.0, 0.0))
    if p <= 1e-14 * abs(mean):
        return mean, mean
    half = (0.5 * (third - mean * second) + mean * mean * mean) / (p * p * p)
    angle = math.acos(min(1.0, max(-1.0, half))) / 3.0
    return mean + 2.0 * p * math.cos(angle + 2.0 * math.pi / 3.0), mean + 2.0 * p * math.cos(angle)


@njit(cache=True)
def invert_in_metric(m, g, floor, out):
    """Write the inverse of a symmetric positive 3x3 matrix to `out`, judged in a metric (6,) of unit determinant.

    As :func:`invert_symmetric`, with the eigenvalues of G M in place of those of M, and the inverse of G in place of
    the identity: what is short along one axis of a drawn out lattice is not for that flat.
    """
    a, b, c, d, e, f = m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[1, 2], m[0, 2]
    x, y, z = b * c - e * e, f * e - d * c, d * e - f * b
    determinant = a * x + d * y + f * z
    trace = g[0] * a + g[1] * b + g[2] * c + 2.0 * (g[3] * d + g[4] * e + g[5] * f)
    if not (a > 0.0 and a * b > d * d and 4.0 * determinant > floor * trace**3):
        # Inverse of the metric, and the second invariant, tr(cof(M) G^-1).
        ca, cb, cc = g[1] * g[2] - g[4] * g[4], g[0] * g[2] - g[5] * g[5], g[0] * g[1] - g[3] * g[3]
        cd, ce, cf = g[5] * g[4] - g[3] * g[2], g[3] * g[5] - g[4] * g[0], g[3] * g[4] - g[5] * g[1]
        second = ca * x + cb * (a * c - f * f) + cc * (a * b - d * d)
        second += 2.0 * (cd * y + ce * (d * f - a * e) + cf * z)
        low, high = least_and_most(trace, second, determinant)
        if high <= 0.0:
            out[:] = 0.0
            return
        if low < floor * high:
            add = floor * high - low
            a, b, c, d, e, f = a + add * ca, b + add * cb, c + add * cc, d + add * cd, e + add * ce, f + add * cf
            x, y, z = b * c - e * e, f * e - d * c, d * e - f * b
            determinant = a * x + d * y + f * z
    _write_inverse(a, b, c, d, e, f, x, y, z, determinant, out)


@njit(cache=True)
def invert_block(block, out):
    """Write the inverse of a positive definite 3x3 block, or zero where the block is zero."""
    trace = block[0, 0] + block[1, 1] + block[2, 2]
    if trace <= 0.0:
        out[:] = 0.0
        return
    invert_symmetric(block, 1e-12, out)
