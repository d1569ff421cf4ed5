r"""Packing: the volume fraction that the particles fill around each of them, walls counted as filled.

:math:`\sum_j V_j W_{ij}` plus the part of the kernel that lies behind each wall face. It is one in a well packed
interior, above one where particles crowd, below one at free surfaces and voids. It is measured from positions alone,
so that its drift from the transported J can be seen.
"""

# mypy: disable-error-code="no-untyped-def"

import functools

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.neighbours import Pairs
from ppmc.solver.smoothing import SUPPORT, kernel_value


@functools.cache
def _behind_table() -> tuple[np.ndarray, np.ndarray]:
    # Part of the kernel beyond a plane at distance d (in h), summed over spherical shells: of a shell of radius q
    # the share (1 - d/q)/2 lies beyond the plane.
    d = np.linspace(0.0, SUPPORT, 201)
    q = np.linspace(0.0, SUPPORT, 4001)
    profile = 21.0 / 16.0 * 4.0 * q**2 * (1.0 - q / 2.0) ** 4 * (1.0 + 2.0 * q)
    share = np.where(q[None, :] > d[:, None], 0.5 * (1.0 - d[:, None] / np.maximum(q[None, :], 1e-12)), 0.0)
    integrand = share * profile
    return d, np.asarray(np.trapezoid(integrand, q, axis=1))


def kernel_behind(distance: np.ndarray, smoothing_length: float) -> np.ndarray:
    """Part of the kernel's integral behind a plane at `distance` (mm, may be negative) from the particle; 0 to 1."""
    grid, table = _behind_table()
    part = np.interp(np.abs(distance) / smoothing_length, grid, table, right=0.0)
    return np.where(distance >= 0.0, part, 1.0 - part)


def packing(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, smoothing_length: float, wall_distance: np.ndarray
) -> np.ndarray:
    """Packing of each particle, shape (n,).

    Parameters
    ----------
    pairs : Pairs
    positions : ndarray, shape (n, 3)
        mm.
    volumes : ndarray, shape (n,)
        Current volumes, mm^3.
    smoothing_length : float
        h, mm.
    wall_distance : ndarray, shape (n, m)
        Distance of wall faces, mm, infinite for none.
    """
    out = np.empty(len(positions))
    _kernel_sums(pairs.start, pairs.count, pairs.index, positions, volumes, smoothing_length, out)
    walls = np.where(
        np.isfinite(wall_distance), kernel_behind(np.nan_to_num(wall_distance, posinf=1e9), smoothing_length), 0.0
    )
    return out + walls.sum(axis=1)


@njit(cache=True, parallel=True)
def _kernel_sums(start, count, index, x, volume, h, out):
    for i in prange(x.shape[0]):
        total = volume[i] * kernel_value(0.0, h)
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            total += volume[j] * kernel_value(d0 * d0 + d1 * d1 + d2 * d2, h)
        out[i] = total
