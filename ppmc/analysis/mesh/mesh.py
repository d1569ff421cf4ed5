"""Structural meshes: read, checked, and asked which element a place lies in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

VOLUMES = ("tetra", "hexahedron", "wedge", "pyramid")
SHELLS = ("triangle", "quad")
CORNERS = {"tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5, "triangle": 3, "quad": 4}


@dataclass(frozen=True)
class MeshPart:
    """A stretch of the elements that is numbered on its own: a part of an Abaqus model.

    Attributes
    ----------
    name : str
        Of the part; empty where the file has none.
    start, stop : int
        First element and the one after the last.
    rotation : ndarray, shape (3, 3)
        How its instance is turned in the model.
    """

    name: str
    start: int
    stop: int
    rotation: np.ndarray


@dataclass(frozen=True)
class StructuralMesh:
    """Elements of one mesh; blocks of other dimension (edges, surfaces of a solid) are left out.

    Attributes
    ----------
    path : Path
    points : ndarray, shape (k, 3)
        Nodes, mm.
    blocks : list of (str, ndarray)
        Element type and connectivity, as meshio and VTK have them.
    centres : ndarray, shape (m, 3)
        Mean of each element's corners, mm.
    numbers : ndarray, shape (m,)
        Element numbers: the file's own in Abaqus and Gmsh files, else counted from 1.
    node_numbers : ndarray, shape (k,)
        Node numbers, likewise.
    parts : tuple of MeshPart
        In the order of the elements; element numbers repeat in different parts at most.
    groups : dict of str to ndarray
        Elements (from 0) of each named set or physical group.
    tags : dict of str to ndarray, shape (m,)
        ``physical`` and ``geometrical`` tags of a Gmsh mesh.
    tag_names : dict of str to (int, int)
        Physical tag and dimension of each name in a Gmsh mesh.
    notes : list of str
        What was passed over.
    files : list of Path
        Every file that was read.
    """

    path: Path
    points: np.ndarray
    blocks: list[tuple[str, np.ndarray]]
    centres: np.ndarray
    numbers: NDArray[np.int64]
    node_numbers: NDArray[np.int64]
    parts: tuple[MeshPart, ...]
    groups: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    tags: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    tag_names: dict[str, tuple[int, int]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)

    @property
    def is_abaqus(self) -> bool:
        """Whether it was read from an Abaqus input file."""
        return self.path.suffix.lower() == ".inp"

    @property
    def reach(self) -> NDArray[np.float64]:
        """Distance of each element's farthest corner from its centre, mm; shape (m,)."""
        out, at = np.empty(len(self.centres)), 0
        for kind, cells in self.blocks:
            corners = self.points[cells[:, : CORNERS[family(kind)]]]
            middle = self.centres[at : at + len(cells), None]
            out[at : at + len(cells)] = np.linalg.norm(corners - middle, axis=2).max(axis=1)
            at += len(cells)
        return out

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
    """Read a mesh.

    Parameters
    ----------
    path : Path
        Abaqus .inp, Gmsh .msh, or anything that meshio reads.
    scale : float
        Factor from the file's lengths to mm.

    Raises
    ------
    InputFileError
        If the file is missing or unreadable, has no elements, or holds nodes that are not finite.
    """
    from ppmc.analysis.mesh.abaqus_file import abaqus_mesh
    from ppmc.analysis.mesh.gmsh_file import gmsh_mesh

    path = Path(path)
    if not path.is_file():
        raise InputFileError(f"{path}: no such mesh file")
    readers: dict[str, Callable[[Path], StructuralMesh]] = {".inp": abaqus_mesh, ".msh": gmsh_mesh}
    mesh = readers.get(path.suffix.lower(), meshio_mesh)(path)
    if scale == 1.0:
        return mesh
    return replace(mesh, points=mesh.points * scale, centres=mesh.centres * scale)


def meshio_mesh(path: Path) -> StructuralMesh:
    """Read a mesh through meshio; elements and nodes are counted from 1."""
    mesh = through_meshio(path)
    points = nodes_of(mesh, path)
    blocks = [(b.type, np.asarray(b.data)) for b in mesh.cells if len(b.data)]
    return structural(path, points, mappable(path, blocks))


def through_meshio(path: Path) -> Any:
    """Return what meshio reads.

    Raises
    ------
    InputFileError
        If it cannot.
    """
    import meshio

    try:
        return meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio leaves by SystemExit where it knows no reader
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputFileError(f"{path}: meshio cannot read this mesh: {reason}") from None


def nodes_of(mesh: Any, path: Path) -> NDArray[np.float64]:
    """Return the nodes of a meshio mesh, shape (k, 3), where two coordinates mean a plane."""
    points = np.asarray(mesh.points, dtype=float)
    if points.ndim != 2 or not len(points):
        raise InputFileError(f"{path}: the mesh holds no nodes; it may be damaged or empty")
    return np.pad(points[:, :3], ((0, 0), (0, 3 - min(points.shape[1], 3))))


def mappable(path: Path, blocks: list[tuple[str, np.ndarray]]) -> list[tuple[str, np.ndarray]]:
    """Return the blocks of solids, or of shells where there are no solids.

    Raises
    ------
    InputFileError
        If there are neither.
    """
    for chosen in (VOLUMES, SHELLS):
        kept = [(kind, cells) for kind, cells in blocks if family(kind) in chosen]
        if kept:
            return kept
    found = ", ".join(sorted({kind for kind, _ in blocks})) or "none"
    raise InputFileError(f"{path}: the mesh holds no solid or shell elements (found: {found})")


def structural(path: Path, points: np.ndarray, blocks: list[tuple[str, np.ndarray]], **known: Any) -> StructuralMesh:
    """Return a checked mesh; `known` are attributes of `StructuralMesh` that would be counted or empty otherwise."""
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InputFileError(f"{path}: node {bad} is not finite: {points[bad]}")
    for kind, cells in blocks:
        if cells.min() < 0 or cells.max() >= len(points):
            raise InputFileError(f"{path}: a {kind} element names node {int(cells.max())}, the mesh has {len(points)}")
    centres = np.vstack([points[cells[:, : CORNERS[family(kind)]]].mean(axis=1) for kind, cells in blocks])
    m = len(centres)
    counted: dict[str, Any] = {
        "numbers": np.arange(1, m + 1),
        "node_numbers": np.arange(1, len(points) + 1),
        "parts": (MeshPart("", 0, m, np.eye(3)),),
        "files": [path],
    }
    return StructuralMesh(path, points, blocks, centres, **(counted | known))


def family(kind: str) -> str:
    """Return the element type without its number of nodes: ``hexahedron20`` is a hexahedron."""
    return kind.rstrip("0123456789")
