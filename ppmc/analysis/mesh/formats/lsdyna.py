"""LS-DYNA: the elements with their material axes, in place of the deck's own element cards.

Solids are *ELEMENT_SOLID_ORTHO: vector a = p is material axis 1, vector d = q settles the plane of 1 and 2, so that
axis 3 is r. Shells are *ELEMENT_SHELL_BETA: the angle from the edge of nodes 1 and 2 to p, about the shell's normal
(for materials with AOPT = 0, whose axis 1 is that edge).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ppmc.analysis.mesh.formats.cards import write_text
from ppmc.analysis.mesh.mapping import MappedElements
from ppmc.analysis.mesh.mesh import StructuralMesh, family
from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.errors import SceneError

# A wedge is a brick whose nodes 5, 6 and 7, 8 fall together, a pyramid one whose upper face is a point.
CARDS = {
    "hexahedron": (0, 1, 2, 3, 4, 5, 6, 7),
    "wedge": (1, 0, 3, 4, 2, 2, 5, 5),
    "pyramid": (0, 1, 2, 3, 4, 4, 4, 4),
    "tetra": (0, 1, 2, 3, 3, 3, 3, 3),
    "tetra10": tuple(range(10)),
    "quad": (0, 1, 2, 3),
    "triangle": (0, 1, 2, 2),
}
LARGEST = 99_999_999
"""Largest number that a field of eight characters holds."""
PART_ID = 1


def write(mapped: MappedMesh, folder: Path, name: str) -> None:
    """Write ``<name>_axes.k``; with the nodes where the mesh did not come from a deck with numbers of its own.

    Raises
    ------
    SceneError
        If LS-DYNA has no card for an element, numbers do not fit their fields, or numbers repeat in several parts.
    """
    mesh = mapped.mesh
    lacking = sorted({kind for kind, _ in mesh.blocks} - set(CARDS))
    if lacking:
        raise SceneError(
            f"analysis.mesh.formats: lsdyna cards are written for {', '.join(CARDS)}, "
            f"the mesh holds {', '.join(lacking)}"
        )
    if len(mesh.parts) > 1:
        raise SceneError("analysis.mesh.formats: lsdyna numbers elements once, the mesh has several parts; merge them")
    if max(mesh.numbers.max(), mesh.node_numbers.max()) > LARGEST:
        raise SceneError(f"analysis.mesh.formats: lsdyna cards hold numbers up to {LARGEST:,}; renumber the mesh")
    write_text(folder / f"{name}_axes.k", lines(mapped.elements, mesh))


def lines(elements: MappedElements, mesh: StructuralMesh) -> Iterator[str]:
    """Yield the deck: nodes, and elements with their axes; those without a direction stand in cards without."""
    yield "*KEYWORD"
    yield f"$ lengths in mm; part {PART_ID} for all: set it to the deck's own"
    yield "*NODE"
    for number, (x, y, z) in zip(mesh.node_numbers.tolist(), mesh.points.tolist(), strict=True):
        yield f"{number:8d}{x:16.8g}{y:16.8g}{z:16.8g}"
    at = 0
    for kind, cells in mesh.blocks:
        index = np.arange(at, at + len(cells))
        at += len(cells)
        p, q = elements.fibre_direction[index], elements.in_plane_direction[index]
        shell = family(kind) in ("triangle", "quad")
        known = np.isfinite(p).all(axis=1) & (shell | np.isfinite(q).all(axis=1))
        nodes = mesh.node_numbers[cells[:, CARDS[kind]]]
        for has_axes in (True, False):
            chosen = np.flatnonzero(known == has_axes)
            if not len(chosen):
                continue
            yield f"*ELEMENT_{'SHELL' if shell else 'SOLID'}{('_BETA' if shell else '_ORTHO') if has_axes else ''}"
            for k in chosen:
                number = int(mesh.numbers[index[k]])
                if len(nodes[k]) == 10:
                    yield f"{number:8d}{PART_ID:8d}"
                    yield "".join(f"{n:8d}" for n in nodes[k])
                else:
                    yield f"{number:8d}{PART_ID:8d}" + "".join(f"{n:8d}" for n in nodes[k])
                if has_axes and shell:
                    yield f"{'':64}{_angle(mesh.points[cells[k, :4]], p[k]):16.6f}"
                elif has_axes:
                    yield "".join(f"{v:16.8f}" for v in p[k])
                    yield "".join(f"{v:16.8f}" for v in q[k])
    yield "*END"


def _angle(corners: np.ndarray, p: np.ndarray) -> float:
    """Return the angle from edge 1-2 to p in the shell's plane, degrees."""
    edge = corners[1] - corners[0]
    n = np.cross(corners[2] - corners[0], corners[-1] - corners[1])
    n = n / np.linalg.norm(n)
    return float(np.degrees(np.arctan2(np.cross(edge, p) @ n, edge @ (p - (p @ n) * n))))
