"""Regions of space to average over: boxes, slabs, cylinders and their sectors, spheres, anywhere and any way turned.

Every region is an interval in local coordinates: ``u = axes @ (x - origin)`` with the rows of ``axes`` as the local
unit axes. A box bounds u itself, a cylinder bounds (radius, angle, height) about its local third axis, a sphere
bounds the radius.
Intervals are half-open, ``lower <= u < upper``, so regions that share a face never count a particle twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ppmc.errors import SceneError

BOX, CYLINDER, SPHERE = 0, 1, 2
KINDS = {"box": BOX, "cylinder": CYLINDER, "sphere": SPHERE}
TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Region:
    """A named piece of space.

    Parameters
    ----------
    name
        As it appears in tables and captions.
    kind
        ``"box"``, ``"cylinder"`` or ``"sphere"``.
    origin : ndarray, shape (3,)
        Origin of the local coordinates, mm.
    axes : ndarray, shape (3, 3)
        Rows are the local unit axes in tool coordinates.
    lower, upper : ndarray, shape (3,)
        Box: bounds of u (mm). Cylinder: bounds of radius (mm), angle (rad, from the first local axis towards the
        second) and height (mm).
        Sphere: bounds of the radius in the first entry. Infinite bounds are allowed.
    """

    name: str
    kind: str
    origin: np.ndarray
    axes: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def volume(self) -> float:
        """Geometric volume in mm³; infinite when a bound is."""
        size = self.upper - self.lower
        if self.kind == "box":
            return float(np.prod(size))
        if self.kind == "cylinder":
            return float(0.5 * min(size[1], TURN) * (self.upper[0] ** 2 - self.lower[0] ** 2) * size[2])
        return float(4.0 / 3.0 * np.pi * (self.upper[0] ** 3 - self.lower[0] ** 3))

    @property
    def centre(self) -> np.ndarray:
        """Middle of the region in tool coordinates; for unbounded directions the local origin."""
        return self.centre_near(self.origin)

    def centre_near(self, point: np.ndarray) -> np.ndarray:
        """Return the middle of the region; in directions without bounds, the place of `point` (such as a centroid)."""
        low, high = self.lower, self.upper
        if self.kind == "sphere":
            return self.origin.copy()
        bounded = np.isfinite(low) & np.isfinite(high)
        middle = 0.5 * (np.where(bounded, low, 0.0) + np.where(bounded, high, 0.0))
        if self.kind == "cylinder":
            full = high[1] - low[1] >= TURN - 1e-12
            radius = 0.0 if full else middle[0]
            middle = np.array([radius * np.cos(middle[1]), radius * np.sin(middle[1]), middle[2]])
        else:
            middle = np.where(bounded, middle, self.axes @ (point - self.origin))
        return np.asarray(self.origin + self.axes.T @ middle)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Axis-aligned box (tool coordinates) that encloses the region, from its support function."""
        high = np.array([self._support(self.axes[:, i]) for i in range(3)])
        low = -np.array([self._support(-self.axes[:, i]) for i in range(3)])
        return self.origin + low, self.origin + high

    def _support(self, direction: np.ndarray) -> float:
        """Largest value of ``direction . u`` over the region, direction in local coordinates."""

        def extreme(d: float, low: float, high: float) -> float:
            return 0.0 if abs(d) < 1e-15 else max(d * low, d * high)

        if self.kind == "box":
            return sum(extreme(direction[i], self.lower[i], self.upper[i]) for i in range(3))
        if self.kind == "sphere":
            return float(self.upper[0])
        along = extreme(direction[2], self.lower[2], self.upper[2])
        in_plane = float(np.hypot(direction[0], direction[1]))
        if in_plane < 1e-15:
            return along
        start, end = self.lower[1], self.upper[1]
        offset = (np.arctan2(direction[1], direction[0]) - start) % TURN
        if offset <= end - start:
            return along + in_plane * float(self.upper[0])
        corners = [
            radius * (direction[0] * np.cos(angle) + direction[1] * np.sin(angle))
            for radius in (self.lower[0], self.upper[0])
            for angle in (start, end)
        ]
        return along + float(max(corners))

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Tell which of ``points`` (n, 3) lie in the region."""
        u = (np.asarray(points, dtype=float) - self.origin) @ self.axes.T
        low, high = self.lower, self.upper
        if self.kind == "box":
            return np.asarray(((u >= low) & (u < high)).all(axis=1))
        if self.kind == "sphere":
            radius = np.sqrt((u * u).sum(axis=1))
            return np.asarray((radius >= low[0]) & (radius < high[0]))
        radius = np.hypot(u[:, 0], u[:, 1])
        span = high[1] - low[1]
        angle = (np.arctan2(u[:, 1], u[:, 0]) - low[1]) % TURN
        within = (angle < span) if span < TURN - 1e-12 else np.ones(len(u), dtype=bool)
        return np.asarray((radius >= low[0]) & (radius < high[0]) & within & (u[:, 2] >= low[2]) & (u[:, 2] < high[2]))

    def rotated(self, rotation: np.ndarray) -> Region:
        """Return the region carried along by the rigid rotation ``x -> rotation @ x``."""
        return replace(self, origin=rotation @ self.origin, axes=self.axes @ rotation.T)

    def describe(self) -> str:
        """One line for captions: kind, place and size with units."""
        if not np.isfinite(self.lower).any() and not np.isfinite(self.upper).any():
            return "all of space"
        size = self.upper - self.lower
        centre = ", ".join(f"{c:.4g}" for c in self.centre)
        if self.kind == "box":
            return f"box {' × '.join('∞' if np.isinf(s) else f'{s:.4g}' for s in size)} mm centred at ({centre}) mm"
        if self.kind == "sphere":
            return f"sphere of radius {self.upper[0]:.4g} mm centred at ({centre}) mm"
        axis = ", ".join(f"{c:.3g}" for c in self.axes[2])
        return (
            f"cylinder, radius {self.lower[0]:.4g} to {self.upper[0]:.4g} mm, "
            f"{np.degrees(min(size[1], TURN)):.4g}° wide, "
            f"{size[2]:.4g} mm high along ({axis}), centred at ({centre}) mm"
        )


def everything(name: str = "whole") -> Region:
    """Return the region that holds every point."""
    return Region(name, "box", np.zeros(3), np.eye(3), np.full(3, -np.inf), np.full(3, np.inf))


def box(
    name: str, lower: ArrayLike, upper: ArrayLike, axes: ArrayLike | None = None, origin: ArrayLike | None = None
) -> Region:
    """Return a box between ``lower`` and ``upper`` (mm) in the frame ``axes`` (rows) about ``origin``.

    Raises
    ------
    SceneError
        If an upper bound is not above its lower bound.
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    _check_order(name, low, high)
    return Region(
        name, "box", np.zeros(3) if origin is None else np.asarray(origin, dtype=float), _frame(axes), low, high
    )


def cylinder(
    name: str,
    centre: ArrayLike,
    axis: ArrayLike,
    height: float,
    outer_radius: float,
    inner_radius: float = 0.0,
    start_angle: float = 0.0,
    end_angle: float = TURN,
    reference: ArrayLike | None = None,
) -> Region:
    """Return a cylinder, tube or sector of one, centred at mid-height (mm, rad).

    ``reference`` is the direction of angle zero (its part normal to ``axis`` counts); angles grow right-handed about
    ``axis``.

    Raises
    ------
    SceneError
        If a radius, the height or the angle range is empty.
    """
    low = np.array([inner_radius, start_angle, -0.5 * height])
    high = np.array([outer_radius, end_angle, 0.5 * height])
    _check_order(name, low, high)
    return Region(name, "cylinder", np.asarray(centre, dtype=float), frame_about(axis, reference), low, high)


def sphere(name: str, centre: ArrayLike, radius: float) -> Region:
    """Return a ball of ``radius`` mm."""
    low, high = np.zeros(3), np.array([radius, 0.0, 0.0])
    _check_order(name, low[:1], high[:1])
    return Region(name, "sphere", np.asarray(centre, dtype=float), np.eye(3), low, high)


def frame_about(axis: ArrayLike, reference: ArrayLike | None = None) -> np.ndarray:
    """Return rows (e1, e2, axis) of a right-handed frame with e1 along the part of ``reference`` normal to ``axis``."""
    third = np.asarray(axis, dtype=float)
    third = third / np.linalg.norm(third)
    if reference is None:
        reference = np.eye(3)[int(np.argmin(np.abs(third)))]
    first = np.asarray(reference, dtype=float)
    first = first - (first @ third) * third
    length = np.linalg.norm(first)
    if length < 1e-9:
        raise SceneError(
            f"reference direction {np.asarray(reference)} is parallel to the axis {np.asarray(axis)}; choose another"
        )
    first = first / length
    return np.array([first, np.cross(third, first), third])


def pack(regions: list[Region] | tuple[Region, ...]) -> tuple[np.ndarray, ...]:
    """Return kinds (m,), origins (m, 3), axes (m, 3, 3), lower, upper (m, 3), enclosing boxes (m, 2, 3) for kernels."""
    m = len(regions)
    boxes = np.array([region.bounds() for region in regions]).reshape(m, 2, 3)
    return (
        np.array([KINDS[region.kind] for region in regions], dtype=np.int64),
        np.array([region.origin for region in regions]).reshape(m, 3),
        np.array([region.axes for region in regions]).reshape(m, 3, 3),
        np.array([region.lower for region in regions]).reshape(m, 3),
        np.array([region.upper for region in regions]).reshape(m, 3),
        boxes,
    )


def _frame(axes: ArrayLike | None) -> np.ndarray:
    frame = np.eye(3) if axes is None else np.asarray(axes, dtype=float)
    if frame.shape != (3, 3) or not np.allclose(frame @ frame.T, np.eye(3), atol=1e-8):
        raise SceneError("axes of a region must be three orthonormal rows")
    return frame


def _check_order(name: str, low: np.ndarray, high: np.ndarray) -> None:
    if not (high > low).all():
        raise SceneError(f"region '{name}': upper bounds {high.tolist()} must be above lower bounds {low.tolist()}")
