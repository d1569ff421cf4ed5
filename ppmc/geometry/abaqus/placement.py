"""Where nodes stand: *SYSTEM, *NODE with SYSTEM=, and the place of an *INSTANCE."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.geometry.abaqus.lines import Block, real

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Placement:
    """A turn and then a shift: x -> R x + shift.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
    shift : ndarray, shape (3,)
    """

    rotation: Array = field(default_factory=lambda: np.eye(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))

    def apply(self, points: Array) -> Array:
        """Return placed points, shape (n, 3)."""
        return np.asarray(points @ self.rotation.T + self.shift)


def turn(axis: Array, degrees: float) -> Array:
    """Return the right-handed rotation matrix about an axis (Rodrigues' formula)."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    a = np.radians(degrees)
    return np.asarray(np.eye(3) + np.sin(a) * K + (1.0 - np.cos(a)) * (K @ K))


def instance_placement(block: Block) -> Placement:
    """Return the place of an instance: shifted first, then turned about an axis in space.

    Raises
    ------
    InputFileError
        If the lines are not three numbers, and seven for a turn.
    """
    rows = [[real(word, row) for word in _without_last(row.fields)] for row in block.rows]
    if len(rows) > 2 or (rows and len(rows[0]) > 3) or (len(rows) == 2 and len(rows[1]) != 7):
        raise InputFileError(
            f"{block.place}: its place must be a line of three numbers (shift) and, for a turn, one of seven (two "
            "points of the axis, angle)"
        )
    shift = np.zeros(3)
    if rows:
        shift[: len(rows[0])] = rows[0]
    if len(rows) < 2:
        return Placement(shift=shift)
    a, b, angle = np.array(rows[1][:3]), np.array(rows[1][3:6]), rows[1][6]
    if not np.any(b - a):
        raise InputFileError(f"{block.rows[1].place}: the two points of the axis of *INSTANCE are the same")
    R = turn(b - a, angle)
    return Placement(R, R @ (shift - a) + a)


def system_placement(block: Block) -> Placement:
    """Return the system in which the nodes after a *SYSTEM are given; without data the global one.

    Points a (origin), b (on axis 1) and c (in the plane of 1 and 2); without c, axis 3 stays the global one and axis 1
    is the projection of a to b; without b, the system is shifted only.

    Raises
    ------
    InputFileError
        If the points lie on a line or are not whole.
    """
    values = [real(word, row) for row in block.rows for word in _without_last(row.fields)]
    if len(values) > 9 or (len(values) > 3 and len(values) % 3):
        raise InputFileError(
            f"{block.place}: holds {len(values)} numbers; it takes three, six or nine (points a, b, c)"
        )
    points = np.zeros(9)
    points[: len(values)] = values
    a, b, c = points.reshape(3, 3)
    if len(values) <= 3:
        return Placement(shift=a)
    if len(values) == 6:
        first = np.array([b[0] - a[0], b[1] - a[1], 0.0])
        third = np.array([0.0, 0.0, 1.0])
    else:
        first = b - a
        third = np.cross(first, c - a)
    if np.linalg.norm(first) < 1e-12 or np.linalg.norm(third) < 1e-12:
        raise InputFileError(f"{block.place}: its points lie on one line, or two of them are the same")
    e1, e3 = first / np.linalg.norm(first), third / np.linalg.norm(third)
    return Placement(np.column_stack([e1, np.cross(e3, e1), e3]), a)


def from_cylinder(points: Array) -> Array:
    """Return Cartesian coordinates of (radius, angle in degrees, height), shape (n, 3)."""
    angle = np.radians(points[:, 1])
    return np.column_stack([points[:, 0] * np.cos(angle), points[:, 0] * np.sin(angle), points[:, 2]])


def _without_last(fields: list[str]) -> list[str]:
    """Return the fields without the empty one after a last comma."""
    return fields[:-1] if fields and not fields[-1] else fields
