"""CalculiX: a *DISTRIBUTION with the *ORIENTATION that uses it (ccx 2.17 and later, *SOLID SECTION only)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ppmc.analysis.mesh.formats.abaqus import distribution_lines, empty_lines
from ppmc.analysis.mesh.formats.cards import write_text
from ppmc.analysis.mesh.mapping import MappedElements
from ppmc.analysis.mesh.mesh import MeshPart, StructuralMesh, family
from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.errors import SceneError


def write(mapped: MappedMesh, folder: Path, name: str) -> None:
    """Write ``<name>_axes_ccx.inp``.

    Raises
    ------
    SceneError
        If the mesh has parts or shells, which CalculiX gives no distribution.
    """
    mesh = mapped.mesh
    if len(mesh.parts) > 1 or not np.array_equal(mesh.parts[0].rotation, np.eye(3)):
        raise SceneError(
            f"analysis.mesh.formats: calculix knows neither parts nor instances, but {mesh.path.name} has them "
            "turned or several; write the mesh as one flat input file"
        )
    if any(family(kind) in ("triangle", "quad") for kind, _ in mesh.blocks):
        raise SceneError("analysis.mesh.formats: calculix takes element axes of solids only, the mesh is of shells")
    write_text(folder / f"{name}_axes_ccx.inp", axes_lines(mapped.elements, mesh, mesh.parts[0]))


def axes_lines(elements: MappedElements, mesh: StructuralMesh, part: MeshPart, name: str = "PPMC") -> Iterator[str]:
    """Yield the lines that give each element its local axes 1 = p, 2 = q, 3 = r."""
    yield f"*DISTRIBUTION, NAME={name}_AXES"
    yield from distribution_lines(elements, mesh, part)
    yield f"*ORIENTATION, NAME={name}, SYSTEM=RECTANGULAR"
    yield f"{name}_AXES"
    yield from empty_lines(elements, mesh, part, name)
