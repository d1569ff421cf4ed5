"""Clouds of points from outside, coloured by values, panels side by side: by VTK where it works, else matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ppmc.analysis.figures.plots import figure
from ppmc.analysis.figures.rendering import PointsView, render
from ppmc.analysis.figures.surfaces import Surface

COLOURS = "viridis"
EYE = (0.9, -1.5, 1.0)
MATPLOTLIB_POINTS = 15_000
MOST_CULLING_CELLS = 50_000_000
RIM = 8
PANEL = 5.0  # width of a picture in a row, inch
BALL = 0.62  # radius of a ball in spacings: neighbours overlap a little, so that no light falls through


@dataclass(frozen=True)
class Panel:
    """One picture of a row.

    Attributes
    ----------
    title : str
        Over the picture.
    values : ndarray, shape (n,)
        What the colour shows; NaN hides a point.
    label : str
        On the colour bar, with the unit; panels of one label share a bar. Empty: no bar.
    limits : (float, float)
        Values at the ends of the colour map.
    colours : str
        Name of a colour map.
    surface : Surface, optional
        Drawn in place of the points.
    """

    title: str
    values: np.ndarray
    label: str
    limits: tuple[float, float] = (0.0, 1.0)
    colours: str = COLOURS
    surface: Surface | None = None


@dataclass(frozen=True)
class CloudView:
    """A row of pictures of one cloud of points.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        mm.
    spacing : float
        Distance of neighbours, mm: decides the size of the balls.
    panels : sequence of Panel
    bounds : tuple of 6 float, optional
        Frame to show; around the points if left out.
    direction : (float, float, float)
        From the object to the eye.
    ghost : ndarray, shape (k, 3), optional
        Points of the rest of the part, shown faintly, mm.
    """

    positions: np.ndarray
    spacing: float
    panels: Sequence[Panel]
    bounds: tuple[float, ...] | None = None
    direction: tuple[float, float, float] = EYE
    ghost: np.ndarray | None = None

    @property
    def frame(self) -> tuple[float, ...]:
        """The bounds to show."""
        return self.bounds or cloud_bounds(self.positions, self.spacing)


def draw_clouds(views: Sequence[CloudView]) -> tuple[list[Figure], str | None]:
    """Draw every view as a row of panels.

    Returns
    -------
    figures : list of Figure
        One a view.
    reason : str or None
        Why VTK could not be used, if it could not.
    """
    jobs: list[PointsView] = []
    for view in views:
        ghost = view.ghost
        if ghost is not None:
            ghost = ghost[outer_points(ghost, view.spacing)]
        for panel in view.panels:
            look = (panel.limits, panel.colours, view.frame, view.direction)
            if panel.surface is not None:
                s = panel.surface
                jobs.append(PointsView(s.points, s.values, 0.0, *look, triangles=s.triangles, ghost=ghost))
                continue
            shown = np.flatnonzero(np.isfinite(panel.values))
            seen = shown[outer_points(view.positions[shown], view.spacing)]
            points, values = view.positions[seen], panel.values[seen]
            jobs.append(PointsView(points, values, BALL * view.spacing, *look, ghost=ghost))
    rendered = render(jobs)
    figures, at = [], 0
    for view in views:
        images = rendered.images[at : at + len(view.panels)]
        at += len(view.panels)
        drawn = [image for image in images if image is not None]
        figures.append(_assemble(view, drawn) if len(drawn) == len(images) else _scatter(view))
    return figures, rendered.reason


def cloud_bounds(positions: np.ndarray, spacing: float) -> tuple[float, ...]:
    """Return (xmin, xmax, ymin, ymax, zmin, zmax) around points, half a spacing wider; unit box if there is none."""
    if not len(positions):
        return (0.0, 1.0, 0.0, 1.0, 0.0, 1.0)
    half = 0.5 * spacing
    # Rounding keeps the axes' labels short and free of -0.
    low = np.round(positions.min(axis=0) - half, 3) + 0.0
    high = np.round(positions.max(axis=0) + half, 3) + 0.0
    return tuple(float(v) for pair in zip(low, high, strict=True) for v in pair)


def outer_points(positions: np.ndarray, spacing: float) -> np.ndarray:
    """Return the indices of the points that can be seen from outside: some of the six cells around theirs is empty.

    Drawing time falls with the hidden points, which are most of a thick part.
    """
    if not len(positions) or not spacing > 0:
        return np.arange(len(positions))
    cells = np.floor((positions - positions.min(axis=0)) / (1.3 * spacing)).astype(np.int64) + 1
    shape = cells.max(axis=0) + 2
    if np.prod(shape.astype(float)) > MOST_CULLING_CELLS:
        return np.arange(len(positions))
    full = np.zeros(shape, dtype=bool)
    full[tuple(cells.T)] = True
    hidden = full.copy()
    for axis in range(3):
        hidden &= np.roll(full, 1, axis) & np.roll(full, -1, axis)
    return np.flatnonzero(~hidden[tuple(cells.T)])


def _assemble(view: CloudView, images: Sequence[bytes]) -> Figure:
    """Put the pictures side by side with their colour bars."""
    from matplotlib import image

    pixels = _trimmed([image.imread(io.BytesIO(png), format="png") for png in images])
    height, width = pixels[0].shape[:2]
    drawing = figure(PANEL * len(images) + 0.8, min(1.2 * PANEL, PANEL * height / width + 0.5))
    axes = drawing.subplots(1, len(images), squeeze=False)[0]
    for panel, ax, picture in zip(view.panels, axes, pixels, strict=True):
        ax.imshow(picture)
        ax.set_axis_off()
        ax.set_title(panel.title, fontsize=12)
    colour_bars(drawing, axes, view.panels)
    return drawing


def _trimmed(pictures: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Cut the white rim that all pictures of a row share."""
    ink = np.any([(picture[..., :3] < 0.99).any(axis=-1) for picture in pictures], axis=0)
    if not ink.any():
        return list(pictures)
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    top, left = max(rows[0] - RIM, 0), max(columns[0] - RIM, 0)
    return [picture[top : rows[-1] + RIM, left : columns[-1] + RIM] for picture in pictures]


def colour_bars(drawing: Figure, axes: Sequence[Any], panels: Sequence[Panel]) -> None:
    """Add a colour bar to each panel, or one for all if they share label and limits."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    if len({(panel.label, panel.limits) for panel in panels}) == 1:
        groups = [(panels[0], list(axes))]
    else:
        groups = [(panel, [ax]) for panel, ax in zip(panels, axes, strict=True)]
    for panel, where in groups:
        if panel.label:
            colours = ScalarMappable(Normalize(*panel.limits), colormaps[panel.colours])
            drawing.colorbar(colours, ax=where, shrink=0.75, label=panel.label, pad=0.01)


def _scatter(view: CloudView) -> Figure:
    """Draw the same with matplotlib: a thinned cloud."""
    drawing = figure(4.0 * len(view.panels) + 0.6, 3.9)
    rng = np.random.default_rng(0)
    axes = []
    extent = np.ptp(view.positions, axis=0) if len(view.positions) else np.ones(3)
    for k, panel in enumerate(view.panels):
        ax: Any = drawing.add_subplot(1, len(view.panels), k + 1, projection="3d")
        axes.append(ax)
        # Where surfaces cannot be drawn their vertices stand for them.
        s = panel.surface
        points, values = (view.positions, panel.values) if s is None else (s.points, s.values)
        shown = rng.permutation(np.flatnonzero(np.isfinite(values)))[:MATPLOTLIB_POINTS]
        x, low_high = points[shown], {"vmin": panel.limits[0], "vmax": panel.limits[1]}
        ax.scatter(x[:, 0], x[:, 1], x[:, 2], c=values[shown], cmap=panel.colours, s=4, linewidths=0, **low_high)
        ax.set_box_aspect(np.maximum(extent, 0.05 * extent.max()))
        ax.view_init(elev=30, azim=-60)
        ax.set_title(panel.title, fontsize=12)
        ax.set_xlabel("x1 [mm]", fontsize=8)
        ax.set_ylabel("x2 [mm]", fontsize=8)
        ax.set_zlabel("x3 [mm]", fontsize=8)
        ax.tick_params(labelsize=7)
        ax.locator_params(axis="z", nbins=3)
    colour_bars(drawing, axes, view.panels)
    return drawing
