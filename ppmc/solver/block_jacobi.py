"""Block-Jacobi preconditioner: inverse 3x3 diagonal blocks, restricted to the directions the tools leave free."""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.small_tensors import invert_block


def restricted_inverse(blocks: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Inverse of P D P on the range of P, particle by particle.

    Parameters
    ----------
    blocks : ndarray, shape (n, 3, 3)
        Diagonal blocks D.
    free : ndarray, shape (n, 3, 3)
        Projections P onto the free directions.

    Returns
    -------
    ndarray, shape (n, 3, 3)
    """
    out = np.empty_like(blocks)
    _restricted_inverse(blocks, free, out)
    return out


def multiply_blocks(blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Product of blocks (n, 3, 3) with vectors (n, 3)."""
    out = np.empty_like(vectors)
    _multiply(blocks, vectors, out)
    return out


@njit(cache=True, parallel=True)
def _multiply(blocks, vectors, out):
    for i in prange(vectors.shape[0]):
        a, b, c = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for r in range(3):
            out[i, r] = blocks[i, r, 0] * a + blocks[i, r, 1] * b + blocks[i, r, 2] * c


@njit(cache=True, parallel=True)
def _restricted_inverse(blocks, free, out):
    for i in prange(blocks.shape[0]):
        scale = blocks[i, 0, 0] + blocks[i, 1, 1] + blocks[i, 2, 2]
        work, inverse = np.zeros((3, 3)), np.zeros((3, 3))
        for r in range(3):
            for c in range(3):
                total = 0.0
                for k in range(3):
                    for m in range(3):
                        total += free[i, r, k] * blocks[i, k, m] * free[i, m, c]
                identity = 1.0 if r == c else 0.0
                work[r, c] = total + scale * (identity - free[i, r, c])
        invert_block(work, inverse)
        for r in range(3):
            for c in range(3):
                total = 0.0
                for k in range(3):
                    for m in range(3):
                        total += free[i, r, k] * inverse[k, m] * free[i, m, c]
                out[i, r, c] = total
