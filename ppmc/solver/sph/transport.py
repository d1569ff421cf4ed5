r"""Convection of deformation and directions over one step.

With the increment :math:`A = I + \Delta t\,L` (L taken at the positions where the step began, so that A is the exact
increment of any affine motion): :math:`F \leftarrow A F`, :math:`J \leftarrow J\det A`, :math:`p \leftarrow A p/|A
p|` (J1, A2) and the same for :math:`\hat q`. A shape factor :math:`\xi < 1` turns p by Jeffery's equation (A1)
instead, exactly for a constant L: :math:`p \propto \exp[(W + \xi D)\Delta t]\,p`.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange


def convect_deformation(increment: np.ndarray, deformation_gradient: np.ndarray, volume_ratio: np.ndarray) -> None:
    """Update F (n, 3, 3) and J (n,) in place by the increments A (n, 3, 3)."""
    _convect_deformation(increment, deformation_gradient, volume_ratio)


def convect_directions(increment: np.ndarray, directions: np.ndarray) -> None:
    """Turn unit vectors (n, 3) in place with the increments A (n, 3, 3)."""
    _convect_directions(increment, directions)


def compose(increment: np.ndarray, passed: np.ndarray) -> None:
    """Put increments A (n, 3, 3) upon those that have `passed` (n, 3, 3) before, in place."""
    _compose(increment, passed)


def small_strain(increment: np.ndarray) -> np.ndarray:
    """Norm of the symmetric part of A - I, shape (n,), for increments A (n, 3, 3)."""
    out = np.empty(len(increment))
    _small_strain(increment, out)
    return out


def increment_to_here(velocity_gradient: np.ndarray, time_step: float) -> tuple[np.ndarray, np.ndarray]:
    r"""Increment of a step from the velocity gradient where it *ended*.

    With the velocities v of a step and L taken with them at its last positions, the first ones are
    :math:`(I - \Delta t\,L)\,x` for any affine motion, so that :math:`A = (I - \Delta t\,L)^{-1}` is exact, and
    :math:`L A` is the gradient where the step began.

    Parameters
    ----------
    velocity_gradient : ndarray, shape (n, 3, 3)
        L, 1/s.
    time_step : float
        s.

    Returns
    -------
    increment, gradient : ndarray, shape (n, 3, 3)
        A, and L A in 1/s.
    """
    increment, gradient = np.empty_like(velocity_gradient), np.empty_like(velocity_gradient)
    _increment_to_here(velocity_gradient, time_step, increment, gradient)
    return increment, gradient


def jeffery_increment(velocity_gradient: np.ndarray, time_step: float, shape_factor: float) -> np.ndarray:
    r"""Increment :math:`\exp[(W + \xi D)\Delta t]` of Jeffery's equation at constant L.

    Parameters
    ----------
    velocity_gradient : ndarray, shape (n, 3, 3)
        L, 1/s.
    time_step : float
        s.
    shape_factor : float
        xi, in [-1, 1]; 1 is affine motion, -1 that of disc normals.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        To be applied to p and normalised (J3, A1).
    """
    transposed = np.swapaxes(velocity_gradient, -1, -2)
    generator = 0.5 * (velocity_gradient - transposed) + shape_factor * 0.5 * (velocity_gradient + transposed)
    return matrix_exponential(generator * time_step)


def matrix_exponential(matrices: np.ndarray) -> np.ndarray:
    """Exponential of matrices (n, 3, 3), by scaling, a Taylor series of order 12 and squaring."""
    size = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(max(size, 1e-300)))) + 2)
    scaled = matrices / 2.0**halvings
    result = np.broadcast_to(np.eye(3), matrices.shape).copy()
    term = result.copy()
    for order in range(1, 13):
        term = term @ scaled / order
        result += term
    for _ in range(halvings):
        result = result @ result
    return result


@njit(cache=True, parallel=True)
def _increment_to_here(gradient, dt, a, out):
    for i in prange(gradient.shape[0]):
        g = gradient[i]
        m00, m01, m02 = 1.0 - dt * g[0, 0], -dt * g[0, 1], -dt * g[0, 2]
        m10, m11, m12 = -dt * g[1, 0], 1.0 - dt * g[1, 1], -dt * g[1, 2]
        m20, m21, m22 = -dt * g[2, 0], -dt * g[2, 1], 1.0 - dt * g[2, 2]
        c0, c1, c2 = m11 * m22 - m12 * m21, m12 * m20 - m10 * m22, m10 * m21 - m11 * m20
        f = 1.0 / (m00 * c0 + m01 * c1 + m02 * c2)
        a[i, 0, 0], a[i, 1, 0], a[i, 2, 0] = f * c0, f * c1, f * c2
        a[i, 0, 1], a[i, 1, 1], a[i, 2, 1] = (
            f * (m02 * m21 - m01 * m22), f * (m00 * m22 - m02 * m20), f * (m01 * m20 - m00 * m21),
        )  # fmt: skip
        a[i, 0, 2], a[i, 1, 2], a[i, 2, 2] = (
            f * (m01 * m12 - m02 * m11), f * (m02 * m10 - m00 * m12), f * (m00 * m11 - m01 * m10),
        )  # fmt: skip
        for r in range(3):
            for c in range(3):
                out[i, r, c] = g[r, 0] * a[i, 0, c] + g[r, 1] * a[i, 1, c] + g[r, 2] * a[i, 2, c]


@njit(cache=True, parallel=True)
def _compose(a, f):
    for i in prange(a.shape[0]):
        for c in range(3):
            f0, f1, f2 = f[i, 0, c], f[i, 1, c], f[i, 2, c]
            for r in range(3):
                f[i, r, c] = a[i, r, 0] * f0 + a[i, r, 1] * f1 + a[i, r, 2] * f2


@njit(cache=True, parallel=True)
def _small_strain(a, out):
    for i in prange(a.shape[0]):
        xx, yy, zz = a[i, 0, 0] - 1.0, a[i, 1, 1] - 1.0, a[i, 2, 2] - 1.0
        xy, yz, xz = a[i, 0, 1] + a[i, 1, 0], a[i, 1, 2] + a[i, 2, 1], a[i, 0, 2] + a[i, 2, 0]
        out[i] = np.sqrt(xx * xx + yy * yy + zz * zz + 0.5 * (xy * xy + yz * yz + xz * xz))


@njit(cache=True, parallel=True)
def _convect_deformation(a, f, j):
    for i in prange(a.shape[0]):
        m = a[i]
        j[i] *= (
            m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
            - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
            + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
        )
        for c in range(3):
            f0, f1, f2 = f[i, 0, c], f[i, 1, c], f[i, 2, c]
            for r in range(3):
                f[i, r, c] = m[r, 0] * f0 + m[r, 1] * f1 + m[r, 2] * f2


@njit(cache=True, parallel=True)
def _convect_directions(a, p):
    for i in prange(a.shape[0]):
        p0, p1, p2 = p[i, 0], p[i, 1], p[i, 2]
        q0 = a[i, 0, 0] * p0 + a[i, 0, 1] * p1 + a[i, 0, 2] * p2
        q1 = a[i, 1, 0] * p0 + a[i, 1, 1] * p1 + a[i, 1, 2] * p2
        q2 = a[i, 2, 0] * p0 + a[i, 2, 1] * p1 + a[i, 2, 2] * p2
        size = np.sqrt(q0 * q0 + q1 * q1 + q2 * q2)
        p[i, 0], p[i, 1], p[i, 2] = q0 / size, q1 / size, q2 / size
