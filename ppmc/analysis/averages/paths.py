"""Paths of inspection regions: where a path plot takes its averages, and in which components it shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ppmc.analysis.averages.regions import Region, box, cylinder, frame_about, sphere
from ppmc.errors import SceneError

AXIS_NAMES = ("x1", "x2", "x3")


@dataclass(frozen=True)
class InspectionPath:
    """A row of regions with a coordinate along it.

    Parameters
    ----------
    name
        As in tables and captions.
    coordinate : ndarray, shape (m,)
        Position of each region along the path.
    coordinate_label
        Axis label with unit, e.g. ``"x1 [mm]"``.
    regions : tuple of Region, length m
    frames : ndarray, shape (m, 3, 3)
        Rows are the axes the components refer to at each region.
    components : tuple of 3 str
        Their names, e.g. ``("1", "2", "3")`` or ``("r", "θ", "x1")``.
    description
        One line for captions.
    """

    name: str
    coordinate: np.ndarray
    coordinate_label: str
    regions: tuple[Region, ...]
    frames: np.ndarray
    components: tuple[str, str, str]
    description: str

    def __len__(self) -> int:
        return len(self.regions)


def straight_path(
    name: str,
    axis: int,
    slices: int,
    lower: ArrayLike,
    upper: ArrayLike,
) -> InspectionPath:
    """Cut a box into equal slices along one axis and average over width and thickness (J Figs 13 and 14).

    Parameters
    ----------
    name
        Name of the path.
    axis : int
        0, 1 or 2.
    slices : int
        Number of equal slices.
    lower, upper : ndarray, shape (3,)
        The box, mm; bounds across the path may be infinite.

    Raises
    ------
    SceneError
        If the box is empty or unbounded along the path.
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if not np.isfinite([low[axis], high[axis]]).all() or not high[axis] > low[axis]:
        raise SceneError(
            f"path '{name}': needs finite bounds along {AXIS_NAMES[axis]}, got {low[axis]} to {high[axis]} mm"
        )
    edges = np.linspace(low[axis], high[axis], slices + 1)
    regions = []
    for k in range(slices):
        first, last = low.copy(), high.copy()
        first[axis], last[axis] = edges[k], edges[k + 1]
        regions.append(box(f"{name}[{k}]", first, last))
    width = edges[1] - edges[0]
    return InspectionPath(
        name=name,
        coordinate=0.5 * (edges[1:] + edges[:-1]),
        coordinate_label=f"{AXIS_NAMES[axis]} [mm]",
        regions=tuple(regions),
        frames=np.broadcast_to(np.eye(3), (slices, 3, 3)).copy(),
        components=("1", "2", "3"),
        description=f"{slices} equal slices of {width:.3g} mm along {AXIS_NAMES[axis]} "
        f"from {edges[0]:.4g} to {edges[-1]:.4g} mm, "
        "averaged over the cross-section",
    )


def circle_path(
    name: str,
    centre: ArrayLike,
    axis: ArrayLike,
    zero: ArrayLike,
    inner_radius: float,
    outer_radius: float,
    height: float,
    points: int,
    width: float,
) -> InspectionPath:
    """Go round an axis in sectors of a ring, in cylindrical components r, θ and axis (J Figs 11 and 12).

    Parameters
    ----------
    centre, axis, zero : array_like, shape (3,)
        Centre (mm), axis, and direction of θ = 0; θ grows right-handed about the axis.
    inner_radius, outer_radius, height : float
        Of the ring, mm.
    points : int
        Number of inspection regions, the first centred at θ = 0.
    width : float
        Angle each region spans, degrees.
    """
    base = frame_about(axis, zero)
    middle = np.asarray(centre, dtype=float)
    angles = np.arange(points) * (2.0 * np.pi / points)
    half = 0.5 * np.radians(width)
    regions = tuple(
        cylinder(f"{name}[{k}]", centre, base[2], height, outer_radius, inner_radius, a - half, a + half, base[0])
        for k, a in enumerate(angles)
    )
    radial = np.cos(angles)[:, None] * base[0] + np.sin(angles)[:, None] * base[1]
    around = -np.sin(angles)[:, None] * base[0] + np.cos(angles)[:, None] * base[1]
    along = np.broadcast_to(base[2], radial.shape)
    aligned = np.flatnonzero(np.abs(base[2]) > 1.0 - 1e-9)
    third = AXIS_NAMES[int(aligned[0])] if len(aligned) else "axis"
    return InspectionPath(
        name=name,
        coordinate=np.degrees(angles),
        coordinate_label="θ [°]",
        regions=regions,
        frames=np.stack([radial, around, along], axis=1),
        components=("r", "θ", third),
        description=f"{points} regions of {width:.3g}° around the axis ({', '.join(f'{c:.3g}' for c in base[2])}) "
        "through "
        f"({', '.join(f'{c:.4g}' for c in middle)}) mm, radius {inner_radius:.4g} to {outer_radius:.4g} mm, "
        f"{height:.4g} mm along the axis; "
        f"θ = 0 towards ({', '.join(f'{c:.3g}' for c in base[0])})",
    )


def swept_path(
    name: str,
    along: int,
    sweep: int,
    length: float,
    width: float,
    centre: float,
    start: float,
    stop: float,
    points: int,
) -> InspectionPath:
    """Sweep a thin rectangle sideways through the whole thickness (D Figs 9 to 11), in global components.

    Parameters
    ----------
    along, sweep : int
        Axes of the rectangle's length and of the sweep.
    length, width : float
        Of the rectangle, mm.
    centre : float
        Its middle along its length, mm.
    start, stop : float
        First and last position of its middle along the sweep, kept half a width inside, mm.

    Raises
    ------
    SceneError
        If both axes are the same or the sweep is not finite.
    """
    if along == sweep:
        raise SceneError(f"path '{name}': 'along' and 'sweep' must be different axes")
    if not np.isfinite([start, stop]).all():
        raise SceneError(f"path '{name}': there is no material to sweep over; give 'start' and 'stop'")
    middle = np.linspace(start + 0.5 * width, stop - 0.5 * width, points)
    regions = []
    for k, x in enumerate(middle):
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        low[along], high[along] = centre - 0.5 * length, centre + 0.5 * length
        low[sweep], high[sweep] = x - 0.5 * width, x + 0.5 * width
        regions.append(box(f"{name}[{k}]", low, high))
    return InspectionPath(
        name=name,
        coordinate=middle,
        coordinate_label=f"{AXIS_NAMES[sweep]} [mm]",
        regions=tuple(regions),
        frames=np.broadcast_to(np.eye(3), (points, 3, 3)).copy(),
        components=("1", "2", "3"),
        description=f"rectangle {length:.4g} mm long in {AXIS_NAMES[along]} and {width:.3g} mm wide, "
        f"swept along {AXIS_NAMES[sweep]} "
        f"in {points} steps, through the whole thickness",
    )


def line_path(name: str, points: ArrayLike, radius: float, steps: int, up: ArrayLike) -> InspectionPath:
    """Set balls along a polygonal line, in local components t (along), s (across), n (near `up`).

    Parameters
    ----------
    points : array_like, shape (m, 3)
        Corners, mm.
    radius : float
        Of the balls, mm.
    steps : int
        Number of balls, equally spaced along the line.
    up : array_like, shape (3,)
        Direction near the local normal.

    Raises
    ------
    SceneError
        If two corners in a row coincide or the line runs along `up`.
    """
    corners = np.asarray(points, dtype=float)
    legs = np.diff(corners, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    if (lengths <= 0).any():
        raise SceneError(f"path '{name}': two corners in a row are the same point")
    marks = np.concatenate([[0.0], np.cumsum(lengths)])
    distance = np.linspace(0.0, marks[-1], steps)
    leg = np.clip(np.searchsorted(marks, distance, side="right") - 1, 0, len(legs) - 1)
    tangents = (legs / lengths[:, None])[leg]
    centres = corners[leg] + (distance - marks[leg])[:, None] * tangents
    frames = np.array([frame_about(t, up) for t in tangents])
    return InspectionPath(
        name=name,
        coordinate=distance,
        coordinate_label="distance along the line [mm]",
        regions=tuple(sphere(f"{name}[{k}]", c, radius) for k, c in enumerate(centres)),
        # frame_about gives (near up, across, along); shown are along, across, near up.
        frames=frames[:, [2, 1, 0]] * np.array([1.0, -1.0, 1.0])[:, None],
        components=("t", "s", "n"),
        description=f"{steps} balls of radius {radius:.3g} mm along a line of {marks[-1]:.4g} mm "
        f"through {len(corners)} points",
    )
