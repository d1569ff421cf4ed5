"""The linear system of one solve: operator, inertia, wall drag, and the directions that the tools leave free."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.linear.block_jacobi import multiply_rows, multiply_symmetric
from ppmc.solver.linear.rigid_modes import RigidModes
from ppmc.solver.sph.operator import Operator

if TYPE_CHECKING:
    from ppmc.solver.linear.coarse_grid import CoarseGrid


@dataclass
class VelocitySystem:
    """What conjugate gradients need to know.

    Attributes
    ----------
    operator : Operator
    inertia : ndarray, shape (n,)
        Density x volume / step, Pa s mm; zero without inertia.
    rows : ndarray, shape (m,), int64
        Particles that a tool may hold or brake.
    drag : ndarray, shape (m, 3, 3)
        Wall friction on them, Pa s mm.
    free : ndarray, shape (m, 3, 3)
        Projections onto their free directions.
    inverse : ndarray, shape (n, 6)
        Block-Jacobi inverse on the free directions, see :func:`ppmc.solver.linear.block_jacobi.restricted_inverse`.
    coarse : CoarseGrid, optional
        Coarse level of the preconditioner.
    rigid : RigidModes, optional
        Rigid motions that cost no power.
    """

    operator: Operator
    inertia: np.ndarray
    rows: np.ndarray
    drag: np.ndarray
    free: np.ndarray
    inverse: np.ndarray
    coarse: CoarseGrid | None = None
    rigid: RigidModes | None = None

    def apply(self, velocities: np.ndarray) -> np.ndarray:
        """Force that opposes the motion, shape (n, 3), Pa mm^2."""
        out = self.operator.apply(velocities)
        _add_inertia(self.inertia, velocities, out)
        _add_drag(self.rows, self.drag, velocities, out)
        return out

    def project(self, vectors: np.ndarray) -> np.ndarray:
        """Part of the vectors (n, 3) in the free directions."""
        return multiply_rows(self.rows, self.free, vectors.copy())

    def feasible(self, velocities: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Velocities (n, 3) with those `held` (m, 3) in the directions that are not free."""
        out = self.project(velocities)
        out[self.rows] += held
        return out

    def precondition(self, residual: np.ndarray) -> np.ndarray:
        """Approximate solution for a residual, in the free directions and without rigid motion."""
        if self.rigid is not None:
            residual = self.rigid.remove(residual.copy())
        out = multiply_symmetric(self.inverse, residual)
        if self.coarse is not None:
            self.coarse.add_correction(residual, out)
        multiply_rows(self.rows, self.free, out)
        return out if self.rigid is None else self.rigid.remove(out)


@njit(cache=True, parallel=True)
def _add_inertia(inertia, velocities, out):
    for i in prange(out.shape[0]):
        for c in range(3):
            out[i, c] += inertia[i] * velocities[i, c]


@njit(cache=True, parallel=True)
def _add_drag(rows, drag, velocities, out):
    for k in prange(rows.shape[0]):
        i = rows[k]
        for r in range(3):
            for c in range(3):
                out[i, r] += drag[k, r, c] * velocities[i, c]
