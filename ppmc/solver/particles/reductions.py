"""Sums over particles in a fixed order, so that their last bit doesn't depend on the number of threads; and updates."""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange

CHUNK = 1024


@njit(cache=True, parallel=True)
def _partial_dots(a, b, partial):
    n = a.shape[0]
    for block in prange(partial.shape[0]):
        total = 0.0
        for i in range(block * CHUNK, min(n, (block + 1) * CHUNK)):
            total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
        partial[block] = total


def dot(a: np.ndarray, b: np.ndarray) -> float:
    """Inner product of two vector fields of shape (n, 3)."""
    partial = np.empty((len(a) + CHUNK - 1) // CHUNK)
    _partial_dots(a, b, partial)
    return float(sum(partial.tolist()))


def add_multiple(a: np.ndarray, factor: float, b: np.ndarray) -> None:
    """Add `factor` times b (n, 3) to a (n, 3) in place, without an array in between."""
    _add_multiple(a, factor, b)


@njit(cache=True, parallel=True)
def _add_multiple(a, factor, b):
    for i in prange(a.shape[0]):
        for c in range(3):
            a[i, c] += factor * b[i, c]
