"""Convergence with the spacing: ram force on two unlike plies (0 and 90 degrees) between slip plates, free sides.

    python pipelines/benchmarks/solver_convergence.py [--ratios 1e2 1e4 6e4] [--spacings 1 0.5 0.25]

A block of 8 x 8 x 4 mm in its first step; force over area and (R + 2) eta23 rate, and the zero-energy share of the
power. Where plies could slide freely on each other's fibres the force would be of the order of 1/R of that: what is
left is the shear between them, and the tie that a kernel makes across the face. The order comes from three spacings.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.run.setup import run_constants
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model, StepReport
from ppmc.solver.walls.tools import Walls

SIZE = (8.0, 8.0, 4.0)  # mm
BRIEF = 1e-3  # s, the first step


def two_plies(spacing: float, ratio: float, size: tuple[float, float, float] = SIZE) -> ImplicitIntegrator:
    """Return the integrator of the block, the ram closing at unit rate."""
    axes = [(np.arange(round(side / spacing)) + 0.5) * spacing for side in size]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    height = size[2]
    lower = PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1))
    ram = PlaneTool(shape="plane", point=(0, 0, height), normal=(0, 0, -1), motion={"velocity": (0, 0, -height)})
    walls = Walls(compile_tools({"lower": lower, "ram": ram}), np.full(3, spacing))
    fibres = np.where(points[:, 2:] < 0.5 * height, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    settings = SolverSection(end_time=1.0, velocity_tolerance=1e-5, power_tolerance=1e-4)
    state = ParticleState.at_rest(
        points, np.full(len(points), spacing**3), fibres, np.cross([0.0, 0.0, 1.0], fibres),
        walls.starting_half_widths(points),
    )  # fmt: skip
    material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=ratio)
    _, bulk, _ = run_constants(settings, material, height, height)
    return ImplicitIntegrator(Model(settings, material, walls, settings.smoothing_ratio * spacing, bulk, 0.0), state)


def relative_force(
    spacing: float, ratio: float, size: tuple[float, float, float] = SIZE
) -> tuple[float, StepReport]:  # fmt: skip
    """Return the ram force of the first step over area and (R + 2) eta23 rate, and the step's report."""
    integrator = two_plies(spacing, ratio, size)
    integrator.initialise(0.0, BRIEF)
    report = integrator.step(0.0, BRIEF)
    return float(report.tool_force[1, 2]) / (size[0] * size[1] * (ratio + 2.0)), report


def order(forces: list[float]) -> float:
    """Return the order of convergence that the last three of `forces` show, each at half the spacing of the last."""
    return math.log2((forces[-3] - forces[-2]) / (forces[-2] - forces[-1]))


def main() -> None:
    """Print one row for each ratio and spacing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ratios", type=float, nargs="+", default=[1e2, 1e4, 6e4])
    parser.add_argument("--spacings", type=float, nargs="+", default=[1.0, 0.5, 0.25], help="each half the one before")
    given = parser.parse_args()
    print("       R  spacing  particles  iterations    force  zero-energy share")
    for ratio in given.ratios:
        forces: list[float] = []
        for spacing in given.spacings:
            force, report = relative_force(spacing, ratio)
            forces.append(force)
            count = round(np.prod(SIZE) / spacing**3)
            print(
                f"{ratio:8.0f} {spacing:8.3f} {count:10d} {report.iterations:11d} {forces[-1]:8.5f}"
                f" {report.zero_energy_share:18.3f}",
                flush=True,
            )
        if len(forces) > 2:
            print(f"         order {order(forces):.2f}")


if __name__ == "__main__":
    main()
