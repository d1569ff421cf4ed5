"""Abaqus .inp: one PC3D element a particle, its local axes in a *Distribution, platelets as element sets.

Local axis 1 is the fibre direction p, axis 2 the in-plane direction q, so that axis 3 is the platelet normal r.
A distribution of COORD3D, COORD3D gives for each element the points a (on axis 1) and b (in the plane of 1 and 2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.exchange.points import OrientedPoints
from ppmc.errors import InputFileError
from ppmc.orientation import orthonormal_frame

DEFAULT = "1., 0., 0., 0., 1., 0."


def write(path: Path, points: OrientedPoints) -> None:
    """Write an input file to be included in a model: nodes, elements, platelet sets, distribution and orientation."""
    n = len(points.positions)
    frames = np.hstack([points.fibre_direction, points.in_plane_direction])
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


def _blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Yield keyword, options and data lines of every block."""
    keyword, options, lines = "", dict[str, str](), list[str]()
    for raw in path.read_text(encoding="utf-8", errors="replace").splitlines():
        line = raw.strip()
        if line.startswith("**") or not line:
            continue
        if line.startswith("*"):
            if keyword:
                yield keyword, options, lines
            head, *rest = [part.strip() for part in line[1:].split(",")]
            keyword, lines = head.lower(), []
            options = {k.strip().lower(): v.strip() for k, _, v in (part.partition("=") for part in rest)}
        else:
            lines.append(line)
    if keyword:
        yield keyword, options, lines


def _numbers(lines: list[str], path: Path, what: str) -> list[list[float]]:
    """Return the numbers of data lines.

    Raises
    ------
    InputFileError
        If one is none.
    """
    try:
        return [[float(v) for v in line.split(",") if v.strip()] for line in lines]
    except ValueError as error:
        raise InputFileError(f"{path}: a line of {what} holds something that is no number ({error})") from None


def read(path: Path) -> OrientedPoints:
    """Read nodes, elements and a *Distribution of local axes by element; element sets PLATELET-<k> give platelets.

    Raises
    ------
    InputFileError
        If nodes, elements or the distribution are missing, or an element has no orientation.
    """
    nodes: dict[int, list[float]] = {}
    elements: dict[int, list[int]] = {}
    axes: dict[int, list[float]] = {}
    default: list[float] | None = None
    platelets: dict[int, int] = {}
    for keyword, options, lines in _blocks(path):
        if keyword == "node":
            nodes |= {int(row[0]): row[1:4] for row in _numbers(lines, path, "*Node")}
        elif keyword == "element":
            elements |= {int(row[0]): [int(v) for v in row[1:]] for row in _numbers(lines, path, "*Element")}
        elif keyword == "distribution" and options.get("location", "").lower() == "element":
            for line, row in zip(lines, _numbers(lines, path, "*Distribution"), strict=True):
                if line.startswith(","):
                    default = row[:6]
                else:
                    axes[int(row[0])] = row[1:7]
        elif keyword == "elset" and options.get("elset", "").upper().startswith("PLATELET-"):
            number = options["elset"][len("PLATELET-") :]
            if number.isdigit():
                platelets |= {int(v): int(number) for row in _numbers(lines, path, "*Elset") for v in row}
    found = {"*Node": nodes, "*Element": elements, "*Distribution, location=element": axes or default}
    missing = [name for name, content in found.items() if not content]
    if missing:
        raise InputFileError(f"{path}: no {', '.join(missing)}; orientations are read from a distribution by element")
    rows = []
    for label, corners in elements.items():
        row = axes.get(label, default or [])
        if len(row) != 6:
            raise InputFileError(f"{path}: element {label} has no six numbers (axis 1, axis 2) in the distribution")
        unknown = [c for c in corners if c not in nodes]
        if unknown:
            raise InputFileError(f"{path}: element {label} refers to node {unknown[0]}, which the file does not define")
        rows.append((np.mean([nodes[c] for c in corners], axis=0), row))
    positions = np.array([row[0] for row in rows])
    both = np.array([row[1] for row in rows])
    p, _, r = orthonormal_frame(both[:, :3], both[:, 3:])
    ids = np.array([platelets.get(label, -1) for label in elements], dtype=np.int64) if platelets else None
    return OrientedPoints(positions, p, r, None, ids)
