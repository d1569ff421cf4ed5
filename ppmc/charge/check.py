"""What `ppmc check` says about a scene's charge: particles, platelets, tools it starts in, and the volume balance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ppmc.charge.domain import lattice_of
from ppmc.charge.drape import flat_sheet
from ppmc.charge.lattice import Lattice
from ppmc.charge.lay_down import touching
from ppmc.charge.platelets import largest_sizes
from ppmc.charge.surface_normals import distance_of
from ppmc.errors import SceneError
from ppmc.geometry.cavity import cavity_volume
from ppmc.geometry.tool_checks import check_charge_clear
from ppmc.geometry.toolset import ToolSet, compile_tools
from ppmc.scene.charge import DrapedDomain, PlateletsOrientation
from ppmc.scene.tooling import ForceMotion

if TYPE_CHECKING:
    from ppmc.scene import Scene

# The cavity is looked for from so many particles.
MOST_SEEDS = 2000
# A charge and a closed cavity that differ by less are equal.
BALANCE = 0.005
# Platelets of fewer particles lose their shape.
FEW_PARTICLES = 4.0


def findings(scene: Scene) -> list[str]:
    """Return lines on the section ``charge``; tools and surfaces are read, nothing is written.

    Raises
    ------
    SceneError
        If the domain, its spacing or the tools are impossible, or the charge starts inside a tool.
    InputFileError
        If a surface or a tool's file is no closed surface.
    """
    section = scene.charge
    if section is None:
        return []
    tools = compile_tools(scene.tooling, scene.directory) if scene.tooling else None
    if isinstance(section.domain, DrapedDomain):
        lattice = flat_sheet(section.domain, section.spacing, section.layers)
        distance = distance_of(section.domain.tool, scene.tooling, scene.directory, "charge.domain.tool")
        seeds = touching(section.domain, distance, 0.05 * section.domain.size[2])[None]
    else:
        lattice = lattice_of(section, scene.directory)
        seeds = lattice.positions[:: max(1, lattice.n // MOST_SEEDS)]
        if tools is not None:
            check_charge_clear(tools, lattice.positions)
    lines = [_particles(lattice)]
    if isinstance(section.orientation, PlateletsOrientation):
        lines += _platelets(section.orientation, lattice)
    if tools is not None and scene.solver is not None:
        lines.append(_balance(tools, seeds, scene.solver.end_time, float(lattice.volumes.sum())))
    return lines


def _particles(lattice: Lattice) -> str:
    """Return how many particles of what spacing there are, and their volume."""
    spacing = " x ".join(f"{h:.4g}" for h in lattice.spacing)
    volume = float(lattice.volumes.sum())
    return f"{lattice.n:,} particles in {lattice.shape[0]} layers, spacing {spacing} mm, {volume:.6g} mm^3"


def _platelets(section: PlateletsOrientation, lattice: Lattice) -> list[str]:
    """Return how many particles stand for a platelet, if they are few."""
    length, width = largest_sizes(section)
    count = length * width / (lattice.spacing[0] * lattice.spacing[1])
    if count >= FEW_PARTICLES:
        return [f"a platelet of {length:.4g} x {width:.4g} mm has about {count:.0f} particles in a layer"]
    return [
        f"a platelet of {length:.4g} x {width:.4g} mm has fewer than {FEW_PARTICLES:.0f} particles in a layer: "
        "take a finer charge.spacing"
    ]


def _balance(tools: ToolSet, seeds: np.ndarray, end_time: float, charge: float) -> str:
    """Return how the charge's volume compares to the cavity's at the end."""
    if any(isinstance(tool.motion, ForceMotion) for tool in tools.tools):
        return "tools under force: how far they close is not known beforehand"
    try:
        cavity = cavity_volume(tools, seeds, end_time)
    except SceneError:
        return f"no place of the charge is left free at {end_time:.4g} s: its volume balance is not known"
    if not cavity.closed:
        return f"at {end_time:.4g} s the tools leave the cavity open: the charge has free sides"
    share = charge / cavity.volume
    told = f"at {end_time:.4g} s the charge takes {share:.2%} of the closed cavity of {cavity.volume:.6g} mm^3"
    if share > 1.0 + BALANCE:
        return f"{told}: too much, so that tools cannot close that far; take a smaller charge or less travel"
    return told + (": a short shot" if share < 1.0 - BALANCE else "")
