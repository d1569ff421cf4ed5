"""A mapped mesh as files that structural solvers and viewers read: VTU, Abaqus, Gmsh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ppmc.analysis.mapping import abaqus_distribution
from ppmc.analysis.structural import MappedMesh
from ppmc.files import whole_file

# meshio's own table names rare variants, such as plane strain for quad.
ABAQUS_TYPES = {
    "tetra": "C3D4", "tetra10": "C3D10", "hexahedron": "C3D8", "hexahedron20": "C3D20", "wedge": "C3D6",
    "wedge15": "C3D15", "pyramid": "C3D5", "triangle": "S3", "quad": "S4", "triangle6": "STRI65", "quad8": "S8R",
}  # fmt: skip
GMSH_COMPONENTS = (1, 3, 9)
NUMBERS_A_LINE = 16


def write_mapped(mapped: MappedMesh, folder: Path, name: str, formats: Sequence[str]) -> None:
    """Write a mapped mesh.

    Parameters
    ----------
    mapped : MappedMesh
    folder : Path
    name : str
        Of the files, without ending.
    formats : sequence of str
        ``vtu``: ``<name>.vtu`` with all element data. ``gmsh``: ``<name>.msh`` likewise. ``abaqus``:
        ``<name>_axes.inp``, element axes under the mesh's own element numbers, to include in an input file; with
        ``<name>.inp``, nodes and elements, where the mesh did not come from one and Abaqus has its element types.

    Raises
    ------
    StorageError
        If a file cannot be written.
    """
    import meshio

    mesh = mapped.mesh
    if "vtu" in formats:
        solid = meshio.Mesh(mesh.points, mesh.blocks, cell_data=_in_blocks(mapped, mapped.cell_data()))
        with whole_file(folder / f"{name}.vtu") as temporary:
            meshio.write(temporary, solid, file_format="vtu")
    if "gmsh" in formats:
        tags = np.ones(len(mesh.numbers), dtype=np.int32)
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags, **_gmsh_data(mapped)}
        solid = meshio.Mesh(mesh.points, mesh.blocks, cell_data=_in_blocks(mapped, data))
        with whole_file(folder / f"{name}.msh") as temporary:
            # Of meshio's writers that of version 2.2 alone takes several blocks; its text form is broken by NumPy 2.
            meshio.write(temporary, solid, file_format="gmsh22", binary=True)
    if "abaqus" in formats:
        _write(folder / f"{name}_axes.inp", abaqus_distribution(mapped.elements, mesh.numbers))
        if not mesh.is_abaqus and all(kind in ABAQUS_TYPES for kind, _ in mesh.blocks):
            _write(folder / f"{name}.inp", abaqus_mesh(mapped, f"{name}_axes.inp"))


def abaqus_mesh(mapped: MappedMesh, axes_file: str) -> str:
    """Return an Abaqus input with nodes, elements of `ABAQUS_TYPES`, one element set and the element axes."""
    mesh = mapped.mesh
    lines = ["*HEADING", "Mesh with element axes by ppmc; lengths in mm", "*NODE"]
    lines += [f"{k}, " + ", ".join(f"{v:.9g}" for v in x) for k, x in enumerate(mesh.points, start=1)]
    at = 0
    for kind, cells in mesh.blocks:
        lines.append(f"*ELEMENT, TYPE={ABAQUS_TYPES[kind]}, ELSET=PPMC")
        for number, row in zip(mesh.numbers[at : at + len(cells)], cells + 1, strict=True):
            words = [str(number), *(str(node) for node in row)]
            chunks = [words[k : k + NUMBERS_A_LINE] for k in range(0, len(words), NUMBERS_A_LINE)]
            lines.append(",\n".join(", ".join(chunk) for chunk in chunks))
        at += len(cells)
    return "\n".join([*lines, f"*INCLUDE, INPUT={axes_file}"]) + "\n"


def _gmsh_data(mapped: MappedMesh) -> dict[str, np.ndarray]:
    """Return the element data with what Gmsh cannot hold cut into scalars, numbered in the order of the components."""
    out = {}
    for name, values in mapped.cell_data().items():
        values = values.astype(float)
        if values.ndim == 1 or values.shape[1] in GMSH_COMPONENTS:
            out[name] = values
        else:
            out |= {f"{name}_{k + 1}": values[:, k] for k in range(values.shape[1])}
    return out


def _in_blocks(mapped: MappedMesh, data: dict[str, np.ndarray]) -> dict[str, list[Any]]:
    """Return arrays cut into the mesh's blocks, as meshio wants them."""
    ends = np.cumsum([len(cells) for _, cells in mapped.mesh.blocks])[:-1]
    return {name: np.split(values, ends) for name, values in data.items()}


def _write(path: Path, text: str) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
