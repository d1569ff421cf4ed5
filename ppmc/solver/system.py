"""The linear system of one solve: operator, inertia, wall drag, and the directions that the tools leave free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ppmc.solver.block_jacobi import multiply_blocks
from ppmc.solver.operator import Operator
from ppmc.solver.rigid_modes import without

if TYPE_CHECKING:
    from ppmc.solver.coarse_grid import CoarseGrid


@dataclass
class VelocitySystem:
    """What conjugate gradients need to know.

    Attributes
    ----------
    operator : Operator
    mass : ndarray, shape (n, 1)
        Inertia, density x volume / step, Pa s mm; zero without inertia.
    drag : ndarray, shape (n, 3, 3)
        Wall friction, Pa s mm.
    free : ndarray, shape (n, 3, 3)
        Projections onto the free directions.
    inverse : ndarray, shape (n, 3, 3)
        Block-Jacobi inverse on the free directions.
    coarse : CoarseGrid, optional
        Coarse level of the preconditioner.
    rigid : ndarray, shape (n, 3, k), optional
        Rigid motions that cost no power, see :func:`ppmc.solver.rigid_modes.free_rigid_modes`.
    """

    operator: Operator
    mass: np.ndarray
    drag: np.ndarray
    free: np.ndarray
    inverse: np.ndarray
    coarse: CoarseGrid | None = None
    rigid: np.ndarray | None = None

    def apply(self, velocities: np.ndarray) -> np.ndarray:
        """Force that opposes the motion, shape (n, 3), Pa mm^2."""
        out = self.operator.apply(velocities)
        out += self.mass * velocities
        out += multiply_blocks(self.drag, velocities)
        return out

    def project(self, vectors: np.ndarray) -> np.ndarray:
        """Part of the vectors (n, 3) in the free directions."""
        return multiply_blocks(self.free, vectors)

    def precondition(self, residual: np.ndarray) -> np.ndarray:
        """Approximate solution for a residual, in the free directions and without rigid motion."""
        if self.rigid is not None:
            residual = without(self.rigid, residual)
        out = multiply_blocks(self.inverse, residual)
        if self.coarse is not None:
            out += self.coarse.correct(residual, self.free)
        return out if self.rigid is None else without(self.rigid, out)
