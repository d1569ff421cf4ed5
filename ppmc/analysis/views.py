"""Views of p_i² and r_i²: three panels a state, from VTK where it works, else from matplotlib (J Figs 7 to 10)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ppmc.analysis.plots import figure
from ppmc.analysis.rendering import PointsView, render
from ppmc.analysis.samples import Samples

COLOURS = "viridis"
MATPLOTLIB_POINTS = 15_000
MOST_CULLING_CELLS = 50_000_000
SYMBOLS = {"fibre_direction": "p", "platelet_normal": "r"}


@dataclass(frozen=True)
class SquaresView:
    """The squares of a direction's components over a whole source.

    Attributes
    ----------
    samples : Samples
        What to show.
    name : str
        ``"fibre_direction"`` or ``"platelet_normal"``.
    """

    samples: Samples
    name: str


def draw_squares(views: Sequence[SquaresView]) -> tuple[list[Figure], str | None]:
    """Draw each view as a row of three panels on one common scale.

    Returns
    -------
    figures : list of Figure
        One a view.
    reason : str or None
        Why VTK could not be used, if it could not.
    """
    jobs: list[PointsView] = []
    for view in views:
        seen = outer_points(view.samples.positions, view.samples.spacing)
        squares, points = _squares(view)[seen], view.samples.positions[seen]
        bounds = common_bounds([view.samples])
        radius = 0.62 * view.samples.spacing
        jobs += [PointsView(points, squares[:, i], radius, (0.0, 1.0), COLOURS, bounds) for i in range(3)]
    rendered = render(jobs)
    figures = []
    for k, view in enumerate(views):
        images = rendered.images[3 * k : 3 * k + 3]
        drawn = [image for image in images if image is not None]
        figures.append(_panels(drawn, SYMBOLS[view.name]) if len(drawn) == 3 else _scatter(view))
    return figures, rendered.reason


def common_bounds(samples: Sequence[Samples]) -> tuple[float, ...]:
    """Return one frame (xmin, xmax, ymin, ymax, zmin, zmax) around sources, half a spacing wider than their points."""
    lows, highs = [], []
    for s in samples:
        if len(s):
            low, high = s.bounds
            lows.append(low - 0.5 * s.spacing)
            highs.append(high + 0.5 * s.spacing)
    if not lows:
        return (0.0, 1.0, 0.0, 1.0, 0.0, 1.0)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
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


def _squares(view: SquaresView) -> np.ndarray:
    direction = getattr(view.samples, view.name)
    return np.zeros((len(view.samples), 3)) if direction is None else np.asarray(direction) ** 2


def _panels(images: Sequence[bytes], symbol: str) -> Figure:
    """Put three pictures side by side with one colour bar."""
    from matplotlib import colormaps, image
    from matplotlib.cm import ScalarMappable

    drawing = figure(12.0, 3.5)
    axes = drawing.subplots(1, 3)
    for i, ax in enumerate(axes):
        ax.imshow(image.imread(io.BytesIO(images[i]), format="png"))
        ax.set_axis_off()
        ax.set_title(f"${symbol}_{i + 1}^2$", fontsize=12)
    drawing.colorbar(
        ScalarMappable(cmap=colormaps[COLOURS]), ax=axes, shrink=0.8, label=f"${symbol}_i^2$ [–]", pad=0.01
    )
    return drawing


def _scatter(view: SquaresView) -> Figure:
    """Draw the same with matplotlib: a thinned cloud."""
    drawing = figure(12.0, 3.9)
    n = len(view.samples)
    chosen = np.random.default_rng(0).permutation(n)[:MATPLOTLIB_POINTS]
    squares = _squares(view)[chosen]
    x = view.samples.positions[chosen]
    extent = np.ptp(x, axis=0) if len(x) else np.ones(3)
    dots = None
    for i in range(3):
        ax: Any = drawing.add_subplot(1, 3, i + 1, projection="3d")
        dots = ax.scatter(x[:, 0], x[:, 1], x[:, 2], c=squares[:, i], cmap=COLOURS, vmin=0, vmax=1, s=4, linewidths=0)
        ax.set_box_aspect(np.maximum(extent, 0.05 * extent.max()))
        ax.view_init(elev=30, azim=-60)
        ax.set_title(f"${SYMBOLS[view.name]}_{i + 1}^2$", fontsize=12)
        ax.set_xlabel("x1 [mm]", fontsize=8)
        ax.set_ylabel("x2 [mm]", fontsize=8)
        ax.set_zlabel("x3 [mm]", fontsize=8)
        ax.tick_params(labelsize=7)
        ax.locator_params(axis="z", nbins=3)
    if dots is not None:
        drawing.colorbar(dots, ax=drawing.axes, shrink=0.7, label=f"${SYMBOLS[view.name]}_i^2$ [–]", pad=0.02)
    return drawing
