"""Slip squeezes between two plates, driven through the integrator without files."""

from dataclasses import dataclass

import numpy as np

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials import Material
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model, StepReport
from ppmc.solver.step.time_step import fit_to_times, proposed_step
from ppmc.solver.walls.tools import Walls

from .blocks import lattice


@dataclass
class Squeeze:
    """A finished squeeze of a block of unit spacing over one second."""

    state: ParticleState
    integrator: ImplicitIntegrator
    reports: list[StepReport]

    @property
    def stretch(self) -> np.ndarray:
        """Right stretch tensors U, shape (n, 3, 3), in the charge's order: free of rigid rotation."""
        f = self.state.in_original_order(self.state.deformation_gradient)
        values, vectors = np.linalg.eigh(np.swapaxes(f, 1, 2) @ f)
        return np.einsum("nab,nb,ncb->nac", vectors, np.sqrt(values), vectors)

    @property
    def compression(self) -> float:
        """Ratio h0/h in the middle of the last step, to which its forces belong."""
        tools = self.integrator.model.walls.tools
        height = tools.tools[1].point[2]
        return height / (height + tools.offsets(1.0 - 0.5 * self.reports[-1].time_step)[1, 2])

    @property
    def closing_rate(self) -> float:
        """Closing strain rate in the middle of the last step, 1/s."""
        tools = self.integrator.model.walls.tools
        return self.closing_speed * self.compression / tools.tools[1].point[2]

    @property
    def closing_speed(self) -> float:
        """Speed of the ram, mm/s."""
        return float(-self.integrator.model.walls.tools.velocities(0.5)[1, 2])

    @property
    def press_force(self) -> float:
        """Force on the ram at the end, Pa mm^2."""
        return float(self.reports[-1].tool_force[1, 2])


def make_squeeze(
    shape: tuple[int, int, int] = (8, 8, 6), ratio: float = 1.0, reduction: float = 0.5, angle: float = 0.0,
    jitter: float = 0.0, directions: np.ndarray | None = None, bulk_ratio: float = 300.0,
    walls: tuple = (), wall: object = "slip", material: Material | None = None, **settings: object,
) -> ImplicitIntegrator:  # fmt: skip
    """Integrator of a block between plates; ram at constant speed to `reduction` of the height.

    The material has eta23 = 1 Pa s and the given `ratio`, if no other is given.
    """
    positions, height = lattice(shape, jitter), float(shape[2])
    n = len(positions)
    motion = {"velocity": (0, 0, -height * (1.0 - reduction))}
    planes = {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1), wall=wall),
        "ram": PlaneTool(shape="plane", point=(0, 0, height), normal=(0, 0, -1), motion=motion, wall=wall),
    }
    for number, (point, normal) in enumerate(walls):
        planes[f"wall{number}"] = PlaneTool(shape="plane", point=point, normal=normal)
    tools = compile_tools(planes)
    faces = Walls(tools, np.ones(3))
    section = SolverSection(end_time=1.0, **settings)
    if material is None:
        material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=ratio)
    if directions is None:
        a = np.radians(angle)
        directions = np.tile([np.cos(a), np.sin(a), 0.0], (n, 1))
    across = np.cross([0.0, 0.0, 1.0], directions)
    state = ParticleState.at_rest(positions, np.ones(n), directions, across, faces.starting_half_widths(positions))
    bulk = bulk_ratio * (ratio + 2.0) * abs(1.0 - reduction)
    return ImplicitIntegrator(Model(section, material, faces, section.smoothing_ratio, bulk, 0.0), state)


def squeeze(**options: object) -> Squeeze:
    """Run :func:`make_squeeze` to the end."""
    return run_to_end(make_squeeze(**options))  # type: ignore[arg-type]


def run_to_end(integrator: ImplicitIntegrator) -> Squeeze:
    """Advance an integrator from rest to one second."""
    settings = integrator.model.settings
    integrator.initialise(0.0, 1e-3)
    time, step, reports = 0.0, np.inf, []
    while time < 1.0 - 1e-12:
        gradient = integrator.state.velocity_gradient
        step = proposed_step(gradient, settings.max_strain_increment, settings.max_displacement, np.inf, step)
        step = fit_to_times(time, step, 1.0)
        reports.append(integrator.step(time, step))
        time += step
    return Squeeze(integrator.state, integrator, reports)
