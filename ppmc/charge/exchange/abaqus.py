"""Abaqus .inp: one PC3D element a particle, its local axes in a *Distribution, platelets as element sets.

Local axis 1 is the fibre direction p, axis 2 the in-plane direction q, so that axis 3 is the platelet normal r.
A distribution of COORD3D, COORD3D gives for each element the points a (on axis 1) and b (in the plane of 1 and 2).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.exchange.points import oriented_points
from ppmc.errors import InputFileError
from ppmc.geometry.abaqus import Body, material_axes, read_deck
from ppmc.notices import notice
from ppmc.orientation import in_plane_from_normal
from ppmc.particles import Particles

DEFAULT = "1., 0., 0., 0., 1., 0."


def write(path: Path, points: Particles) -> None:
    """Write an input file to be included in a model: nodes, elements, platelet sets, distribution and orientation."""
    n = len(points.positions)
    frames = np.hstack([points.p, in_plane_from_normal(points.p, points.r)])
    with path.open("w", encoding="ascii") as file:
        file.write(
            "** Particles of a platelet charge; mm. Axis 1 is the fibre direction, axis 3 the platelet normal.\n"
        )
        file.write("*Node\n")
        file.writelines(f"{k}, {x:.9g}, {y:.9g}, {z:.9g}\n" for k, (x, y, z) in enumerate(points.positions.tolist(), 1))
        file.write("*Element, type=PC3D, elset=CHARGE\n")
        file.writelines(f"{k}, {k}\n" for k in range(1, n + 1))
        if points.platelet_id is not None:
            _write_platelets(file.write, points.platelet_id)
        file.write("*Distribution Table, name=PLATELET_AXES_TABLE\ncoord3D, coord3D\n")
        file.write("*Distribution, name=PLATELET_AXES, location=element, table=PLATELET_AXES_TABLE\n")
        file.write(f", {DEFAULT}\n")
        file.writelines(
            f"{k}, " + ", ".join(f"{v:.9g}" for v in row) + "\n" for k, row in enumerate(frames.tolist(), 1)
        )
        file.write("*Orientation, name=PLATELET_ORIENTATION, system=rectangular\nPLATELET_AXES\n3, 0.\n")


def _write_platelets(write: Callable[[str], int], platelet_id: NDArray[np.int64]) -> None:
    """Write an element set for every platelet, sixteen labels a line."""
    order = np.argsort(platelet_id, kind="stable")
    ids, starts = np.unique(platelet_id[order], return_index=True)
    for k, labels in zip(ids.tolist(), np.split(order + 1, starts[1:]), strict=True):
        if k < 0:
            continue
        write(f"*Elset, elset=PLATELET-{k}\n")
        for first in range(0, len(labels), 16):
            write(", ".join(map(str, labels[first : first + 16])) + "\n")


def read(path: Path) -> Particles:
    """Read the material axes of elements; element sets PLATELET-<k> give platelets.

    Axis 1 is p, axis 3 r; a point stands at the mean of an element's corners. What is read and what is refused is
    told in `ppmc.geometry.abaqus`.

    Raises
    ------
    InputFileError
        If there are no elements, or one has no axes; naming line and keyword.
    """
    deck = read_deck(path)
    for note in deck.notes:
        notice(note)
    if not deck.bodies:
        raise InputFileError(f"{path}: no *ELEMENT that could hold fibres; orientations are read by element")
    parts = [_of_body(body) for body in deck.bodies]
    positions, axes, ids = (np.concatenate(values) for values in zip(*parts, strict=True))
    return oriented_points(str(path), positions, axes[:, 0], axes[:, 2], None, ids if (ids >= 0).any() else None)


def _of_body(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return positions, axes and platelets of the elements of one body."""
    elements = list(body.scope.elements.values())
    centres = np.array([body.scope.points(e)[: e.shape.corners].mean(axis=0) for e in elements])
    axes = material_axes(body, elements, centres)
    platelets: dict[int, int] = {}
    for name in body.scope.sets:
        number = name.removeprefix("PLATELET-")
        if name != number and number.isdigit():
            platelets |= dict.fromkeys(body.scope.members(name, f"*ELSET, ELSET={name}"), int(number))
    ids = np.array([platelets.get(element.number, -1) for element in elements], dtype=np.int64)
    return body.placement.apply(centres), axes, ids
