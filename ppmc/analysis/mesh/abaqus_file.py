"""Structural meshes from Abaqus input files: every instance where it stands, numbers and sets its own."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np

from ppmc.analysis.mesh.mesh import MeshPart, StructuralMesh, structural
from ppmc.errors import InputFileError
from ppmc.geometry.abaqus import Body, read_deck, vtk_nodes
from ppmc.geometry.abaqus.scope import Element

Block = tuple[str, np.ndarray]


def abaqus_mesh(path: Path) -> StructuralMesh:
    """Read the solid elements of an Abaqus input, or its shells where it has no solids.

    Plane elements are taken at the height of their nodes, as shells. Parts keep their numbers; a part that stands in
    two instances is refused, as its elements can have one direction each.

    Raises
    ------
    InputFileError
        Naming line and keyword; see `ppmc.geometry.abaqus`.
    """
    deck = read_deck(path)
    families = {e.shape.family for body in deck.bodies for e in body.scope.elements.values()}
    wanted = {"solid"} if "solid" in families else {"shell", "plane"}
    notes = list(deck.notes)
    if not families & wanted:
        found = ", ".join(sorted(families)) or "none"
        raise InputFileError(f"{path}: the mesh holds no solid or shell elements (found: {found})")
    if "solid" in families and families & {"shell", "plane"}:
        notes.append(f"{path}: shells beside solids take no directions")
    points: list[np.ndarray] = []
    node_numbers: list[int] = []
    blocks: list[Block] = []
    numbers: list[int] = []
    parts: list[MeshPart] = []
    groups: dict[str, list[int]] = {}
    for body in deck.bodies:
        elements = [e for e in body.scope.elements.values() if e.shape.family in wanted]
        if not elements:
            continue
        if any(body.part and part.name == body.part for part in parts):
            raise InputFileError(
                f"{path}: *INSTANCE, NAME={body.name}: its part {body.part} stands in another instance too, and "
                "elements of a part have one direction each; make the second instance a part of its own"
            )
        own, used = _blocks(body, elements, len(node_numbers))
        blocks += own
        points.append(body.placement.apply(np.array([body.scope.nodes[n] for n in used])))
        node_numbers += used
        start = len(numbers)
        numbers += [e.number for e in elements]
        parts.append(MeshPart(body.part, start, len(numbers), body.placement.rotation))
        index = {number: k for k, number in enumerate(numbers[start:], start)}
        for name in body.scope.sets:
            members = body.scope.members(name, f"{path}: *ELSET, ELSET={name}")
            groups.setdefault(name, []).extend(index[n] for n in dict.fromkeys(members) if n in index)
    return structural(
        path,
        np.vstack(points),
        blocks,
        numbers=np.array(numbers, dtype=np.int64),
        node_numbers=np.array(node_numbers, dtype=np.int64),
        parts=tuple(parts),
        groups={name: np.array(found, dtype=np.int64) for name, found in groups.items() if found},
        notes=notes,
        files=deck.files,
    )


def _blocks(body: Body, elements: list[Element], first: int) -> tuple[list[Block], list[int]]:
    """Return runs of elements of one kind, in the file's order, and the nodes used; nodes count from `first`."""
    ordered = [(e, *vtk_nodes(e.shape, e.nodes)) for e in elements]
    used: dict[int, int] = {}
    for element, _, nodes in ordered:
        for node in nodes:
            if node not in body.scope.nodes:
                raise InputFileError(f"{element.place} refers to node {node}, which the file does not define")
            used.setdefault(node, first + len(used))
    blocks = []
    for kind, run in groupby(ordered, key=lambda item: item[1]):
        blocks.append((kind, np.array([[used[n] for n in nodes] for _, _, nodes in run], dtype=np.int64)))
    return blocks, list(used)
