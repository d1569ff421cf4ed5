"""What stands in one part, instance, assembly or flat model: nodes, elements, sets, sections, orientations."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.geometry.abaqus.elements import Shape, shape_of
from ppmc.geometry.abaqus.lines import Block, Row, label, real
from ppmc.geometry.abaqus.placement import Placement, from_cylinder, system_placement

SECTIONS = {"SOLID SECTION", "SHELL SECTION", "SHELL GENERAL SECTION", "MEMBRANE SECTION", "COHESIVE SECTION"}


@dataclass(frozen=True)
class Element:
    """One element as the file gives it.

    Attributes
    ----------
    number : int
    type_name : str
        In capitals.
    shape : Shape
    nodes : tuple of int
        Labels, in Abaqus' order.
    where : tuple of (Path, int)
        File and line.
    """

    number: int
    type_name: str
    shape: Shape
    nodes: tuple[int, ...]
    where: tuple[Path, int]

    @property
    def place(self) -> str:
        """``file:line: element N``, as messages begin."""
        return f"{self.where[0]}:{self.where[1]}: element {self.number}"


@dataclass(frozen=True)
class Member:
    """One entry of a set: a label, a span of labels or the name of another set, perhaps of an instance."""

    first: int | str
    last: int
    step: int
    instance: str | None
    row: Row


@dataclass
class Scope:
    """Names and numbers that hold together.

    Attributes
    ----------
    name : str
        Of the part, instance or assembly; empty for a flat model.
    nodes : dict of int to tuple of float
        Coordinates in the part's own axes.
    elements : dict of int to Element
    sets : dict of str to list of Member
    blocks : dict of str to dict of str to Block
        ORIENTATION, DISTRIBUTION by name.
    sections : list of Block
    passed_over : dict of str to int
        Data lines of element types that hold no fibres.
    """

    name: str = ""
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[int, Element] = field(default_factory=dict)
    sets: dict[str, list[Member]] = field(default_factory=dict)
    blocks: dict[str, dict[str, Block]] = field(default_factory=lambda: {"ORIENTATION": {}, "DISTRIBUTION": {}})
    sections: list[Block] = field(default_factory=list)
    passed_over: dict[str, int] = field(default_factory=dict)
    system: Placement = field(default_factory=Placement)

    def take(self, block: Block) -> bool:
        """Take in a block that belongs to a scope; return whether it does.

        Raises
        ------
        InputFileError
            Naming line and keyword, if it cannot be understood.
        """
        if block.keyword == "NODE":
            self._nodes(block)
        elif block.keyword == "SYSTEM":
            self.system = system_placement(block)
        elif block.keyword == "ELEMENT":
            self._elements(block)
        elif block.keyword == "ELSET":
            self._set(block)
        elif block.keyword in self.blocks:
            name = block.required("NAME")
            if name in self.blocks[block.keyword]:
                raise InputFileError(f"{block.place}: the name {name} is taken by an earlier one")
            self.blocks[block.keyword][name] = block
        elif block.keyword in SECTIONS:
            self.sections.append(block)
        else:
            return False
        return True

    def _nodes(self, block: Block) -> None:
        system = (block.name("SYSTEM") or "R")[:1]
        if system not in ("R", "C"):
            raise InputFileError(
                f"{block.place}, SYSTEM={block.options['SYSTEM']}: nodes are read in Cartesian (R) and cylindrical (C) "
                "coordinates; write the mesh in one of these"
            )
        rows = [row.fields for row in block.rows]
        numbers = [label(words[0], row) for words, row in zip(rows, block.rows, strict=True)]
        points = np.zeros((len(rows), 3))
        for k, (words, row) in enumerate(zip(rows, block.rows, strict=True)):
            for axis, word in enumerate(words[1:4]):
                points[k, axis] = real(word, row)
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise InputFileError(
                f"{block.rows[bad[0]].place}: node {numbers[bad[0]]} is not finite: {points[bad[0]].tolist()}"
            )
        placed = self.system.apply(from_cylinder(points) if system == "C" else points).tolist()
        for number, point, row in zip(numbers, placed, block.rows, strict=True):
            if self.nodes.setdefault(number, tuple(point)) != tuple(point):
                raise InputFileError(f"{row.place}: node {number} stands elsewhere in an earlier line of *NODE")

    def _elements(self, block: Block) -> None:
        type_name = block.required("TYPE")
        shape = shape_of(type_name)
        if isinstance(shape, str):
            raise InputFileError(f"{block.place}, TYPE={type_name} cannot be mapped: {shape}")
        if shape is None:
            self.passed_over[type_name] = self.passed_over.get(type_name, 0) + len(block.rows)
            return
        words: list[str] = []
        row = None
        name = block.name("ELSET")
        members = self.sets.setdefault(name, []) if name else []
        for row in block.rows:
            fields = row.fields
            open_end = fields[-1] == ""
            if not words:
                start = row
            words += fields[:-1] if open_end else fields
            if len(words) <= shape.nodes or (open_end and len(words) <= shape.most):
                continue
            element = _element(words, type_name, shape, start)
            if element.number in self.elements:
                raise InputFileError(f"{element.place} is defined before: {self.elements[element.number].place}")
            self.elements[element.number] = element
            members.append(Member(element.number, element.number, 1, None, start))
            words = []
        if words and len(words) > shape.nodes:
            element = _element(words, type_name, shape, start)
            self.elements[element.number] = element
            members.append(Member(element.number, element.number, 1, None, start))
        elif words:
            raise InputFileError(
                f"{start.place}: element {words[0]} has {len(words) - 1} nodes, "
                f"one of TYPE={type_name} has {shape.nodes}"
            )

    def _set(self, block: Block) -> None:
        members = self.sets.setdefault(block.required("ELSET"), [])
        instance = block.name("INSTANCE")
        for row in block.rows:
            words = [word for word in row.fields if word]
            if "GENERATE" in block.options:
                numbers = [label(word, row) for word in words]
                if len(numbers) not in (2, 3) or numbers[1] < numbers[0]:
                    raise InputFileError(
                        f"{row.place}: a line of *ELSET, GENERATE is first, last, step; this one is '{row.text}'"
                    )
                step = numbers[2] if len(numbers) == 3 else 1
                if (numbers[1] - numbers[0]) % step:
                    raise InputFileError(
                        f"{row.place}: {numbers[1]} is not reached from {numbers[0]} in steps of {step} "
                        "(*ELSET, GENERATE)"
                    )
                members.append(Member(numbers[0], numbers[1], step, instance, row))
                continue
            members += [_member(word, instance, row) for word in words]

    def points(self, element: Element) -> NDArray[np.float64]:
        """Return the nodes of an element in the part's own axes, shape (n, 3).

        Raises
        ------
        InputFileError
            If one is not defined.
        """
        try:
            return np.array([self.nodes[n] for n in element.nodes])
        except KeyError as missing:
            raise InputFileError(f"{element.place} refers to node {missing}, which the file does not define") from None

    def members(self, name: str, place: str, above: tuple[str, ...] = ()) -> list[int]:
        """Return the labels in a set, sets in it included.

        Raises
        ------
        InputFileError
            If a set is not defined, or holds itself.
        """
        if name not in self.sets or name in above:
            why = "holds itself" if name in above else "is not defined"
            raise InputFileError(f"{place}: the element set {name} {why}")
        out: list[int] = []
        for member in self.sets[name]:
            if isinstance(member.first, str):
                out += self.members(member.first, member.row.place, (*above, name))
            else:
                out += range(member.first, member.last + 1, member.step)
        return out


def _member(word: str, instance: str | None, row: Row) -> Member:
    """Return what a word of a set means; ``PART-1-1.12`` is element 12 of an instance."""
    name = word.strip('"').upper()
    if instance is None and "." in name and not name.replace(".", "").isdigit():
        instance, _, name = name.rpartition(".")
    if name.isdigit():
        return Member(int(name), int(name), 1, instance, row)
    return Member(name, 0, 1, instance, row)


def _element(words: list[str], type_name: str, shape: Shape, row: Row) -> Element:
    """Return an element from its number and nodes."""
    number = label(words[0], row)
    if len(words) - 1 > shape.most:
        raise InputFileError(
            f"{row.place}: element {number} has {len(words) - 1} nodes, one of TYPE={type_name} has {shape.most}"
        )
    nodes = tuple(label(word, row) for word in words[1:])
    return Element(number, type_name, shape, nodes, row.where)
