"""A whole Abaqus input file: parts where their instances stand, with everything that places elements and fibres.

What changes places or elements and is not understood is refused by name, with the line; everything else (materials,
loads, contact, output) has no say.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from ppmc.errors import InputFileError
from ppmc.geometry.abaqus.lines import Block, blocks
from ppmc.geometry.abaqus.placement import Placement, instance_placement
from ppmc.geometry.abaqus.scope import Member, Scope

REFUSED = {
    "NGEN": "generates nodes",
    "NFILL": "generates nodes",
    "NCOPY": "copies nodes",
    "NMAP": "maps nodes to other coordinates",
    "ELGEN": "generates elements",
    "ELCOPY": "copies elements",
    "IMPORT": "takes the elements of another analysis",
    "SYMMETRIC MODEL GENERATION": "generates a model from another",
    "IMPERFECTION": "moves nodes",
    "ADAPTIVE MESH REFINEMENT": "changes elements",
    "SUBSTRUCTURE GENERATE": "makes a substructure",
}
"""Keywords that make or move nodes and elements in ways that are not worked out here."""
WRITE_OUT = "write the mesh out node by node and element by element (Abaqus/CAE: import as an orphan mesh, write input)"


@dataclass
class Body:
    """An instance of a part, or the whole of a flat model.

    Attributes
    ----------
    name : str
        Of the instance; empty for a flat model.
    part : str
        Of its part; empty for a flat model.
    scope : Scope
        Nodes, elements, sets, sections and orientations, in the part's axes.
    placement : Placement
        Where it stands.
    """

    name: str
    part: str
    scope: Scope
    placement: Placement = field(default_factory=Placement)


@dataclass(frozen=True)
class Deck:
    """What an input file holds.

    Attributes
    ----------
    path : Path
    bodies : list of Body
        Those with elements.
    files : list of Path
        Every file read, `path` first.
    notes : list of str
        What was passed over.
    """

    path: Path
    bodies: list[Body]
    files: list[Path]
    notes: list[str]


def read_deck(path: Path) -> Deck:
    """Read an Abaqus input file up to its first step.

    Raises
    ------
    InputFileError
        Naming file, line and keyword, if something cannot be understood and matters.
    """
    reader = _Reader()
    files: list[Path] = []
    for block in blocks(path, files):
        if block.keyword == "STEP":
            break  # what follows changes neither nodes nor elements
        reader.take(block)
    every = reader.bodies(path)
    bodies = [body for body in every if body.scope.elements]
    notes = []
    for body in every:
        if body.scope.passed_over:
            kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(body.scope.passed_over.items()))
            notes.append(f"{path}: elements that hold no fibres are passed over: {kinds}")
    if reader.idle:
        notes.append(f"{path}: parts without an instance are passed over: {', '.join(reader.idle)}")
    return Deck(path, bodies, files, notes)


def files_of(path: Path) -> list[Path]:
    """Return an input file and every file that it includes.

    Raises
    ------
    InputFileError
        If one is missing.
    """
    files: list[Path] = []
    for _ in blocks(path, files):
        pass
    return files


class _Reader:
    """Puts blocks where they belong: the model, a part, the assembly, an instance."""

    def __init__(self) -> None:
        self.model = Scope()
        self.assembly = Scope("ASSEMBLY")
        self.parts: dict[str, Scope] = {}
        self.instances: list[tuple[Block, Scope]] = []
        self.idle: list[str] = []
        self.has_assembly = False
        self.here: list[tuple[str, Scope]] = [("", self.model)]

    def take(self, block: Block) -> None:
        """Take in the next block of the file."""
        keyword = block.keyword
        kind, scope = self.here[-1]
        if keyword in REFUSED:
            raise InputFileError(f"{block.place} {REFUSED[keyword]}, which is not worked out here; {WRITE_OUT}")
        if keyword == "PART":
            self._open(block, "PART", "")
            self.parts[block.required("NAME")] = self.here[-1][1]
        elif keyword == "ASSEMBLY":
            if kind or self.has_assembly:
                raise InputFileError(f"{block.place}: an assembly is open or closed already")
            self.has_assembly = True
            self.here.append(("ASSEMBLY", self.assembly))
        elif keyword == "INSTANCE":
            if "LIBRARY" in block.options:
                raise InputFileError(f"{block.place}, LIBRARY= takes the instance from another analysis; {WRITE_OUT}")
            self._open(block, "INSTANCE", "ASSEMBLY")
            self.instances.append((block, self.here[-1][1]))
        elif keyword.startswith("END ") and keyword[4:] in ("PART", "ASSEMBLY", "INSTANCE"):
            if kind != keyword[4:]:
                raise InputFileError(f"{block.place}: there is no {keyword[4:].title()} open")
            self.here.pop()
        else:
            scope.take(block)

    def _open(self, block: Block, kind: str, inside: str) -> None:
        if self.here[-1][0] != inside:
            raise InputFileError(f"{block.place}: must stand {'in an assembly' if inside else 'outside of all others'}")
        self.here.append((kind, Scope(block.required("NAME"))))

    def bodies(self, path: Path) -> list[Body]:
        """Return every instance, or the parts and the model where nothing is instanced."""
        if len(self.here) > 1:
            raise InputFileError(f"{path}: ends within a *{self.here[-1][0]}; the file is truncated")
        bodies = [Body("", "", self.model)]
        for block, own in self.instances:
            part = self.parts.get(block.required("PART"))
            if part is None:
                raise InputFileError(f"{block.place}: there is no part {block.options['PART']}")
            bodies.append(Body(own.name, part.name, _joined(part, own), instance_placement(block)))
        instanced = {body.part for body in bodies}
        left = [name for name, part in self.parts.items() if name not in instanced and part.elements]
        if self.has_assembly:
            self.idle = left
        else:
            bodies += [Body("", name, self.parts[name]) for name in left]
        _hand_down(self.assembly, {body.name: body for body in bodies if body.name})
        if self.assembly.elements:
            bodies.append(Body("", "ASSEMBLY", self.assembly))
        return bodies


def _joined(part: Scope, own: Scope) -> Scope:
    """Return an instance's scope: what its part holds, and what it holds itself."""
    for what, a, b in (("node", part.nodes, own.nodes), ("element", part.elements, own.elements)):
        both = set(a) & set(b)
        if both:
            raise InputFileError(
                f"instance {own.name}: {what} {min(both)} is defined in the instance and in its part {part.name}"
            )
    return replace(
        own,
        nodes=part.nodes | own.nodes,
        elements=part.elements | own.elements,
        sets={name: [*part.sets.get(name, []), *own.sets.get(name, [])] for name in part.sets | own.sets},
        blocks={k: part.blocks[k] | own.blocks[k] for k in part.blocks},
        sections=[*part.sections, *own.sections],
        passed_over=part.passed_over | own.passed_over,
    )


def _hand_down(assembly: Scope, bodies: dict[str, Body]) -> None:
    """Give every instance its share of the assembly's sets, under the assembly's names."""

    def share(name: str, above: tuple[str, ...]) -> list[tuple[str, Member]]:
        out: list[tuple[str, Member]] = []
        for member in assembly.sets[name]:
            if member.instance is not None:
                if member.instance not in bodies:
                    raise InputFileError(f"{member.row.place}: there is no instance {member.instance}")
                out.append((member.instance, member))
            elif isinstance(member.first, str):
                if member.first not in assembly.sets or member.first in above:
                    raise InputFileError(f"{member.row.place}: the element set {member.first} is not defined")
                out += share(member.first, (*above, name))
        return out

    found = {name: share(name, ()) for name in assembly.sets}
    for name, entries in found.items():
        for instance, member in entries:
            sets = bodies[instance].scope.sets
            if member.first == name:  # the part's own set of the same name
                continue
            sets.setdefault(name, []).append(member)
