"""Curves: tensors along a path, volume and deformation in time, press force; with matplotlib, no display needed."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ppmc.analysis.averages.paths import InspectionPath
from ppmc.analysis.flow.comparisons import FrontView
from ppmc.analysis.flow.kinematics import Kinematics

# Okabe and Ito's palette, told apart by colour-blind readers; dashes and markers tell the lines apart in print too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), "-", "--")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

STYLE: Any = {
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


@dataclass(frozen=True)
class PathSeries:
    """A and N of one source along a path, in the path's components.

    Attributes
    ----------
    label : str
    fibre, normal : ndarray, shape (m, 3, 3)
        NaN where there is no material.
    fibre_band, normal_band : ndarray, shape (m, 3, 3), optional
        Half-width of the band around the line.
    """

    label: str
    fibre: np.ndarray
    normal: np.ndarray
    fibre_band: np.ndarray | None = None
    normal_band: np.ndarray | None = None


class Drawing(Figure):
    """A figure that needs no display and that notebooks show as it is."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.savefig(stream, format="png", dpi=100)
        return stream.getvalue()


def figure(width: float, height: float) -> Figure:
    """Return an empty figure (inches) that needs no display."""
    drawing = Drawing(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(drawing)
    return drawing


def plot_path(path: InspectionPath, series: Sequence[PathSeries]) -> Figure:
    """Draw the diagonal components of A and N along a path, a panel a component, every source in each.

    Gaps in a line, and grey strokes at the foot, are regions without material.
    """
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawing = figure(10.5, 6.7)
        axes = drawing.subplots(2, 3, sharex=True, sharey=True)
        for row, symbol in enumerate("AN"):
            for i in range(3):
                ax = axes[row, i]
                for k, s in enumerate(series):
                    values = (s.fibre, s.normal)[row][:, i, i]
                    band = (s.fibre_band, s.normal_band)[row]
                    style: Any = {"color": COLOURS[k % 8], "linestyle": DASHES[k % 8], "marker": MARKERS[k % 8]}
                    ax.plot(
                        path.coordinate, values, label=s.label.replace("$", r"\$"), markersize=3, linewidth=1.4, **style
                    )
                    if band is not None:
                        low, high = values - band[:, i, i], values + band[:, i, i]
                        ax.fill_between(path.coordinate, low, high, color=COLOURS[k % 8], alpha=0.15, linewidth=0)
                _mark_empty(ax, path.coordinate, [(s.fibre, s.normal)[row] for s in series])
                c = path.components[i]
                ax.set_title(f"{symbol}$_{{{c}{c}}}$", fontsize=10)
                ax.set_ylim(-0.02, 1.02)
                if path.coordinate_label.startswith("θ"):
                    ax.set_xticks([0, 90, 180, 270, 360])
                if row == 1:
                    ax.set_xlabel(path.coordinate_label)
                if i == 0:
                    ax.set_ylabel("fibre tensor A [–]" if symbol == "A" else "normal tensor N [–]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        if handles:
            drawing.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4), frameon=False)
        return drawing


def _mark_empty(ax: Any, coordinate: np.ndarray, tensors: Sequence[np.ndarray]) -> None:
    """Put grey strokes at the foot where no source has material; say so where nothing is known at all."""
    known = np.zeros(len(coordinate), dtype=bool)
    for tensor in tensors:
        known |= np.isfinite(tensor[:, 0, 0])
    if not known.any():
        ax.text(0.5, 0.5, "no data", transform=ax.transAxes, ha="center", color="0.4")
    elif not known.all():
        empty = coordinate[~known]
        ax.plot(empty, np.zeros(len(empty)), "|", color="0.5", markersize=8)


def plot_kinematics(rows: Sequence[Kinematics]) -> Figure:
    """Draw J (mean, 1 % to 99 % band, extremes) and the diagonal of the mean F against time."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawing = figure(10.5, 3.4)
        left, right = drawing.subplots(1, 2)
        time = np.array([k.time for k in rows])
        marker = "o" if len(rows) < 40 else ""
        left.fill_between(
            time,
            [k.volume_ratio_low for k in rows],
            [k.volume_ratio_high for k in rows],
            color=COLOURS[0],
            alpha=0.2,
            linewidth=0,
            label="1 % to 99 %",
        )
        left.plot(time, [k.volume_ratio_mean for k in rows], color=COLOURS[0], marker=marker, label="mean")
        left.plot(time, [k.volume_ratio_min for k in rows], color="0.5", linestyle=":", label="least, largest")
        left.plot(time, [k.volume_ratio_max for k in rows], color="0.5", linestyle=":")
        left.axhline(1.0, color="k", linewidth=0.8)
        left.set_xlabel("time [s]")
        left.set_ylabel("volume ratio J = det F [–]")
        left.legend(frameon=False, fontsize=8)
        for i in range(3):
            mean = np.array([k.mean_deformation_gradient[i, i] for k in rows])
            width = np.array([k.deformation_gradient_spread[i, i] for k in rows])
            right.plot(
                time,
                mean,
                color=COLOURS[i],
                linestyle=DASHES[i],
                marker=MARKERS[i] if marker else "",
                markersize=4,
                label=f"F$_{{{i + 1}{i + 1}}}$",
            )
            right.fill_between(time, mean - width, mean + width, color=COLOURS[i], alpha=0.12, linewidth=0)
        right.set_xlabel("time [s]")
        right.set_ylabel("mean deformation gradient [–]")
        right.legend(frameon=False, fontsize=8)
        return drawing


def plot_press_force(time: np.ndarray, forces: dict[str, np.ndarray], upper_bound: bool = False) -> Figure:
    """Draw press force (N) of each source or tool against time; input in µN."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawing = figure(6.5, 3.4)
        ax = drawing.subplots()
        for k, (label, force) in enumerate(forces.items()):
            ax.plot(
                time,
                np.asarray(force) * 1e-6,
                color=COLOURS[k % 8],
                linestyle=DASHES[k % 8],
                label=label,
                linewidth=1.5,
            )
        ax.set_xlabel("time [s]")
        ax.set_ylabel("force [N], upper bound" if upper_bound else "force [N]")
        if len(forces) > 1:
            ax.legend(frameon=False, fontsize=8)
        return drawing


def plot_region_history(times: Sequence[float], fibre: np.ndarray, normal: np.ndarray) -> Figure:
    """Draw A_ii and N_ii of one region, shape (frames, 3) each, against time."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawing = figure(10.5, 3.0)
        for ax, values, symbol in zip(drawing.subplots(1, 2, sharey=True), (fibre, normal), "AN", strict=True):
            for i in range(3):
                ax.plot(
                    times,
                    values[:, i],
                    color=COLOURS[i],
                    linestyle=DASHES[i],
                    marker=MARKERS[i],
                    markersize=3.5,
                    label=f"{symbol}$_{{{i + 1}{i + 1}}}$",
                )
            ax.set_ylim(-0.02, 1.02)
            ax.set_xlabel("time [s]")
            ax.set_ylabel(f"{'fibre' if symbol == 'A' else 'normal'} tensor {symbol} [–]")
            ax.legend(frameon=False, fontsize=8)
        return drawing


def plot_front(view: FrontView, first: str, second: str) -> Figure:
    """Draw two silhouettes over each other: what both cover, and what only one of them does."""
    import matplotlib as mpl
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    one, two = view.input >= 0.5, view.other >= 0.5
    kinds = (
        ("both", "0.75", one & two),
        (f"{first} only", COLOURS[0], one & ~two),
        (f"{second} only", COLOURS[4], ~one & two),
    )
    pixels = np.ones((*view.input.shape[::-1], 3))
    for _, colour, where in kinds:
        pixels[where.T] = to_rgb(colour)
    left, right, low, high = view.extent
    with mpl.rc_context(STYLE):
        drawing = figure(8.0, float(np.clip(8.0 * (high - low) / (right - left), 2.0, 8.0)) + 1.0)
        ax = drawing.subplots()
        ax.imshow(pixels, origin="lower", extent=view.extent, interpolation="nearest")
        names = [f"x{k + 1} [mm]" for k in range(3) if k != view.axis]
        ax.set_xlabel(names[0])
        ax.set_ylabel(names[1])
        ax.grid(False)
        patches = [Patch(facecolor=colour, label=label.replace("$", r"\$")) for label, colour, _ in kinds]
        drawing.legend(handles=patches, loc="outside upper center", ncols=3, frameon=False)
        return drawing


def plot_profile(place: np.ndarray, fibre: np.ndarray, normal: np.ndarray, label: str) -> Figure:
    """Draw the diagonal and the 13 component of A and N, shape (m, 3, 3) each, against a place (J Figs 15 and 16)."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawing = figure(10.5, 3.8)
        for ax, tensor, symbol in zip(drawing.subplots(1, 2, sharey=True), (fibre, normal), "AN", strict=True):
            for k, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 2))):
                name = f"{symbol}$_{{{i + 1}{j + 1}}}$"
                ax.plot(place, tensor[:, i, j], color=COLOURS[k], linestyle=DASHES[k], label=name)
            ax.set_xlabel(label)
            ax.set_ylabel(f"{'fibre' if symbol == 'A' else 'normal'} tensor {symbol} [–]")
            ax.legend(frameon=False, fontsize=8)
        return drawing
