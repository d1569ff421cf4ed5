"""Fourth-order orientation tensors: exact for affine motion from isotropy, and closures that estimate them from A.

Affine motion F takes isotropic directions to the distribution ψ(p) = (p·B⁻¹·p)^(-3/2) / 4π with
B = F·Fᵀ / det(F)^(2/3). With x_i the inverse eigenvalues of B, A has the eigenvalues
a_i = ⅓ √(x1 x2 x3) R_D(x_j, x_k, x_i), R_D being Carlson's elliptic integral, and 𝔸 has
A_iijj = (x_i a_i − x_j a_j) / (2 (x_i − x_j)). Inverted for x, this is the natural closure without any fit (Verleye and
Dupret 1993; VerWeyst 1998 fitted it). The same functions serve N and ℕ, with F⁻ᵀ for F (J appendix).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Closure = Callable[[Array], Array]

LEAST_EIGENVALUE = 1e-12
CLOSE = 1e-3
NEWTON_STEPS = 60
LARGEST_LOG_STEP = 2.0


def carlson_rd(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
    """Return Carlson's R_D(x, y, z) = 3/2 ∫₀^∞ dt / (√(t+x) √(t+y) (t+z)^(3/2)), elementwise.

    Duplication, B. C. Carlson, Numer. Algorithms 10 (1995) 13-26; relative error about 1e-15.
    """
    x, y, z = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (x, y, z)))
    x, y, z = x.copy(), y.copy(), z.copy()
    x0, y0 = x.copy(), y.copy()
    mean0 = (x + y + 3.0 * z) / 5.0
    mean = mean0.copy()
    reach = (1e-17 / 4.0) ** (-1.0 / 6.0) * np.max([np.abs(mean0 - x), np.abs(mean0 - y), np.abs(mean0 - z)], axis=0)
    total, factor = np.zeros_like(x), 1.0
    while np.any(factor * reach >= np.abs(mean)) and factor > 1e-40:
        sx, sy, sz = np.sqrt(x), np.sqrt(y), np.sqrt(z)
        shift = sx * sy + sx * sz + sy * sz
        total += factor / (sz * (z + shift))
        factor *= 0.25
        x, y, z, mean = 0.25 * (x + shift), 0.25 * (y + shift), 0.25 * (z + shift), 0.25 * (mean + shift)
    X, Y = factor * (mean0 - x0) / mean, factor * (mean0 - y0) / mean
    Z = -(X + Y) / 3.0
    e2, e3 = X * Y - 6.0 * Z * Z, (3.0 * X * Y - 8.0 * Z * Z) * Z
    e4, e5 = 3.0 * (X * Y - Z * Z) * Z * Z, X * Y * Z**3
    series = 1.0 - 3 * e2 / 14 + e3 / 6 + 9 * e2 * e2 / 88 - 3 * e4 / 22 - 9 * e2 * e3 / 52 + 3 * e5 / 26
    return np.asarray(factor * series / (mean * np.sqrt(mean)) + 3.0 * total)


def affine_eigenvalues(x: Array) -> Array:
    """Return the eigenvalues a of A, shape (..., 3), from the inverse eigenvalues x of B, shape (..., 3)."""
    root = np.sqrt(np.prod(x, axis=-1)) / 3.0
    x1, x2, x3 = x[..., 0], x[..., 1], x[..., 2]
    a = np.stack([carlson_rd(x2, x3, x1), carlson_rd(x1, x3, x2), carlson_rd(x1, x2, x3)], axis=-1)
    return np.asarray(root[..., None] * a)


def affine_fourth(x: Array, a: Array) -> Array:
    """Return A_iijj in principal axes, shape (..., 3, 3), of the distribution with the given x and a.

    The formula with a difference below the line loses digits where two x are close; there the integral it stands for,
    A_iijj = ¼ √(x1 x2 x3) ∫ t dt / ((t+x_i)(t+x_j) √Π(t+x_k)), is summed by the trapezoidal rule in ln t.
    """
    out = np.empty((*x.shape[:-1], 3, 3))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        xi, xj = x[..., i], x[..., j]
        close = np.abs(xi - xj) < CLOSE * (xi + xj)
        gap = np.where(close, 1.0, xi - xj)
        value = (xi * a[..., i] - xj * a[..., j]) / (2.0 * gap)
        if np.any(close):
            value = np.where(close, 0.0, value)
            value[close] = _mixed_integral(x[close], i, j)
        out[..., i, j] = out[..., j, i] = value
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[..., i, i] = a[..., i] - out[..., i, j] - out[..., i, k]
    return out


def _mixed_integral(x: Array, i: int, j: int) -> Array:
    """Return ¼ √Πx ∫ t dt / ((t+x_i)(t+x_j) √Π(t+x)) by a rule that converges faster than any power of its step."""
    x = x / x[:, [i]]
    log_t = np.linspace(np.log(x.min()) - 40.0, np.log(x.max()) + 40.0, 400)
    t = np.exp(log_t)[None, :]
    roots = [np.sqrt(x[:, [k]] / (t + x[:, [k]])) for k in range(3)]
    integrand = t * t * roots[0] * roots[1] * roots[2] / ((t + x[:, [i]]) * (t + x[:, [j]]))
    return np.asarray(0.25 * (log_t[1] - log_t[0]) * integrand.sum(axis=1))


def affine_tensors(deformation_gradient: Array) -> tuple[Array, Array]:
    """Return A and 𝔸 that affine motion makes of isotropic directions.

    Parameters
    ----------
    deformation_gradient : ndarray, shape (..., 3, 3)
        F; its volume change does not matter. Give F⁻ᵀ for N and ℕ.

    Returns
    -------
    second : ndarray, shape (..., 3, 3)
    fourth : ndarray, shape (..., 3, 3, 3, 3)
    """
    # Singular values of F keep the digits that the eigenvalues of F·Fᵀ would lose.
    axes, stretch, _ = np.linalg.svd(np.asarray(deformation_gradient, dtype=np.float64))
    # x may be scaled at will: only ratios matter.
    x = (stretch[..., [1]] / stretch) ** 2
    a = affine_eigenvalues(x)
    second = np.einsum("...ik,...k,...jk->...ij", axes, a, axes)
    return second, rotate_fourth(affine_fourth(x, a), axes)


def inverse_stretches(a: Array) -> Array:
    """Return x, shape (n, 3), with product one, whose affine distribution has the eigenvalues a, shape (n, 3).

    Newton's method in ln x; the derivative is exact, ∂a_i/∂ln x_j = A_iijj − δ_ij a_i, and sums to zero over j.
    """
    a = np.clip(a, LEAST_EIGENVALUE, None)
    a = a / a.sum(axis=-1, keepdims=True)
    log_x = -1.5 * (np.log(a) - np.log(a).mean(axis=-1, keepdims=True))
    order = np.argsort(a, axis=-1)
    low = np.take_along_axis(a, order, -1)[:, :2]
    for _ in range(NEWTON_STEPS):
        x = np.exp(log_x)
        now = affine_eigenvalues(x)
        jacobian = affine_fourth(x, now) - now[:, :, None] * np.eye(3)
        # Compare logarithms of the two smaller eigenvalues: the largest follows from the trace.
        sorted_now = np.take_along_axis(now, order, -1)[:, :2]
        residual = np.log(sorted_now / low)
        rows = np.take_along_axis(jacobian, order[:, :2, None], 1) / sorted_now[:, :, None]
        # Steps keep the product of x at one: the third logarithm is minus the sum of the first two.
        matrix = rows[:, :, :2] - rows[:, :, 2:]
        step = np.linalg.solve(matrix, -residual[:, :, None])[:, :, 0]
        step = np.column_stack([step, -step.sum(axis=1)])
        size = np.abs(step).max(axis=1, keepdims=True)
        log_x = log_x + step * np.minimum(1.0, LARGEST_LOG_STEP / np.maximum(size, 1e-300))
        if np.abs(residual).max() < 3e-15 or size.max() < 1e-14:
            break
    return np.asarray(np.exp(log_x))


def natural(second: Array) -> Array:
    """Return 𝔸, shape (..., 3, 3, 3, 3), by the exact natural closure: that of the affine distribution with this A."""
    second = np.asarray(second, dtype=np.float64)
    flat = second.reshape(-1, 3, 3)
    a, axes = np.linalg.eigh(0.5 * (flat + np.swapaxes(flat, 1, 2)))
    x = inverse_stretches(a)
    fourth = rotate_fourth(affine_fourth(x, affine_eigenvalues(x)), axes)
    return np.asarray(fourth.reshape(*second.shape[:-2], 3, 3, 3, 3))


def rotate_fourth(principal: Array, axes: Array) -> Array:
    """Return the symmetric 𝔸 with principal components A_iijj, shape (..., 3, 3); columns of `axes` are the axes."""
    full = np.zeros((*principal.shape[:-2], 3, 3, 3, 3))
    for i in range(3):
        full[..., i, i, i, i] = principal[..., i, i]
        for j in range(3):
            if i != j:
                for index in ((i, i, j, j), (i, j, i, j), (i, j, j, i)):
                    full[(..., *index)] = principal[..., i, j]
    for axis in range(4):
        # Turn one index at a time: four small products instead of one over eight indices.
        full = np.moveaxis(np.einsum("...ij,...jklm->...iklm", axes, np.moveaxis(full, -4 + axis, -4)), -4, -4 + axis)
    return full
