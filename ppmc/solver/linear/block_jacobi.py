"""Block-Jacobi preconditioner: inverse 3x3 diagonal blocks, restricted to the directions the tools leave free."""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.small_tensors import invert_block, unpack


def restricted_inverse(blocks: np.ndarray, rows: np.ndarray, drag: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Inverse of P (D + G) P on the range of P, particle by particle.

    Parameters
    ----------
    blocks : ndarray, shape (n, 6)
        Diagonal blocks D as XX, YY, ZZ, XY, YZ, XZ.
    rows : ndarray, shape (m,), int64
        Particles that a tool may hold or brake.
    drag : ndarray, shape (m, 3, 3)
        Wall drag G on these.
    free : ndarray, shape (m, 3, 3)
        Projections P onto their free directions.

    Returns
    -------
    ndarray, shape (n, 6)
    """
    out = np.empty_like(blocks)
    _inverse(blocks, out)
    _restricted_inverse(blocks, rows, drag, free, out)
    return out


def multiply_symmetric(blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Product of symmetric blocks (n, 6), as XX, YY, ZZ, XY, YZ, XZ, with vectors (n, 3)."""
    out = np.empty_like(vectors)
    _multiply_symmetric(blocks, vectors, out)
    return out


def multiply_rows(rows: np.ndarray, blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Multiply some `rows` (m,) of vectors (n, 3) by blocks (m, 3, 3) in place; return the vectors."""
    _multiply_rows(rows, blocks, vectors)
    return vectors


@njit(cache=True, parallel=True)
def _multiply_rows(rows, blocks, vectors):
    for k in prange(rows.shape[0]):
        i = rows[k]
        a, b, c = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for r in range(3):
            vectors[i, r] = blocks[k, r, 0] * a + blocks[k, r, 1] * b + blocks[k, r, 2] * c


@njit(cache=True, parallel=True)
def _multiply_symmetric(blocks, vectors, out):
    for i in prange(vectors.shape[0]):
        a, b, c = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        xx, yy, zz, xy, yz, xz = (
            blocks[i, 0], blocks[i, 1], blocks[i, 2], blocks[i, 3], blocks[i, 4], blocks[i, 5],
        )  # fmt: skip
        out[i, 0] = xx * a + xy * b + xz * c
        out[i, 1] = xy * a + yy * b + yz * c
        out[i, 2] = xz * a + yz * b + zz * c


@njit(cache=True)
def _pack(block, i, out):
    out[i, 0], out[i, 1], out[i, 2] = block[0, 0], block[1, 1], block[2, 2]
    out[i, 3], out[i, 4], out[i, 5] = block[0, 1], block[1, 2], block[0, 2]


@njit(cache=True, parallel=True)
def _inverse(blocks, out):
    for i in prange(blocks.shape[0]):
        block, inverse = np.empty((3, 3)), np.empty((3, 3))
        unpack(blocks[i], block)
        invert_block(block, inverse)
        _pack(inverse, i, out)


@njit(cache=True, parallel=True)
def _restricted_inverse(blocks, rows, drag, free, out):
    for place in prange(rows.shape[0]):
        block, work, inverse, p = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), free[place]
        unpack(blocks[rows[place]], block)
        for r in range(3):
            for c in range(3):
                block[r, c] += drag[place, r, c]
        scale = block[0, 0] + block[1, 1] + block[2, 2]
        for r in range(3):
            for c in range(3):
                total = 0.0
                for k in range(3):
                    for m in range(3):
                        total += p[r, k] * block[k, m] * p[m, c]
                identity = 1.0 if r == c else 0.0
                work[r, c] = total + scale * (identity - p[r, c])
        invert_block(work, inverse)
        for r in range(3):
            for c in range(3):
                total = 0.0
                for k in range(3):
                    for m in range(3):
                        total += p[r, k] * inverse[k, m] * p[m, c]
                block[r, c] = total
        _pack(block, rows[place], out)
