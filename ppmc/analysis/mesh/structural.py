"""Structural meshes receive directions, tensors and, if the scene gives a lamina, stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.averages.averages import fourth_components
from ppmc.analysis.averages.sources import Source
from ppmc.analysis.mesh.mapping import MappedElements, map_to_elements
from ppmc.analysis.mesh.mesh import StructuralMesh
from ppmc.analysis.mesh.stiffness import Lamina, averaged_stiffness, engineering_moduli, stiffness_matrix
from ppmc.errors import SceneError
from ppmc.notices import notice

if TYPE_CHECKING:
    from ppmc.scene.sections.analysis import MeshSection

FAR_IN_SPACINGS = 2.0


@dataclass(frozen=True)
class MappedMesh:
    """A mesh with what its elements received, and, if the scene gives a lamina, their stiffness.

    Attributes
    ----------
    mesh : StructuralMesh
    elements : MappedElements
    averaged : bool
        Whether over the elements' particles, or taken from one nearest point.
    stiffness : ndarray, shape (m, 6, 6), or None
        Pa, order XX, YY, ZZ, XY, YZ, XZ, engineering shear strains.
    """

    mesh: StructuralMesh
    elements: MappedElements
    averaged: bool
    stiffness: np.ndarray | None

    def cell_data(self) -> dict[str, np.ndarray]:
        """Return every array by name, one row an element; components as `tables` has them."""
        e = self.elements
        data: dict[str, np.ndarray] = {
            "element_number": self.mesh.numbers,
            "fibre_direction": e.fibre_direction,
            "in_plane_direction": e.in_plane_direction,
            "platelet_normal": e.platelet_normal,
            "fibre_tensor": e.fibre_tensor.reshape(-1, 9),
            "normal_tensor": e.normal_tensor.reshape(-1, 9),
            "distance_mm": e.distance,
            "particle_count": e.particle_count,
            "material_volume_mm3": e.material_volume,
        }
        if self.averaged:
            data["fibre_tensor4"] = fourth_components(e.fibre_tensor4)
            data["normal_tensor4"] = fourth_components(e.normal_tensor4)
            data["fibre_spread"] = e.fibre_spread.reshape(-1, 9)
            data["normal_spread"] = e.normal_spread.reshape(-1, 9)
        if self.stiffness is not None:
            rows, columns = np.triu_indices(6)
            data["stiffness_upper_Pa"] = self.stiffness[:, rows, columns]
            data["moduli_Pa"] = engineering_moduli(self.stiffness)
        return data


def map_mesh(mesh: StructuralMesh, source: Source, section: MeshSection, notes: list[str]) -> MappedMesh:
    """Map a source's directions to a mesh, and say where mesh and material do not meet.

    Raises
    ------
    SceneError
        If the lamina's constants make no stable material.
    """
    averaged = section.method == "average"
    within = np.maximum(mesh.reach, FAR_IN_SPACINGS * source.spacing)
    fill = section.empty == "nearest"
    elements = map_to_elements(
        mesh.centres, source.parts(), mesh.owners if averaged else None, within=within, fill=fill
    )
    notes += [note for note in mesh.notes if note not in notes]
    far = elements.distance > within
    if far.any():
        notes.append(
            f"Mesh {mesh.path.name}: {int(far.sum()):,} of {len(far):,} elements lie beside the material (centres up "
            f"to {elements.distance.max():.4g} mm from the nearest point); is its unit or place another?"
        )
    empty = int((elements.particle_count == 0).sum())
    if empty:
        what = "took the nearest point's directions" if fill else "are left empty (mesh: {empty: nearest} fills them)"
        notes.append(f"Mesh {mesh.path.name}: {empty:,} of {len(far):,} elements hold no material and {what}.")
    for note in notes:
        if note.startswith(f"Mesh {mesh.path.name}"):
            notice(note)
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
    return MappedMesh(mesh, elements, averaged, stiffness)
