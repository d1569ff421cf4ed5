r"""Preconditioned conjugate gradients on the velocities that the tools leave free.

A relative residual misleads here: with stiff fibres a residual of 1e-4 can hide a velocity error of 20 %. The solve
stops on an estimate of the velocity error itself: the change of the solution over windows of iterations, summed as a
geometric series with the ratio seen between the last windows. Forces need more: the velocity can be right to 1e-4
while a stiff fibre still carries a strain that should not be, which dissipates. The solve therefore also waits until
the dissipation settles; each iteration lowers its functional by half of alpha r.z, so that costs nothing to know.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ppmc.errors import NumericalError
from ppmc.solver.particles.reductions import add_multiple, dot

Field = Callable[[np.ndarray], np.ndarray]


@dataclass
class Solution:
    """Result of one solve.

    Attributes
    ----------
    velocities : ndarray, shape (n, 3)
        mm/s.
    residual : ndarray, shape (n, 3)
        b - A v including the constrained directions, Pa mm^2: minus the forces that the tools exert.
    iterations : int
    estimated_error : float
        Estimated relative error of the velocities.
    converged : bool
        Whether both estimates, of velocities and of power, are within their tolerances.
    """

    velocities: np.ndarray
    residual: np.ndarray
    iterations: int
    estimated_error: float
    converged: bool


def conjugate_gradient(
    apply: Field, project: Field, precondition: Field, right_side: np.ndarray, start: np.ndarray, *, tolerance: float,
    max_iterations: int, window: int = 8, power_tolerance: float = np.inf, negligible: float = 0.0,
    watch: Callable[[np.ndarray], bool] | None = None,
) -> Solution:  # fmt: skip
    """Solve P A P w = P (b - A v_start), v = v_start + w.

    Parameters
    ----------
    apply : callable
        v -> A v, symmetric positive semi-definite; shape (n, 3).
    project : callable
        Projection P onto the free directions; returns a new array.
    precondition : callable
        Symmetric approximate inverse that maps free residuals to free corrections.
    right_side : ndarray, shape (n, 3)
        b, Pa mm^2.
    start : ndarray, shape (n, 3)
        Velocities that fulfil the constraints, mm/s.
    tolerance : float
        Estimated relative velocity error at which to stop.
    max_iterations : int
        Iterations after which to stop anyhow.
    window : int
        Iterations between estimates.
    power_tolerance : float
        Estimated relative error of the power v . A v at which to stop; both estimates must be met.
    negligible : float
        Speed, mm/s: errors are relative to this where the root mean square of the velocities falls below, and the power
        does not count.
    watch : callable, optional
        Called with the velocities after each window; true stops the solve (used to measure true errors).

    Returns
    -------
    Solution

    Raises
    ------
    ppmc.errors.NumericalError
        If the operator yields values that are not finite.
    """
    # Each vector counts where a run holds most: what is not needed while the operator or the preconditioner is at work
    # is given up before.
    v = start.copy()
    del start
    residual = apply(v)
    np.subtract(right_side, residual, out=residual)
    r = project(residual)
    p = precondition(r)
    rz = dot(r, p)
    del r
    first_rz = rz
    mark = v.copy()
    changes: list[float] = []
    gains: list[float] = []
    gain = 0.0
    least = len(v) * negligible**2
    estimate, done, met = np.inf, 0, False
    while done < max_iterations:
        if not np.isfinite(rz):
            raise NumericalError("the velocity solve met values that are not finite; see the dump for the particles")
        if rz <= 1e-28 * max(first_rz, 1e-300):
            estimate, met = 0.0, True
            break
        ap = apply(p)
        curvature = dot(p, ap)
        if curvature <= 0.0:  # a rigid mode without load, or round-off
            estimate, met = 0.0, True
            break
        alpha = rz / curvature
        add_multiple(v, alpha, p)
        gain += alpha * rz
        add_multiple(residual, -alpha, ap)
        del ap
        r = project(residual)
        z = precondition(r)
        rz, previous = dot(r, z), rz
        p *= rz / previous
        p += z
        del r, z
        done += 1
        if done % window == 0:
            np.subtract(v, mark, out=mark)
            size = dot(v, v)
            changes.append(np.sqrt(dot(mark, mark) / max(size, least, 1e-300)))
            mark[:] = v
            estimate = _series_remainder(changes)
            power = abs(dot(v, right_side) - dot(v, residual))
            gains.append(gain / max(power, 1e-300))
            gain = 0.0
            settled = size < least or _series_remainder(gains) < power_tolerance
            met = bool(estimate < tolerance and settled)
            if met or (watch is not None and watch(v)):
                break
    return Solution(v, residual, done, float(estimate), met)


def _series_remainder(changes: list[float]) -> float:
    """Sum of the changes still to come, if they go on shrinking as over the last windows."""
    if len(changes) < 3:
        return changes[-1] if changes[-1] < 1e-12 else np.inf
    recent = max(changes[-2:])
    ratio = min(max((changes[-1] / max(changes[-3], 1e-300)) ** 0.5, 0.5), 0.95)
    return recent * ratio / (1.0 - ratio)
