"""The figures of a report, drawn from results: each with a caption that says what, units, region and count."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

from ppmc.analysis.plots import PathSeries, plot_kinematics, plot_path, plot_press_force, plot_region_history
from ppmc.analysis.report import Picture, describe_counts
from ppmc.analysis.results import Results, scalar_series
from ppmc.analysis.views import SYMBOLS, SquaresView, draw_squares

DPI = 110
MEANING = {"fibre_direction": "fibre direction p", "platelet_normal": "platelet normal r"}


def to_png(drawing: Figure) -> bytes:
    """Return a figure as PNG, without dates, so that equal results give equal bytes."""
    stream = io.BytesIO()
    drawing.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    return stream.getvalue()


def draw_curves(results: Results) -> list[Picture]:
    """Draw path plots, tensors in time, J and F, and press force."""
    pictures = []
    for k, path in enumerate(results.paths):
        entries = results.shown
        series = [PathSeries(e.source.title, results.path_averages(e, k)) for e in entries]
        c = ", ".join(path.components)
        caption = (
            f"Path '{path.name}': {path.description}. Diagonal of A (fibre directions) and N (platelet normals) "
            f"[–] in components {c}; "
            "volume averages over each region. Band: ± one standard deviation of p_i² (r_i²) between the "
            "points of a region, last source. "
            f"Gaps and grey strokes at the foot: no material. {describe_counts(entries)}."
        )
        pictures.append(Picture(f"path_{path.name}", "Paths", caption, to_png(plot_path(path, series))))
    frames = results.frames
    if len(frames) > 2:
        times = [e.source.time or 0.0 for e in frames]
        for k, region in enumerate(results.regions):
            drawing = plot_region_history(
                times, scalar_series(frames, k, "fibre_tensor"), scalar_series(frames, k, "normal_tensor")
            )
            caption = (
                f"A_ii and N_ii [–] in time, region '{region.name}' ({region.describe()}), fixed in space. "
                f"{describe_counts(frames[:1])}."
            )
            pictures.append(Picture(f"history_{region.name}", "Regions", caption, to_png(drawing)))
    if len(results.kinematics) > 1:
        caption = (
            "Left: volume ratio J = det F [–], mean, 1 % to 99 % band, extremes. Right: diagonal of the mean "
            "deformation gradient [–] "
            f"± one standard deviation over particles. All {results.kinematics[0].particle_count:,} particles, "
            "volume-weighted."
        )
        pictures.append(
            Picture("kinematics", "Deformation and volume", caption, to_png(plot_kinematics(results.kinematics)))
        )
    if results.press_force is not None:
        force = results.press_force
        caption = (
            f"Magnitude of the force on each tool [N] against time [s], {force.origin} of the flow file "
            f"({len(force.time):,} values)."
        )
        pictures.append(
            Picture("press_force", "Press force", caption, to_png(plot_press_force(force.time, force.forces)))
        )
    return pictures


def draw_views(results: Results, names: tuple[str, ...], most: int) -> tuple[list[Picture], str | None]:
    """Draw p_i² and r_i² of every shown source.

    Returns
    -------
    pictures : list of Picture
    reason : str or None
        Why three-dimensional rendering was not possible, if so.
    """
    views, captions, labels = [], [], []
    # The truth's picture would repeat the CT's; their difference is in the tables.
    measured = any(entry.source.product == "orientations" for entry in results.shown)
    for entry in results.shown:
        if measured and entry.source.product == "volume":
            continue
        samples = entry.source.thinned(most)
        for name in names:
            if getattr(samples, name) is None or not len(samples):
                continue
            shown = (
                ""
                if len(samples) == entry.source.count
                else f"; {len(samples):,} of {entry.source.count:,} points drawn"
            )
            captions.append(
                f"Squares of the components of the {MEANING[name]}, {SYMBOLS[name]}_i² [–], "
                f"{entry.source.title}, whole file, "
                f"{entry.source.count:,} points{shown}. Axes x1, x2, x3 in mm."
            )
            time = "" if entry.source.time is None else f"_t{entry.source.time:.6g}"
            labels.append(f"view_{name}_{entry.source.label}{time}".replace(" ", "_"))
            views.append(SquaresView(samples, name))
    figures, reason = draw_squares(views)
    return [
        Picture(label, "Views", caption, to_png(drawing))
        for label, caption, drawing in zip(labels, captions, figures, strict=True)
    ], reason
