"""Tools driven by a force: their speed is found so that the charge pushes back with that force.

The charge is viscous, so the reaction grows with the speed: after each step the speed is scaled by a power of the
ratio of wanted to found force (damped, for part of the reaction is pressure stored in the bulk penalty), times a
trend that learns how much stiffer the charge becomes from step to step.
"""

import numpy as np

from ppmc.geometry.tools.toolset import ToolSet

MOST_CHANGE = 0.7  # logarithm of the factor by which a speed may change from step to step
LEAST_SPEED = 1e-6  # of the largest speed: a tool that has all but stopped must be able to start again


class ForcedTools:
    """Speeds and displacements of all force-controlled tools.

    Attributes
    ----------
    speed : ndarray, shape (forced,)
        Present speed along each tool's direction, mm/s.
    trend : ndarray, shape (forced,)
        Logarithm of the factor by which the speed changes a step at constant force.
    displacement : ndarray, shape (tools, 3)
        Displacement so far, mm; zero for prescribed tools.
    """

    def __init__(self, tools: ToolSet) -> None:
        self.controls = tools.motions.forced
        self.speed = np.array([control.max_speed for control in self.controls])
        self.trend = np.zeros(len(self.controls))
        self.displacement = np.zeros((len(tools), 3))

    def velocities(self, time_step: float) -> np.ndarray:
        """Velocity over a step, shape (tools, 3), mm/s; a tool halts at its stop."""
        out = np.zeros_like(self.displacement)
        for control, speed in zip(self.controls, self.speed, strict=True):
            left = control.travel - float(self.displacement[control.tool] @ control.direction)
            out[control.tool] = min(speed, max(left, 0.0) / time_step) * control.direction
        return out

    def advance(self, velocities: np.ndarray, time_step: float) -> None:
        """Move by a finished step at `velocities` (tools, 3)."""
        self.displacement = self.displacement + time_step * velocities

    def adjust(self, tool_force: np.ndarray, started: bool = True) -> None:
        """Choose the next speeds from the forces of the charge on the tools, shape (tools, 3), Pa mm^2.

        Before the run has `started` no pressure is stored yet, and the ratio of forces is taken whole.
        """
        for k, control in enumerate(self.controls):
            resistance = max(-float(tool_force[control.tool] @ control.direction), 1e-12 * control.force)
            missing = float(np.log(control.force / resistance))
            if started:
                self.trend[k] += 0.1 * np.clip(missing, -1.0, 1.0)
                missing = float(np.clip(0.5 * missing + self.trend[k], -MOST_CHANGE, MOST_CHANGE))
            factor = np.exp(missing)
            self.speed[k] = np.clip(self.speed[k] * factor, LEAST_SPEED * control.max_speed, control.max_speed)
