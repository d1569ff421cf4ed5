"""Inverse of small symmetric matrices in kernels."""

# mypy: disable-error-code="no-untyped-def"

import math

from ppmc.compile_cache import njit


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
def invert_block(block, out):
    """Write the inverse of a positive definite 3x3 block, or zero where the block is zero."""
    trace = block[0, 0] + block[1, 1] + block[2, 2]
    if trace <= 0.0:
        out[:] = 0.0
        return
    invert_symmetric(block, 1e-12, out)
