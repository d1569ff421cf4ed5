"""Structural meshes: read through meshio, checked, and asked which element a place lies in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

VOLUMES = ("tetra", "hexahedron", "wedge", "pyramid")
SHELLS = ("triangle", "quad")
CORNERS = {"tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5, "triangle": 3, "quad": 4}


@dataclass(frozen=True)
class StructuralMesh:
    """Elements of one mesh; blocks of other dimension (edges, surfaces of a solid) are left out.

    Attributes
    ----------
    path : Path
    points : ndarray, shape (k, 3)
        Nodes, mm.
    blocks : list of (str, ndarray)
        Element type of meshio and connectivity.
    centres : ndarray, shape (m, 3)
        Mean of each element's corners, mm.
    numbers : ndarray, shape (m,)
        Element numbers: the file's own in an Abaqus input, else counted from 1.
    """

    path: Path
    points: np.ndarray
    blocks: list[tuple[str, np.ndarray]]
    centres: np.ndarray
    numbers: NDArray[np.int64]

    @property
    def is_abaqus(self) -> bool:
        """Whether it was read from an Abaqus input file."""
        return self.path.suffix.lower() == ".inp"

    def owners(self, positions: np.ndarray) -> NDArray[np.int64]:
        """Return the element that each place lies in, or else the closest one; shape (n,)."""
        import meshio
        import pyvista as pv
        from vtkmodules.vtkCommonCore import reference
        from vtkmodules.vtkCommonDataModel import vtkGenericCell, vtkStaticCellLocator

        grid = pv.from_meshio(meshio.Mesh(self.points, self.blocks))
        locator: Any = vtkStaticCellLocator()
        cell: Any = vtkGenericCell()
        locator.SetDataSet(grid)
        locator.BuildLocator()
        solid = family(self.blocks[0][0]) in VOLUMES
        out = np.empty(len(positions), dtype=np.int64)
        number: Any = reference(0)
        foot, part, square = [0.0] * 3, reference(0), reference(0.0)
        for k, x in enumerate(positions.tolist()):
            out[k] = locator.FindCell(x) if solid else -1
            if out[k] < 0:
                locator.FindClosestPoint(x, foot, cell, number, part, square)
                out[k] = number.get()
        return out


def read_mesh(path: Path, scale: float = 1.0) -> StructuralMesh:
    """Read a mesh and check what meshio does not.

    Parameters
    ----------
    path : Path
        Anything meshio reads.
    scale : float
        Factor from the file's lengths to mm.

    Raises
    ------
    InputFileError
        If the file is missing or unreadable, has no elements, or holds nodes that are not finite.
    """
    import meshio

    path = Path(path)
    if not path.is_file():
        raise InputFileError(f"{path}: no such mesh file")
    try:
        mesh: Any = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio leaves by SystemExit where it knows no reader
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputFileError(f"{path}: meshio cannot read this mesh: {reason}") from None
    is_abaqus = path.suffix.lower() == ".inp"
    own_numbers = abaqus_numbers(path) if is_abaqus else []
    points = np.asarray(mesh.points, dtype=float)
    if points.ndim != 2 or not len(points):
        raise InputFileError(f"{path}: the mesh holds no nodes; it may be damaged or empty")
    points = np.pad(points[:, :3], ((0, 0), (0, 3 - min(points.shape[1], 3)))) * scale
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InputFileError(f"{path}: node {bad} is not finite: {points[bad]}")
    for chosen in (VOLUMES, SHELLS):
        blocks = [(b.type, np.asarray(b.data)) for b in mesh.cells if family(b.type) in chosen and len(b.data)]
        if blocks:
            break
    else:
        found = ", ".join(sorted({b.type for b in mesh.cells})) or "none"
        raise InputFileError(f"{path}: the mesh holds no solid or shell elements (found: {found})")
    for kind, cells in blocks:
        if cells.min() < 0 or cells.max() >= len(points):
            raise InputFileError(f"{path}: a {kind} element names node {int(cells.max())}, the mesh has {len(points)}")
    centres = np.vstack([points[cells[:, : CORNERS[family(kind)]]].mean(axis=1) for kind, cells in blocks])
    numbers = np.arange(1, len(centres) + 1)
    if is_abaqus:
        if [len(block) for block in own_numbers] != [len(b.data) for b in mesh.cells]:
            raise InputFileError(f"{path}: the element numbers cannot be told; write the mesh as one flat input file")
        numbers = np.concatenate([n for n, b in zip(own_numbers, mesh.cells, strict=True) if family(b.type) in chosen])
        if len(np.unique(numbers)) < len(numbers):
            raise InputFileError(f"{path}: element numbers repeat; write the mesh as one flat input file without parts")
    return StructuralMesh(path, points, blocks, centres, numbers)


def abaqus_numbers(path: Path) -> list[NDArray[np.int64]]:
    """Return the element numbers of an Abaqus input, block by block in the file's order; meshio does not keep them.

    Raises
    ------
    InputFileError
        If nodes stand in more than one place, which meshio would mix up.
    """
    from meshio._mesh import num_nodes_per_cell
    from meshio.abaqus._abaqus import abaqus_to_meshio_type

    blocks: list[NDArray[np.int64]] = []
    entries: list[int] = []
    nodes = size = 0

    def close() -> None:
        if size:
            blocks.append(np.array(entries, dtype=np.int64)[::size])

    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            if line.startswith("**"):
                continue
            if not line.startswith("*"):
                if size:
                    entries += [int(word) for word in line.split(",") if word.strip()]
                continue
            close()
            entries, size = [], 0
            words = [word.strip() for word in line[1:].split(",")]
            keyword = words[0].upper()
            if keyword == "INCLUDE":
                raise InputFileError(f"{path}: *INCLUDE is not followed; write the mesh as one flat input file")
            nodes += keyword == "NODE"
            if keyword == "ELEMENT":
                options = {k.strip().upper(): v.strip() for k, _, v in (word.partition("=") for word in words[1:])}
                size = 1 + num_nodes_per_cell[abaqus_to_meshio_type[options["TYPE"]]]
    close()
    if nodes > 1:
        raise InputFileError(
            f"{path}: nodes stand under {nodes} *NODE keywords, which meshio mixes up; write the mesh as one flat file"
        )
    return blocks


def family(kind: str) -> str:
    """Return the element type without its number of nodes: ``hexahedron20`` is a hexahedron."""
    return kind.rstrip("0123456789")
