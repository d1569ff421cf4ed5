r"""Shape of the local lattice and of the kernel's support.

Particles start as a lattice and carry its shape along: a tensor C with metric :math:`C^{-1}` and unit determinant,
:math:`C \leftarrow A C A^T` under an increment A. Where neighbours leave the motion that the gradient gives them, the
lattice dissolves, and its shape fades towards the sphere at the rate of that rearrangement; a homogeneous flow keeps it
exactly, so that contact widths and neighbourhoods stay right at any stretch.

The kernel follows the lattice's shape with its axes kept within a limited ratio: past a stretch of two a sphere loses
its neighbours in one direction and gains too many in another. Only the weights change with it. Kept within a ratio, an
ellipsoid swells in units of the lattice's cells, and brought back to its volume it is shorter along the longest axis
than the lattice, by the cube root of the swelling. Where that would cost the neighbours there, the limit gives way.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.small_tensors import diagonalise, unpack

MOST_ASPECT = 400.0  # of a lattice's axes: drawn out along one of them to twenty times, as half-widths may shrink
# Share of the strain rate, by which neighbours may leave the affine motion and still count as a lattice; and how many
# times faster than that rate the logarithm of the shape fades beyond.
LATTICE_NOISE, FADING = 0.2, 4.0
# Swelling beyond which the ratio of a kernel's axes is let grow: it then still reaches 1.8 spacings along the longest
# axis of a lattice, 2.6 without swelling, and a drawn-out lattice reads as well packed as any, to half a per cent. At
# 1.3 spacings weights are a hundredth and noise decides the gradient; swollen to four a lattice reads 2 % loose.
MOST_SWOLLEN = 3.0
SAME_SHAPE = 1e-6  # in parts of a lattice's longest axis squared, by which a kernel that is its lattice's may differ
TURNING = 0.4  # the same share where the flow turns within a kernel, and residuals are the flow itself


def kernel_of(lattice: np.ndarray, aspect_limit: float) -> np.ndarray:
    """Kernel shapes (n, 6) of lattices (n, 6) of unit determinant.

    No axis is longer than `aspect_limit` times another, unless the kernel would swell by more than `MOST_SWOLLEN`.
    """
    return limited(lattice, aspect_limit, most_swollen=MOST_SWOLLEN)


def swelling(kernel: np.ndarray, lattice: np.ndarray) -> np.ndarray:
    """How far kernels (n, 6) of lattices (n, 6) are swollen: 0 for not at all, 1 for by `MOST_SWOLLEN`; shape (n,).

    Both are of unit determinant and share their axes; what counts is the axis along which a kernel is shortest in units
    of its lattice.
    """
    out = np.zeros(len(kernel))
    rows = np.flatnonzero(np.any(np.abs(kernel - lattice) > SAME_SHAPE * lattice[:, :3].max(axis=1)[:, None], axis=1))
    if len(rows):
        ratio = np.linalg.solve(full(kernel[rows]), full(lattice[rows]))
        longest = np.linalg.eigvalsh(0.5 * (ratio + np.swapaxes(ratio, 1, 2)))[:, -1]
        shortest, least = 1.0 / np.sqrt(longest), 1.0 / np.cbrt(MOST_SWOLLEN)
        out[rows] = np.clip((1.0 - shortest) / (1.0 - least), 0.0, 1.0)
    return out


def limited(
    shape: np.ndarray, aspect_limit: float, fade: np.ndarray | float = 0.0, most_swollen: float = np.inf
) -> np.ndarray:
    """Shapes of unit determinant with no axis longer than `aspect_limit` times another.

    Parameters
    ----------
    shape : ndarray, shape (n, 6)
        C as XX, YY, ZZ, XY, YZ, XZ.
    aspect_limit : float
    fade : ndarray, shape (n,), or float
        Share by which the logarithm shrinks.
    most_swollen : float
        Volume that a shape may gain before it is brought back to its own; beyond, the limit gives way.

    Returns
    -------
    ndarray, shape (n, 6)
    """
    out = np.empty_like(shape)
    fades = np.broadcast_to(np.asarray(fade, dtype=np.float64), len(shape))
    _limited(shape, aspect_limit, most_swollen, fades, out)
    return out


def rearrangement_rate(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, velocities: np.ndarray, gradient: np.ndarray
) -> np.ndarray:
    """Rate at which neighbours leave the motion that the velocity gradient gives them.

    Parameters
    ----------
    pairs : Pairs
    positions, velocities : ndarray, shape (n, 3)
        mm, mm/s.
    volumes : ndarray, shape (n,)
        mm^3.
    gradient : ndarray, shape (n, 3, 3)
        Velocity gradients of these positions and velocities, 1/s.

    Returns
    -------
    ndarray, shape (n,), 1/s
    """
    out = np.empty(len(positions))
    _residual_rate(pairs.start, pairs.count, pairs.index, pairs.weight, positions, volumes, velocities, gradient, out)
    return out


def follow_lattice(
    lattice: np.ndarray, increment: np.ndarray, rearrangement: np.ndarray, strain: np.ndarray
) -> np.ndarray:
    """Lattice shapes (n, 6) after a step.

    Parameters
    ----------
    lattice : ndarray, shape (n, 6)
    increment : ndarray, shape (n, 3, 3)
        A.
    rearrangement, strain : ndarray, shape (n,)
        Rearrangement and strain rate times the step.
    """
    fade = 1.0 - np.exp(-FADING * np.maximum(rearrangement - LATTICE_NOISE * strain, 0.0))
    carried = np.empty_like(lattice)
    _carry(lattice, increment, carried)
    return limited(carried, MOST_ASPECT, fade)


def smoothness(flow_residual: np.ndarray) -> np.ndarray:
    """One where the flow is smooth over a kernel, zero where it turns within one; shape (n,).

    Parameters
    ----------
    flow_residual : ndarray, shape (n,)
        Rate of rearrangement in parts of the strain rate.
    """
    return np.clip((TURNING - flow_residual) / (TURNING - LATTICE_NOISE), 0.0, 1.0)


def lattice_of(spacing: np.ndarray) -> np.ndarray:
    """Shape tensor (6,) of a box lattice with spacings (3,)."""
    squared = np.asarray(spacing, dtype=np.float64) ** 2
    return np.concatenate([squared / np.cbrt(np.prod(squared)), np.zeros(3)])


def inverse_shape(shape: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse shape tensors, shape (n, 6), and the longest axis of all."""
    inverse, longest = np.empty_like(shape), np.empty(len(shape))
    _invert(shape, inverse, longest)
    return inverse, float(np.sqrt(longest.max(initial=1.0)))


def full(six_components: np.ndarray) -> np.ndarray:
    """Symmetric tensors (n, 3, 3) from XX, YY, ZZ, XY, YZ, XZ (n, 6)."""
    return six_components[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)


def six(tensors: np.ndarray) -> np.ndarray:
    """Components XX, YY, ZZ, XY, YZ, XZ (n, 6) of symmetric tensors (n, 3, 3)."""
    flat = tensors.reshape(-1, 9)
    return np.ascontiguousarray(flat[:, [0, 4, 8, 1, 5, 2]])


@njit(cache=True)
def _axes(shape, t, vectors):
    """Eigenvalues of C (6,) on the diagonal of `t`, and its axes."""
    unpack(shape, t)
    diagonalise(t, vectors)


@njit(cache=True, parallel=True)
def _limited(shape, aspect_limit, most_swollen, fade, out):
    for i in prange(shape.shape[0]):
        t, v, values = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
        _axes(shape[i], t, v)
        most, product = max(t[0, 0], t[1, 1], t[2, 2]), 1.0
        middle = t[0, 0] + t[1, 1] + t[2, 2] - most - min(t[0, 0], t[1, 1], t[2, 2])
        # Squared ratios at which one axis, or two, have been lengthened to that swelling.
        one, two = most * most * middle / most_swollen**2, most**1.5 / most_swollen
        needed = one if np.sqrt(most) * middle >= most_swollen else two
        least = most / max(aspect_limit**2, needed)
        for k in range(3):
            values[k] = max(t[k, k], least) ** (1.0 - fade[i])
            product *= values[k]
        for k in range(3):
            values[k] /= np.cbrt(product)
        for c in range(6):
            a, b = (c, c) if c < 3 else (0, 1) if c == 3 else (1, 2) if c == 4 else (0, 2)
            out[i, c] = v[a, 0] * values[0] * v[b, 0] + v[a, 1] * values[1] * v[b, 1] + v[a, 2] * values[2] * v[b, 2]


@njit(cache=True, parallel=True)
def _carry(lattice, increment, out):
    for i in prange(lattice.shape[0]):
        m, s, half = increment[i], lattice[i], np.empty((3, 3))
        for a in range(3):
            half[a, 0] = m[a, 0] * s[0] + m[a, 1] * s[3] + m[a, 2] * s[5]
            half[a, 1] = m[a, 0] * s[3] + m[a, 1] * s[1] + m[a, 2] * s[4]
            half[a, 2] = m[a, 0] * s[5] + m[a, 1] * s[4] + m[a, 2] * s[2]
        for c in range(6):
            a, b = (c, c) if c < 3 else (0, 1) if c == 3 else (1, 2) if c == 4 else (0, 2)
            out[i, c] = half[a, 0] * m[b, 0] + half[a, 1] * m[b, 1] + half[a, 2] * m[b, 2]


@njit(cache=True, parallel=True)
def _invert(shape, inverse, largest):
    for i in prange(shape.shape[0]):
        xx, yy, zz, xy, yz, xz = shape[i, 0], shape[i, 1], shape[i, 2], shape[i, 3], shape[i, 4], shape[i, 5]
        a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        per = 1.0 / (xx * a + xy * b + xz * c)
        inverse[i, 0], inverse[i, 1], inverse[i, 2] = per * a, per * (xx * zz - xz * xz), per * (xx * yy - xy * xy)
        inverse[i, 3], inverse[i, 4], inverse[i, 5] = per * b, per * (xy * xz - xx * yz), per * c
        # Largest eigenvalue of a symmetric tensor in closed form.
        mean = (xx + yy + zz) / 3.0
        dx, dy, dz = xx - mean, yy - mean, zz - mean
        size = np.sqrt((dx * dx + dy * dy + dz * dz + 2.0 * (xy * xy + yz * yz + xz * xz)) / 6.0)
        if size <= 1e-14 * mean:
            largest[i] = mean
            continue
        third = dx * (dy * dz - yz * yz) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz)
        cosine = min(1.0, max(-1.0, third / (2.0 * size * size * size)))
        largest[i] = mean + 2.0 * size * np.cos(np.arccos(cosine) / 3.0)


@njit(cache=True, parallel=True)
def _residual_rate(start, count, index, weight, x, volume, v, gradient, out):
    for i in prange(x.shape[0]):
        left, scale = 0.0, 0.0
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            a = volume[j] * weight[slot]
            d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            for c in range(3):
                e = v[j, c] - v[i, c]
                e -= gradient[i, c, 0] * d0 + gradient[i, c, 1] * d1 + gradient[i, c, 2] * d2
                left += a * e * e
            scale += a * (d0 * d0 + d1 * d1 + d2 * d2)
        out[i] = np.sqrt(left / scale) if scale > 0.0 else 0.0
