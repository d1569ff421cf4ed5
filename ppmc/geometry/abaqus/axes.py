"""Local axes of elements: *ORIENTATION in every system, its extra rotations, *DISTRIBUTION, and shells.

The axes are those of Abaqus' analysis guide, "Orientations": points a and b, with c the origin, give for RECTANGULAR
axis 1 through a and the plane of 1 and 2 through b; for Z RECTANGULAR axis 3 through a and the plane of 1 and 3
through b; for CYLINDRICAL the axis a-b, with 1 radial, 2 circumferential, 3 axial; for SPHERICAL the centre a and the
polar axis a-b, with 1 radial, 2 circumferential, 3 meridional. Then everything turns about one of the local axes. In
shells the axis that follows this one in the order 1, 2, 3 is projected onto the surface and becomes material axis 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.geometry.abaqus.deck import Body
from ppmc.geometry.abaqus.lines import Block, Row, real
from ppmc.geometry.abaqus.scope import Element

Array = NDArray[np.float64]
SYSTEMS = ("RECTANGULAR", "Z RECTANGULAR", "CYLINDRICAL", "SPHERICAL")
SMALL = 1e-10
NOWHERE = Row("", (Path(), 0))


def material_axes(body: Body, elements: Sequence[Element], centres: Array) -> Array:
    """Return the material axes of elements where they stand.

    Parameters
    ----------
    body : Body
    elements : sequence of Element
        Of the body, m of them.
    centres : ndarray, shape (m, 3)
        Their centres in the part's own axes.

    Returns
    -------
    ndarray, shape (m, 3, 3)
        Row k is axis k + 1, in the axes of the model.

    Raises
    ------
    InputFileError
        Naming line and keyword, if an element has no axes or they cannot be worked out.
    """
    out = np.full((len(elements), 3, 3), np.nan)
    place = {element.number: k for k, element in enumerate(elements)}
    for block, numbers in _orientations(body, elements).items():
        index = np.array([place[n] for n in numbers])
        out[index] = _axes(body, block, [elements[k] for k in index], centres[index])
    return np.asarray(out @ body.placement.rotation.T)


def _orientations(body: Body, elements: Sequence[Element]) -> dict[Block, list[int]]:
    """Return the labels that each *ORIENTATION (or lone *DISTRIBUTION) rules."""
    scope = body.scope
    named = scope.blocks["ORIENTATION"]
    users = [s for s in scope.sections if s.name("ORIENTATION")]
    if not users:
        lone = list(named.values()) or list(scope.blocks["DISTRIBUTION"].values())
        if len(lone) == 1:
            return {lone[0]: [element.number for element in elements]}
        if not lone:
            raise InputFileError(
                f"{elements[0].place}: neither *ORIENTATION nor *DISTRIBUTION gives its axes; orientations are read "
                "from these"
            )
        names = " and ".join(block.place for block in lone[:3])
        raise InputFileError(
            f"{names}: no section says with ORIENTATION= which elements they rule; add *SOLID SECTION, ELSET=, "
            "ORIENTATION="
        )
    ruled: dict[int, Block] = {}
    for section in scope.sections:
        name = section.name("ORIENTATION")
        numbers = scope.members(section.required("ELSET"), section.place)
        if name is None:
            for number in numbers:
                ruled.pop(number, None)
            continue
        if "COMPOSITE" in section.options:
            raise InputFileError(f"{section.place}, COMPOSITE has directions ply by ply; give one direction an element")
        if section.options.get("STACK DIRECTION", "3") != "3":
            raise InputFileError(
                f"{section.place}, STACK DIRECTION={section.options['STACK DIRECTION']} is not worked out"
            )
        if name not in named:
            raise InputFileError(f"{section.place}: there is no *ORIENTATION, NAME={name} beside it")
        ruled |= dict.fromkeys(numbers, named[name])
    out: dict[Block, list[int]] = {}
    for element in elements:
        if element.number not in ruled:
            raise InputFileError(
                f"{element.place}: no section with ORIENTATION= gives its axes, though others have them; give it one, "
                "or leave it out of the file"
            )
        out.setdefault(ruled[element.number], []).append(element.number)
    return out


def _axes(body: Body, block: Block, elements: list[Element], centres: Array) -> Array:
    """Return the axes that one *ORIENTATION gives its elements, in the part's axes."""
    if block.keyword == "DISTRIBUTION":
        points = _distributed(body, block, elements, (6, 9))
        return _checked(_rectangular(*_abc(points)), block, elements)
    system = block.name("SYSTEM") or "RECTANGULAR"
    if system not in SYSTEMS or "LOCAL DIRECTIONS" in block.options:
        which = f"SYSTEM={system}" if system not in SYSTEMS else "LOCAL DIRECTIONS="
        raise InputFileError(f"{block.place}, {which} is not worked out here; known are SYSTEM={', '.join(SYSTEMS)}")
    if not block.rows or len(block.rows) > 2:
        raise InputFileError(f"{block.place}: has {len(block.rows)} data lines; it takes one or two")
    a, b, c = _defining_points(body, block, elements)
    if system == "RECTANGULAR":
        axes = _rectangular(a, b, c)
    elif system == "Z RECTANGULAR":
        axes = _rectangular(a, b, c)[:, [1, 2, 0]]
    else:
        axes = _round(a, b, centres, spherical=system == "SPHERICAL")
    axes = _checked(axes, block, elements)
    about, angles = _rotation(body, block, elements)
    second, third = (about + 1) % 3, (about + 2) % 3
    cos, sin = np.cos(np.radians(angles))[:, None], np.sin(np.radians(angles))[:, None]
    axes[:, second], axes[:, third] = (
        cos * axes[:, second] + sin * axes[:, third],
        cos * axes[:, third] - sin * axes[:, second],
    )
    return _on_shells(body, axes, about, elements, block)


def _abc(points: Array) -> tuple[Array, Array, Array]:
    """Return points a, b and c of six or nine numbers each."""
    c = points[:, 6:9] if points.shape[1] == 9 else np.zeros((len(points), 3))
    return points[:, :3], points[:, 3:6], c


def _defining_points(body: Body, block: Block, elements: list[Element]) -> tuple[Array, Array, Array]:
    """Return points a, b, c of every element, each of shape (m, 3)."""
    row, m = block.rows[0], len(elements)
    words = [word for word in row.fields if word]
    kind = block.name("DEFINITION") or "COORDINATES"
    if kind == "COORDINATES" and len(words) == 1 and _is_name(words[0]):
        name = words[0].strip('"').upper()
        if name not in body.scope.blocks["DISTRIBUTION"]:
            raise InputFileError(f"{row.place}: there is no *DISTRIBUTION, NAME={name} beside the *ORIENTATION")
        return _abc(_distributed(body, body.scope.blocks["DISTRIBUTION"][name], elements, (6, 9)))
    if kind == "COORDINATES":
        values = np.zeros(9)
        if len(row.fields) > 10 or len(words) < 2:
            raise InputFileError(
                f"{row.place}: *ORIENTATION takes six or nine numbers (points a, b, c), not '{row.text}'"
            )
        for k, word in enumerate(row.fields[:9]):
            values[k] = real(word, row)
        return _abc(np.tile(values, (m, 1)))
    if kind not in ("NODES", "OFFSET TO NODES"):
        raise InputFileError(f"{block.place}, DEFINITION={kind} is not known")
    numbers = [int(real(word, row)) for word in words]
    if len(numbers) not in (2, 3):
        raise InputFileError(f"{row.place}: DEFINITION={kind} takes two or three nodes (a, b, c), not '{row.text}'")
    out = np.zeros((m, 3, 3))
    for k, element in enumerate(elements):
        if kind == "OFFSET TO NODES":
            points = body.scope.points(element)
            if max(numbers) > len(points) or min(numbers) < 1:
                raise InputFileError(f"{row.place}: {element.place} has no local node {max(numbers)}")
            out[k, : len(numbers)] = points[np.array(numbers) - 1]
            if len(numbers) == 2:
                out[k, 2] = points[0]
            continue
        for j, n in enumerate(numbers):
            if n not in body.scope.nodes:
                raise InputFileError(f"{row.place}: there is no node {n}")
            out[k, j] = body.scope.nodes[n]
    return out[:, 0], out[:, 1], out[:, 2]


def _is_name(word: str) -> bool:
    try:
        real(word, NOWHERE)
    except InputFileError:
        return True
    return False


def _rotation(body: Body, block: Block, elements: list[Element]) -> tuple[int, Array]:
    """Return the local axis (from 0) about which everything turns, and the angle of each element in degrees."""
    if len(block.rows) < 2:
        return 0, np.zeros(len(elements))
    row = block.rows[1]
    words = [*row.fields, "", ""]
    if words[0] not in ("", "1", "2", "3") or any(words[2:]):
        raise InputFileError(f"{row.place}: the second line of *ORIENTATION is an axis (1, 2, 3) and an angle")
    axis = int(words[0] or "1") - 1
    if words[1] and _is_name(words[1]):
        name = words[1].strip('"').upper()
        if name not in body.scope.blocks["DISTRIBUTION"]:
            raise InputFileError(f"{row.place}: '{words[1]}' is neither an angle nor a *DISTRIBUTION beside it")
        return axis, _distributed(body, body.scope.blocks["DISTRIBUTION"][name], elements, (1,))[:, 0]
    return axis, np.full(len(elements), real(words[1], row))


def _distributed(body: Body, block: Block, elements: list[Element], sizes: tuple[int, ...]) -> Array:
    """Return what a *DISTRIBUTION gives every element, shape (m, size)."""
    location = block.name("LOCATION") or "ELEMENT"
    if location != "ELEMENT":
        raise InputFileError(f"{block.place}, LOCATION={location}: directions are read by element")
    default: list[float] | None = None
    given: dict[int, list[float]] = {}
    wanted = " or ".join(map(str, sizes))
    for row in block.rows:
        words = row.fields
        values = [real(word, row) for word in (words[1:-1] if words[-1] == "" else words[1:])]
        if len(values) not in sizes or not np.isfinite(values).all():
            raise InputFileError(
                f"{row.place}: a line of *DISTRIBUTION has a label and {wanted} numbers, not '{row.text}'"
            )
        if not words[0]:
            default = values
            continue
        for number in _labels(body, words[0], row):
            given[number] = values
    rows = [given.get(element.number, default) for element in elements]
    for element, found in zip(elements, rows, strict=True):
        if found is None:
            raise InputFileError(f"{element.place} has no line in the distribution {block.place}, which has no default")
    size = {len(found) for found in rows if found is not None}
    if len(size) > 1:
        raise InputFileError(f"{block.place}: its lines have {' and '.join(map(str, sorted(size)))} numbers")
    return np.array(rows, dtype=np.float64)


def _labels(body: Body, word: str, row: Row) -> list[int]:
    """Return the elements that the first word of a line means: a label or a set, of the body itself."""
    name = word.strip('"').upper()
    if body.name and name.startswith(f"{body.name}."):
        name = name[len(body.name) + 1 :]
    if name.isdigit():
        return [int(name)]
    return body.scope.members(name, f"{row.place}: *DISTRIBUTION")


def _unit(v: Array) -> Array:
    """Return vectors of unit length, NaN for those without."""
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(size > SMALL, v / size, np.nan))


def _rectangular(a: Array, b: Array, c: Array) -> Array:
    """Return axes whose first runs from c to a and whose second lies in the plane with b; shape (m, 3, 3)."""
    e1 = _unit(a - c)
    e3 = _unit(np.cross(e1, _unit(b - c)))
    return np.stack([e1, np.cross(e3, e1), e3], axis=1)


def _round(a: Array, b: Array, x: Array, *, spherical: bool) -> Array:
    """Return radial, circumferential and axial (or meridional) axes about a-b, shape (m, 3, 3)."""
    e3 = _unit(b - a)
    away = x - a
    if spherical:
        e1 = _unit(away)
        e2 = _unit(np.cross(e3, e1))
        return np.stack([e1, e2, np.cross(e1, e2)], axis=1)
    e1 = _unit(away - np.sum(away * e3, axis=1, keepdims=True) * e3)
    return np.stack([e1, np.cross(e3, e1), e3], axis=1)


def _checked(axes: Array, block: Block, elements: list[Element]) -> Array:
    """Refuse axes that the points do not settle."""
    bad = np.flatnonzero(~np.isfinite(axes).all(axis=(1, 2)))
    if len(bad):
        raise InputFileError(
            f"{block.place}: its points do not settle the axes of element {elements[bad[0]].number} (they lie on one "
            "line, or the element on the axis)"
        )
    return axes


def _on_shells(body: Body, axes: Array, about: int, elements: list[Element], block: Block) -> Array:
    """Project the axes of shells onto their surfaces; those of solids stay."""
    flat = [k for k, e in enumerate(elements) if e.shape.family == "shell" or e.type_name.startswith("SC")]
    for k in flat:
        points = body.scope.points(elements[k])
        if elements[k].shape.family == "shell":
            corners = points[: elements[k].shape.corners]
        else:  # continuum shells: the surface half-way through their thickness
            half = elements[k].shape.corners // 2
            corners = 0.5 * (points[:half] + points[half : 2 * half])
        n = np.cross(
            corners[2] - corners[0], corners[-1] - corners[1] if len(corners) == 4 else corners[2] - corners[1]
        )
        n = _unit(n)
        first = axes[k, (about + 1) % 3]
        e1 = _unit(first - (first @ n) * n)
        if not np.isfinite(e1).all():
            raise InputFileError(
                f"{elements[k].place}: axis {(about + 1) % 3 + 1} of {block.place} stands upright on the shell; name "
                "the axis nearest to its normal in the second line"
            )
        axes[k] = [e1, np.cross(n, e1), n]
    return axes
