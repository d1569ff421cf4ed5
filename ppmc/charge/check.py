"""What `ppmc check` says about a scene's charge: particles, platelets, tools it starts in, and the volume balance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ppmc.charge.domains.domain import lattice_of
from ppmc.charge.domains.drape import flat_sheet
from ppmc.charge.domains.lattice import Lattice
from ppmc.charge.domains.lay_down import touching
from ppmc.charge.orientations.surface_normals import distance_of
from ppmc.charge.platelets.platelets import largest_sizes
from ppmc.geometry.cavity.charge_balance import charge_balance
from ppmc.geometry.tools.checks import check_charge_clear
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.charge import DrapedDomain, PlateletsOrientation

if TYPE_CHECKING:
    from ppmc.scene import Scene

# Platelets of fewer particles lose their shape.
FEW_PARTICLES = 4.0


def findings(scene: Scene) -> list[str]:
    """Return lines on the section ``charge``; tools and surfaces are read, nothing is written.

    Raises
    ------
    SceneError
        If the domain, its spacing or the tools are impossible, or the charge starts inside a tool or has no room at the
        end.
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
        seeds = lattice.positions
        if tools is not None:
            check_charge_clear(tools, lattice.positions)
    lines = [_particles(lattice)]
    if isinstance(section.orientation, PlateletsOrientation):
        lines += _platelets(section.orientation, lattice)
    if tools is not None and scene.solver is not None:
        spacing = float(np.cbrt(np.prod(lattice.spacing)))
        balance = charge_balance(tools, seeds, scene.solver.end_time, float(lattice.volumes.sum()), spacing)
        balance.check_room(scene.solver.bulk_modulus, "charge")
        lines.append(balance.told)
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
