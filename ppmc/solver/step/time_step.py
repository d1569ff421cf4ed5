"""Length of the next step: strain and displacement limits, output times and changes of tool motion hit exactly."""

import math

import numpy as np

GROWTH = 1.5  # largest ratio of a step to the one before


def proposed_step(
    velocity_gradient: np.ndarray, max_strain: float, max_displacement: float, longest: float, previous: float
) -> float:
    """Step, s, that keeps strain and relative displacement within their limits.

    Parameters
    ----------
    velocity_gradient : ndarray, shape (n, 3, 3)
        L of the last step, 1/s.
    max_strain : float
        Largest strain increment, met by 99 % of the particles.
    max_displacement : float
        Largest displacement between neighbours, in spacings; met by all.
    longest : float
        Upper bound, s.
    previous : float
        Last step, s (infinite for none); steps grow gradually.
    """
    fastest = limit_rate(velocity_gradient, max_strain, max_displacement)
    step = min(longest, GROWTH * previous)
    return min(step, 1.0 / fastest) if fastest > 0.0 else step


def limit_rate(velocity_gradient: np.ndarray, max_strain: float, max_displacement: float) -> float:
    """Limits reached per second, 1/s: a step of its inverse just keeps both; arguments as above."""
    rate = 0.5 * (velocity_gradient + np.swapaxes(velocity_gradient, -1, -2))
    strain_rate = float(np.quantile(np.sqrt(np.einsum("nij,nij->n", rate, rate)), 0.99))
    turning = float(np.sqrt(np.einsum("nij,nij->n", velocity_gradient, velocity_gradient).max(initial=0.0)))
    return max(strain_rate / max_strain, turning / (4.0 * max_displacement))


def fit_to_times(time: float, step: float, target: float) -> float:
    """Shorten `step` so that a whole number of equal steps ends at `target` (s)."""
    remaining = target - time
    return remaining / max(1, math.ceil(remaining / step - 1e-9))


def event_times(end: float, interval: float, extra: tuple[float, ...]) -> list[float]:
    """Ascending output times up to `end`, s, without `time = 0` and without near-duplicates."""
    count = math.floor(end / interval + 1e-9)
    times = sorted({*(k * interval for k in range(1, count + 1)), *extra, end})
    kept: list[float] = []
    for t in times:
        if t > 1e-9 * end and t <= end * (1 + 1e-12) and (not kept or t - kept[-1] > 1e-9 * end):
            kept.append(min(t, end))
    kept[-1] = end
    return kept
