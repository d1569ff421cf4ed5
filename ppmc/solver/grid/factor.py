"""Sparse direct solution of the grid's system.

Nothing iterative is known to hold out: where fibres forbid strains a system of many thousand times their stiffness
keeps no scale for a preconditioner to see. PARDISO (Intel MKL) factorises ten times faster than SciPy's SuperLU, and is
taken where the extra `grid` is installed. It is run by one thread: its sums then have one order.
"""

import ctypes
import importlib.util
from typing import Any

import numpy as np

from ppmc.errors import NumericalError

SHIFT = 1e-11  # of the diagonal, for rigid motions that nothing holds


def has_pardiso() -> bool:
    """Whether PARDISO is installed."""
    return importlib.util.find_spec("pypardiso") is not None


class Factor:
    """Factor of a symmetric positive definite matrix given by its upper blocks.

    Parameters
    ----------
    indices, pointers, data
        See :class:`ppmc.solver.grid.stiffness.Stiffness`.
    """

    def __init__(self, indices: np.ndarray, pointers: np.ndarray, data: np.ndarray) -> None:
        import scipy.sparse as sp

        n = 3 * (len(pointers) - 1)
        matrix: Any = sp.triu(sp.bsr_matrix((data, indices, pointers), shape=(n, n)).tocsr(), format="csr")
        matrix.sort_indices()
        diagonal = matrix.diagonal()
        if not np.all(np.isfinite(diagonal)) or not np.all(diagonal > 0.0):
            raise NumericalError("the stiffness of the grid is not finite and positive; see the dump for the particles")
        matrix.setdiag(diagonal * (1.0 + SHIFT))
        self._pardiso: Any = None
        if has_pardiso():
            from pypardiso import PyPardisoSolver

            self._pardiso = PyPardisoSolver(mtype=2)
            self._pardiso.libmkl.MKL_Set_Num_Threads(ctypes.c_int(1))
            self._matrix = sp.csr_matrix(matrix)
            self._pardiso.factorize(self._matrix)
        else:
            from scipy.sparse.linalg import splu

            whole = matrix + sp.triu(matrix, 1).T
            options = {"SymmetricMode": True}
            self._super = splu(whole.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    def solve(self, load: np.ndarray) -> np.ndarray:
        """Velocities of the nodes, shape (nodes, 3), for a load of that shape, Pa mm^2."""
        if self._pardiso is not None:
            found = self._pardiso.solve(self._matrix, np.ascontiguousarray(load.ravel()))
        else:
            found = self._super.solve(load.ravel())
        return np.asarray(found).reshape(-1, 3)

    def free(self) -> None:
        """Give the memory back."""
        if self._pardiso is not None:
            self._pardiso.free_memory(everything=True)
            self._pardiso = None
