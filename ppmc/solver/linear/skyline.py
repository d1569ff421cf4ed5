"""Cholesky factorisation of small sparse matrices in skyline storage, in one fixed order of operations.

A library's banded routine would serve as well, but its last bits may depend on the number of BLAS threads; a run must
not. Row i holds the columns from `first[i]` to i, one after the other, from `offset[i]` on.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit

# Only plain sums may be reordered: a longer formula would come out with other last bits when compiled than from the
# cache.
_FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}  # never nnan or ninf


@dataclass
class SkylineFactor:
    """Lower Cholesky factor.

    Attributes
    ----------
    first : ndarray, shape (n,), int64
        First column of each row.
    offset : ndarray, shape (n + 1,), int64
        Slot of that column in `values`.
    values : ndarray, shape (slots,)
    """

    first: np.ndarray
    offset: np.ndarray
    values: np.ndarray

    def solve(self, right_side: np.ndarray) -> np.ndarray:
        """Return the solution for `right_side`, shape (n,)."""
        out = right_side.copy()
        _solve(self.first, self.offset, self.values, out)
        return out


def factorise(first: np.ndarray, offset: np.ndarray, values: np.ndarray, shift: float) -> SkylineFactor:
    """Factorise A + shift diag(A), A symmetric and positive semi-definite.

    Parameters
    ----------
    first, offset : ndarray
        As in :class:`SkylineFactor`.
    values : ndarray
        Lower triangle of A; overwritten by the factor.
    shift : float
        Relative shift of the diagonal, so that modes without stiffness do no harm.

    Returns
    -------
    SkylineFactor
    """
    _factorise(first, offset, values, shift)
    return SkylineFactor(first, offset, values)


@njit(cache=True, fastmath=_FAST)
def _dot(values, a, b, length):
    total = 0.0
    for k in range(length):
        total += values[a + k] * values[b + k]
    return total


@njit(cache=True)
def _factorise(first, offset, values, shift):
    n = first.shape[0]
    largest = 0.0
    for i in range(n):
        largest = max(largest, values[offset[i + 1] - 1])
    for i in range(n):
        row, start = offset[i], first[i]
        for j in range(start, i):
            common = max(start, first[j])
            taken = _dot(values, row + common - start, offset[j] + common - first[j], j - common)
            values[row + j - start] = (values[row + j - start] - taken) / values[offset[j + 1] - 1]
        diagonal = values[row + i - start]
        floor = shift * diagonal + 1e-14 * largest
        pivot = diagonal + floor - _dot(values, row, row, i - start)
        values[row + i - start] = np.sqrt(max(pivot, floor))


@njit(cache=True, fastmath=_FAST)
def _dot_vector(values, a, x, b, length):
    total = 0.0
    for k in range(length):
        total += values[a + k] * x[b + k]
    return total


@njit(cache=True)
def _solve(first, offset, values, x):
    n = first.shape[0]
    for i in range(n):
        row, start = offset[i], first[i]
        x[i] = (x[i] - _dot_vector(values, row, x, start, i - start)) / values[row + i - start]
    for i in range(n - 1, -1, -1):
        row, start = offset[i], first[i]
        x[i] /= values[row + i - start]
        xi = x[i]
        for k in range(i - start):
            x[start + k] -= values[row + k] * xi
