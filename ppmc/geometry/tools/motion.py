"""How tools move: prescribed displacement and velocity at a time, and the times at which a motion changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.scene.sections.tooling import FixedMotion, ForceMotion, Motion, TableMotion, VelocityMotion

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ForceControl:
    """A tool driven by a force.

    Attributes
    ----------
    tool : int
        Index of the tool.
    force : float
        Magnitude of the push, uN (Pa mm^2).
    direction : ndarray, shape (3,)
        Unit vector of the push and of the only movement allowed.
    max_speed : float
        Largest speed along `direction`, mm/s.
    travel : float
        Distance to the stop, mm; infinite without one.
    """

    tool: int
    force: float
    direction: FloatArray
    max_speed: float
    travel: float


class ToolMotions:
    """The motions of all tools of a scene.

    Tools driven by a force have no prescribed motion: here they rest, and whoever computes the force moves them.
    """

    def __init__(self, motions: Sequence[Motion]) -> None:
        self._tables = [_knots(motion) for motion in motions]
        self.forced: tuple[ForceControl, ...] = tuple(
            ForceControl(k, m.force, np.array(m.direction), m.max_speed, math.inf if m.travel is None else m.travel)
            for k, m in enumerate(motions)
            if isinstance(m, ForceMotion)
        )

    def displacements(self, time: float) -> FloatArray:
        """Return the displacement of every tool from its drawn position, shape (tools, 3), mm."""
        return np.array([_at(table, time) for table in self._tables]).reshape(-1, 3)

    def velocities(self, time: float) -> FloatArray:
        """Return the velocity of every tool just after `time`, shape (tools, 3), mm/s."""
        return np.array([_speed(table, time) for table in self._tables]).reshape(-1, 3)

    def next_break(self, time: float) -> float:
        """Return the first time after `time` at which some prescribed velocity changes; infinite if none does.

        A time step that ends there exactly sees one velocity only.
        """
        later = [float(t) for times, _, _ in self._tables for t in times if t > _just_after(time)]
        return min(later, default=math.inf)


def _just_after(time: float) -> float:
    """Return a time later by the round-off that adding up steps leaves, so that a knot reached counts as reached."""
    return time + 1e-12 * abs(time) + 1e-15


Table = tuple[FloatArray, FloatArray, FloatArray]
"""Knot times (k,), displacements there (k, 3), velocity after the last knot (3,)."""


def _knots(motion: Motion) -> Table:
    """Return a motion as a piecewise linear table."""
    still = np.zeros(3)
    if isinstance(motion, TableMotion):
        times = np.array(motion.times)
        return times, np.array(motion.displacements, dtype=float), still
    if isinstance(motion, VelocityMotion):
        velocity = np.array(motion.velocity)
        speed = float(np.linalg.norm(velocity))
        if motion.travel is None or speed == 0.0:
            return np.array([motion.start]), np.zeros((1, 3)), velocity
        end = motion.start + motion.travel / speed
        return np.array([motion.start, end]), np.stack([still, velocity / speed * motion.travel]), still
    assert isinstance(motion, FixedMotion | ForceMotion)
    return np.zeros(0), np.zeros((0, 3)), still


def _at(table: Table, time: float) -> FloatArray:
    """Return the displacement at a time."""
    times, places, after = table
    if len(times) == 0 or time <= times[0]:
        return places[0] if len(times) else np.zeros(3)
    if time >= times[-1]:
        return places[-1] + after * (time - times[-1])
    k = int(np.searchsorted(times, time, side="right")) - 1
    share = (time - times[k]) / (times[k + 1] - times[k])
    return np.asarray((1.0 - share) * places[k] + share * places[k + 1])


def _speed(table: Table, time: float) -> FloatArray:
    """Return the velocity just after a time."""
    times, places, after = table
    time = _just_after(time)
    if len(times) == 0 or time < times[0]:
        return np.zeros(3)
    if time >= times[-1]:
        return after
    k = int(np.searchsorted(times, time, side="right")) - 1
    return np.asarray((places[k + 1] - places[k]) / (times[k + 1] - times[k]))
