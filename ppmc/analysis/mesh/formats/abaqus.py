"""Abaqus: a *DISTRIBUTION of element axes with the *ORIENTATION that uses it, and a mesh that is no Abaqus file yet."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ppmc.analysis.mesh.formats.cards import frames_of, in_lines, write_text
from ppmc.analysis.mesh.mapping import MappedElements
from ppmc.analysis.mesh.mesh import MeshPart, StructuralMesh
from ppmc.analysis.mesh.structural import MappedMesh

# meshio's own table names rare variants, such as plane strain for quad.
TYPES = {
    "tetra": "C3D4", "tetra10": "C3D10", "hexahedron": "C3D8", "hexahedron20": "C3D20", "wedge": "C3D6",
    "wedge15": "C3D15", "pyramid": "C3D5", "triangle": "S3", "quad": "S4", "triangle6": "STRI65", "quad8": "S8R",
}  # fmt: skip


def write(mapped: MappedMesh, folder: Path, name: str) -> None:
    """Write ``<name>_axes.inp``, and ``<name>.inp`` where the mesh is no Abaqus file and Abaqus has its element types.

    Where a model has several parts, each has a file of its own, ``<name>_axes_<part>.inp``.
    """
    mesh = mapped.mesh
    several = len(mesh.parts) > 1
    for part in mesh.parts:
        ending = f"_{part.name.lower()}" if several else ""
        write_text(folder / f"{name}_axes{ending}.inp", axes_lines(mapped.elements, mesh, part))
    if not mesh.is_abaqus and all(kind in TYPES for kind, _ in mesh.blocks):
        write_text(folder / f"{name}.inp", mesh_lines(mesh, f"{name}_axes.inp"))


def axes_lines(elements: MappedElements, mesh: StructuralMesh, part: MeshPart, name: str = "ppmc") -> Iterator[str]:
    """Yield the lines that give each element of a part its local axes 1 = p, 2 = q, 3 = r.

    A ``*DISTRIBUTION`` of six numbers an element (a point on axis 1 and one in the 1-2 plane) with the ``*ORIENTATION``
    that uses it; include it in the part, and name it in ``*SOLID SECTION, ORIENTATION``. Elements without a direction
    have no line and fall to the first, the default of the part's own axes; they are in the set <name>_empty.
    """
    yield from _head(part)
    yield f"*DISTRIBUTION TABLE, NAME={name}_table"
    yield "COORD3D, COORD3D"
    yield f"*DISTRIBUTION, NAME={name}_axes, LOCATION=ELEMENT, TABLE={name}_table"
    yield from distribution_lines(elements, mesh, part)
    yield f"*ORIENTATION, NAME={name}"
    yield f"{name}_axes"
    yield "3, 0."
    yield from empty_lines(elements, mesh, part, name)


def _head(part: MeshPart) -> Iterator[str]:
    if part.name:
        yield f"** Belongs into *PART, NAME={part.name}: directions are given in the part's own axes."


def distribution_lines(elements: MappedElements, mesh: StructuralMesh, part: MeshPart) -> Iterator[str]:
    """Yield the data lines of a *DISTRIBUTION: the default, then number and points on axis 1 = p and 2 = q."""
    yield ", 1., 0., 0., 0., 1., 0."
    axes = frames_of(elements, part)[:, :2].reshape(-1, 6)
    for number, row in zip(mesh.numbers[part.start : part.stop].tolist(), axes, strict=True):
        if np.isfinite(row).all():
            # Adding zero makes 0 of -0.
            yield f"{number}, " + ", ".join(f"{v + 0.0:.6f}" for v in np.round(row, 6))


def empty_lines(elements: MappedElements, mesh: StructuralMesh, part: MeshPart, name: str) -> Iterator[str]:
    """Yield the set of elements that have no direction."""
    index = slice(part.start, part.stop)
    known = np.isfinite(elements.fibre_direction[index]).all(axis=1)
    known &= np.isfinite(elements.in_plane_direction[index]).all(axis=1)
    if not known.all():
        yield f"*ELSET, ELSET={name}_empty"
        for line in in_lines(mesh.numbers[index][~known].tolist()):
            yield line.removesuffix(",")


def mesh_lines(mesh: StructuralMesh, axes_file: str) -> Iterator[str]:
    """Yield an Abaqus input with nodes, elements, sets and the element axes."""
    yield from ("*HEADING", "Mesh with element axes by ppmc; lengths in mm", "*NODE")
    for k, x in zip(mesh.node_numbers.tolist(), mesh.points.tolist(), strict=True):
        yield f"{k}, " + ", ".join(f"{v:.9g}" for v in x)
    at = 0
    for kind, cells in mesh.blocks:
        yield f"*ELEMENT, TYPE={TYPES[kind]}, ELSET=PPMC"
        nodes = mesh.node_numbers[cells]
        for number, row in zip(mesh.numbers[at : at + len(cells)].tolist(), nodes.tolist(), strict=True):
            yield from in_lines([number, *row])
        at += len(cells)
    for name, index in mesh.groups.items():
        yield f'*ELSET, ELSET="{name}"'
        for line in in_lines(mesh.numbers[index].tolist()):
            yield line.removesuffix(",")
    yield f"*INCLUDE, INPUT={axes_file}"
