"""Gmsh: MSH 2.2 as text, with the mesh's own numbers and groups, and all element data."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ppmc.analysis.mesh.formats.cards import write_text
from ppmc.analysis.mesh.mesh import VOLUMES, StructuralMesh, family
from ppmc.analysis.mesh.structural import MappedMesh

COMPONENTS = (1, 3, 9)
"""Numbers an element that Gmsh takes; others are cut into scalars."""


def write(mapped: MappedMesh, folder: Path, name: str) -> None:
    """Write ``<name>.msh``.

    An element belongs to the first of its groups; Abaqus' sets become physical groups. Elements that received nothing
    have no value. Where several parts share numbers, elements and nodes are counted anew.
    """
    write_text(folder / f"{name}.msh", lines(mapped))


def lines(mapped: MappedMesh) -> Iterator[str]:
    """Yield the file."""
    mesh = mapped.mesh
    several = len(mesh.parts) > 1
    numbers = np.arange(1, len(mesh.numbers) + 1) if several else mesh.numbers
    node_numbers = np.arange(1, len(mesh.points) + 1) if several else mesh.node_numbers
    yield from ("$MeshFormat", "2.2 0 8", "$EndMeshFormat")
    physical, names = _groups(mesh)
    if names:
        yield from ("$PhysicalNames", str(len(names)))
        yield from (f'{dim} {tag} "{name}"' for name, (tag, dim) in names.items())
        yield "$EndPhysicalNames"
    yield from ("$Nodes", str(len(mesh.points)))
    for number, (x, y, z) in zip(node_numbers.tolist(), mesh.points.tolist(), strict=True):
        yield f"{number} {x:.16g} {y:.16g} {z:.16g}"
    yield from ("$EndNodes", "$Elements", str(len(numbers)))
    geometrical = mesh.tags.get("geometrical", np.ones(len(numbers), dtype=np.int64))
    yield from _elements(mesh, numbers, node_numbers, physical, geometrical)
    yield "$EndElements"
    for name, values in _data(mapped).items():
        known = np.isfinite(values).all(axis=1)
        yield from ("$ElementData", "1", f'"{name}"', "1", "0.0", "3", "0", str(values.shape[1]), str(int(known.sum())))
        for number, row in zip(numbers[known].tolist(), values[known].tolist(), strict=True):
            yield f"{number} " + " ".join(f"{v:.16g}" for v in row)
        yield "$EndElementData"


def _elements(
    mesh: StructuralMesh, numbers: np.ndarray, node_numbers: np.ndarray, physical: np.ndarray, geometrical: np.ndarray
) -> Iterator[str]:
    """Yield a line an element: number, type, tags, nodes."""
    from meshio.gmsh.common import _meshio_to_gmsh_order, _meshio_to_gmsh_type

    at = 0
    for kind, cells in mesh.blocks:
        nodes = node_numbers[_meshio_to_gmsh_order(kind, cells)]
        code = _meshio_to_gmsh_type[kind]
        for k, row in enumerate(nodes.tolist(), at):
            yield f"{numbers[k]} {code} 2 {physical[k]} {geometrical[k]} " + " ".join(map(str, row))
        at += len(cells)


def _groups(mesh: StructuralMesh) -> tuple[np.ndarray, dict[str, tuple[int, int]]]:
    """Return the physical tag of every element, and tag and dimension of every name."""
    if "physical" in mesh.tags:
        return mesh.tags["physical"], mesh.tag_names
    tags = np.full(len(mesh.numbers), 0 if mesh.groups else 1, dtype=np.int64)
    dimension = 3 if family(mesh.blocks[0][0]) in VOLUMES else 2
    names = {}
    for tag, (name, index) in enumerate(mesh.groups.items(), 1):
        names[name] = (tag, dimension)
        tags[index[tags[index] == 0]] = tag
    return tags, names


def _data(mapped: MappedMesh) -> dict[str, np.ndarray]:
    """Return the element data, what Gmsh cannot hold cut into scalars numbered in the order of the components."""
    out = {}
    for name, values in mapped.cell_data().items():
        table = values.astype(float).reshape(len(values), -1)
        if table.shape[1] in COMPONENTS:
            out[name] = table
        else:
            out |= {f"{name}_{k + 1}": table[:, k : k + 1] for k in range(table.shape[1])}
    return out
