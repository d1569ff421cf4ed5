"""First instant of a slip squeeze by either operator of the solver: what the benchmarks of unlike platelets share."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.grid.integrator import GridIntegrator
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.run.setup import run_constants
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.walls.tools import Walls

AIR = 1e9  # Pa
STEP = 0.02  # s: nothing moves, and K J dt keeps the volume as in a run


@dataclass(frozen=True)
class FirstInstant:
    """What a solver says of the first instant.

    Attributes
    ----------
    force : float
        On the ram over area, eta23 and closing rate.
    velocity : ndarray, shape (n, 3)
        For a ram that closes at unit rate.
    seconds : float
        CPU time of all solves from rest.
    iterations : int
        Of the last.
    """

    force: float
    velocity: np.ndarray
    seconds: float
    iterations: int


def make_integrator(
    positions: np.ndarray, directions: np.ndarray, spacing: float, size: tuple[float, float, float], ratio: float,
    operator: str, held_across: bool = False, **settings: object,
) -> ImplicitIntegrator:  # fmt: skip
    """Return the integrator of a block from the origin to `size`, mm, the ram closing at unit rate.

    `held_across` puts slip walls at both ends of x2: plane strain.
    """
    height = size[2]
    tools = {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1)),
        "ram": PlaneTool(shape="plane", point=(0, 0, height), normal=(0, 0, -1), motion={"velocity": (0, 0, -height)}),
    }
    if held_across:
        tools["front"] = PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 1, 0))
        tools["back"] = PlaneTool(shape="plane", point=(0, size[1], 0), normal=(0, -1, 0))
    walls = Walls(compile_tools(tools), np.full(3, spacing))
    # The references hold the charge to the plates: air does here.
    section = SolverSection(end_time=1.0, operator=operator, ambient_pressure=AIR, **settings)
    across = np.cross(directions, [0.31, 0.17, 0.94])
    state = ParticleState.at_rest(
        positions, np.full(len(positions), np.prod(size) / len(positions)), directions,
        across / np.linalg.norm(across, axis=1, keepdims=True), walls.starting_half_widths(positions),
    )  # fmt: skip
    material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=ratio)
    _, bulk, _ = run_constants(section, material, height, height)
    model = Model(section, material, walls, section.smoothing_ratio * spacing, bulk, 0.0)
    return (GridIntegrator if operator == "grid" else ImplicitIntegrator)(model, state)


def first_instant(
    positions: np.ndarray, directions: np.ndarray, spacing: float, size: tuple[float, float, float], ratio: float,
    operator: str, held_across: bool = False, **settings: object,
) -> FirstInstant:  # fmt: skip
    """Solve for the first instant; arguments as in :func:`make_integrator`."""
    integrator = make_integrator(positions, directions, spacing, size, ratio, operator, held_across, **settings)
    began = time.process_time()
    report = integrator.initialise(0.0, STEP)
    took = time.process_time() - began
    velocity = integrator.state.in_original_order(integrator.state.velocity)
    return FirstInstant(float(report.tool_force[1, 2]) / (size[0] * size[1]), velocity, took, report.iterations)


def without_rigid(velocity: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """In-plane velocities (n, 2) without translation and rotation."""
    y, u = positions - positions.mean(axis=0), velocity[:, :2] - velocity[:, :2].mean(axis=0)
    spin = (y[:, 0] * u[:, 1] - y[:, 1] * u[:, 0]).sum() / (y[:, :2] ** 2).sum()
    return u - spin * np.stack([-y[:, 1], y[:, 0]], axis=1)
