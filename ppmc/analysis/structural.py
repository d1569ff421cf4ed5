"""Structural meshes: read with care through meshio, receive directions, and become files that solvers read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ppmc.analysis.mapping import MappedElements, map_to_elements
from ppmc.analysis.sources import Source
from ppmc.analysis.stiffness import Lamina, averaged_stiffness, engineering_moduli, stiffness_matrix
from ppmc.errors import InputFileError, SceneError

if TYPE_CHECKING:
    from ppmc.scene.analysis import MeshSection

VOLUMES = ("tetra", "hexahedron", "wedge", "pyramid")
SHELLS = ("triangle", "quad")
FAR_IN_SPACINGS = 2.0
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
    """

    path: Path
    points: np.ndarray
    blocks: list[tuple[str, np.ndarray]]
    centres: np.ndarray


@dataclass(frozen=True)
class MappedMesh:
    """A mesh with what its elements received, and, if the scene gives a lamina, their stiffness.

    Attributes
    ----------
    mesh : StructuralMesh
    elements : MappedElements
    stiffness : ndarray, shape (m, 6, 6), or None
        Pa, order XX, YY, ZZ, XY, YZ, XZ, engineering shear strains.
    """

    mesh: StructuralMesh
    elements: MappedElements
    stiffness: np.ndarray | None

    def cell_data(self) -> dict[str, np.ndarray]:
        """Return every array by name, one row an element."""
        e = self.elements
        data: dict[str, np.ndarray] = {
            "fibre_direction": e.fibre_direction,
            "in_plane_direction": e.in_plane_direction,
            "platelet_normal": e.platelet_normal,
            "fibre_tensor": e.fibre_tensor.reshape(-1, 9),
            "normal_tensor": e.normal_tensor.reshape(-1, 9),
            "distance_mm": e.distance,
            "particle_count": e.particle_count,
        }
        if self.stiffness is not None:
            rows, columns = np.triu_indices(6)
            data["stiffness_upper_Pa"] = self.stiffness[:, rows, columns]
            data["moduli_Pa"] = engineering_moduli(self.stiffness)
        return data


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
    points = np.asarray(mesh.points, dtype=float)
    if points.ndim != 2 or not len(points):
        raise InputFileError(f"{path}: the mesh holds no nodes; it may be damaged or empty")
    points = np.pad(points[:, :3], ((0, 0), (0, 3 - min(points.shape[1], 3)))) * scale
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InputFileError(f"{path}: node {bad} is not finite: {points[bad]}")
    for family in (VOLUMES, SHELLS):
        blocks = [(b.type, np.asarray(b.data)) for b in mesh.cells if _family(b.type) in family and len(b.data)]
        if blocks:
            break
    else:
        found = ", ".join(sorted({b.type for b in mesh.cells})) or "none"
        raise InputFileError(f"{path}: the mesh holds no solid or shell elements (found: {found})")
    for kind, cells in blocks:
        if cells.min() < 0 or cells.max() >= len(points):
            raise InputFileError(f"{path}: a {kind} element names node {int(cells.max())}, the mesh has {len(points)}")
    centres = np.vstack([points[cells[:, : CORNERS[_family(kind)]]].mean(axis=1) for kind, cells in blocks])
    return StructuralMesh(path, points, blocks, centres)


def map_mesh(mesh: StructuralMesh, source: Source, section: MeshSection, notes: list[str]) -> MappedMesh:
    """Map a source's directions to a mesh, and say where mesh and material do not meet.

    Raises
    ------
    SceneError
        If the lamina's constants make no stable material.
    """
    elements = map_to_elements(mesh.centres, source.parts(), section.method)
    far = elements.distance > FAR_IN_SPACINGS * source.spacing
    if far.any():
        notes.append(
            f"Mesh {mesh.path.name}: {int(far.sum()):,} of {len(far):,} elements lie more than "
            f"{FAR_IN_SPACINGS * source.spacing:.3g} mm from the material (largest {elements.distance.max():.4g} mm); "
            "is its unit or place another?"
        )
    stiffness = None
    if section.lamina is not None:
        lamina = Lamina(**section.lamina.model_dump())
        known = np.isfinite(elements.fibre_tensor).all(axis=(1, 2))
        stiffness = np.full((len(mesh.centres), 6, 6), np.nan)
        A, A4 = elements.fibre_tensor[known], elements.fibre_tensor4[known]
        try:
            stiffness[known] = stiffness_matrix(averaged_stiffness(A, A4, lamina))
        except ValueError as error:
            raise SceneError(f"analysis.mesh.lamina: {error}") from None
    return MappedMesh(mesh, elements, stiffness)


def _family(kind: str) -> str:
    """Return the element type without its number of nodes: ``hexahedron20`` is a hexahedron."""
    return kind.rstrip("0123456789")
