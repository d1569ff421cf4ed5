"""The figures of a report, drawn from results: each with a caption that says what, units, region and count."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ppmc.analysis import panels
from ppmc.analysis.plots import PathSeries, plot_kinematics, plot_path, plot_press_force, plot_region_history
from ppmc.analysis.report import Picture, describe_counts
from ppmc.analysis.results import Analysed, Results, scalar_series
from ppmc.analysis.samples import Samples
from ppmc.analysis.views import CloudView, Panel, draw_clouds

if TYPE_CHECKING:
    from ppmc.scene.analysis import AnalysisSection

DPI = 110
CAPTIONS = {
    "fibre_direction": "Squares of the components of the fibre direction p, p_i² [–]",
    "platelet_normal": "Squares of the components of the platelet normal r, r_i² [–]",
    "dominant_direction": "Points split by the axis nearest to their fibre, coloured by p_i² [–]",
    "platelets": "Platelets, neighbours told apart by colour (which has no other meaning) [–]",
    "maps": "Largest principal stretch λ1 [–], platelet shear angle [°], volume ratio J [–], as far as known",
}
MAKERS: dict[str, Callable[[Samples], list[Panel]]] = {
    "fibre_direction": lambda s: panels.squares(s, "fibre_direction"),
    "platelet_normal": lambda s: panels.squares(s, "platelet_normal"),
    "dominant_direction": panels.dominant,
    "platelets": panels.platelets,
    "maps": panels.scalar_maps,
}


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
        series, band = _path_series(results, k)
        caption = (
            f"Path '{path.name}': {path.description}. Diagonal of A (fibre directions) and N (platelet normals) [–] "
            f"in components {', '.join(path.components)}; volume averages over each region. {band} "
            f"Gaps and grey strokes at the foot: no material. {describe_counts(entries)}."
        )
        pictures.append(Picture(f"path_{path.name}", "Paths", caption, to_png(plot_path(path, series))))
    frames = results.frames
    if len(frames) > 2:
        times = [e.source.time or 0.0 for e in frames]
        for k, region in enumerate(results.regions):
            fibre, normal = scalar_series(frames, k, "fibre_tensor"), scalar_series(frames, k, "normal_tensor")
            caption = (
                f"A_ii and N_ii [–] in time, region '{region.name}' ({region.describe()}), fixed in space. "
                f"{describe_counts(frames[:1])}."
            )
            drawing = plot_region_history(times, fibre, normal)
            pictures.append(Picture(f"history_{region.name}", "Regions", caption, to_png(drawing)))
    if len(results.kinematics) > 1:
        caption = (
            "Left: volume ratio J = det F [–], mean, 1 % to 99 % band, extremes. Right: diagonal of the mean "
            "deformation gradient [–] ± one standard deviation over particles. "
            f"All {results.kinematics[0].particle_count:,} particles, volume-weighted."
        )
        drawing = plot_kinematics(results.kinematics)
        pictures.append(Picture("kinematics", "Deformation and volume", caption, to_png(drawing)))
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


def _path_series(results: Results, k: int) -> tuple[list[PathSeries], str]:
    """Return the lines of a path plot and what its band means: spread over seeds, else standard error of the input."""
    series = []
    main = results.frames[-1] if results.frames else None
    ensembles = results.path_seeds
    with_error = False
    for entry in results.shown:
        if entry is main and ensembles:
            continue
        a = results.path_averages(entry, k)
        error = entry is main and bool(np.isfinite(a.effective_platelets).any())
        with_error |= error
        bands = (a.fibre_error, a.normal_error) if error else (None, None)
        series.append(PathSeries(entry.source.title, a.fibre_tensor, a.normal_tensor, *bands))
    if ensembles:
        e = ensembles[k]
        title = f"mean of {e.runs} seeds"
        series.append(PathSeries(title, e.fibre_mean, e.normal_mean, e.fibre_spread, e.normal_spread))
        return series, f"Band: ± one standard deviation between {e.runs} runs with different seeds."
    if with_error:
        return series, "Band: ± one standard error of the last state, every platelet counted once."
    return series, "No band, as platelets are not numbered in this input."


def draw_views(results: Results, section: AnalysisSection) -> tuple[list[Picture], str | None]:
    """Draw the three-dimensional views that the scene asks for.

    Returns
    -------
    pictures : list of Picture
    reason : str or None
        Why three-dimensional rendering was not possible, if so.
    """
    jobs: list[tuple[str, str, str, CloudView]] = []
    # The truth's picture would repeat the CT's; their difference is in the tables.
    measured = any(entry.source.product == "orientations" for entry in results.shown)
    for entry in results.shown:
        if not (measured and entry.source.product == "volume"):
            jobs += _source_views(entry, section, last=bool(results.frames) and entry is results.frames[-1])
    jobs += _flow_views(results, section)
    figures, reason = draw_clouds([view for *_, view in jobs])
    return [
        Picture(name, heading, caption, to_png(drawing))
        for (name, heading, caption, _), drawing in zip(jobs, figures, strict=True)
    ], reason


def _source_views(entry: Analysed, section: AnalysisSection, last: bool) -> list[tuple[str, str, str, CloudView]]:
    jobs = []
    source = entry.source
    samples = source.thinned(section.view_points)
    spacing = source.spacing * (source.count / max(len(samples), 1)) ** (1 / 3)
    thin = "" if len(samples) == source.count else f" ({len(samples):,} drawn)"
    counted = f"{source.title}, whole file, {source.count:,} points{thin}. Axes x1, x2, x3 in mm."
    suffix = (source.label + ("" if source.time is None else f"_t{source.time:.6g}")).replace(" ", "_")
    for name in section.views:
        shown = MAKERS[name](samples) if name in MAKERS and len(samples) else []
        if shown and not (name == "maps" and not last):
            jobs.append(
                (
                    f"view_{name}_{suffix}",
                    "Views",
                    f"{CAPTIONS[name]}; {counted}",
                    CloudView(samples.positions, spacing, shown),
                )
            )
    for title, cut in section.cuts.items() if last or source.product in ("orientations", "moulded") else ():
        behind = samples.select((samples.positions - np.array(cut.point)) @ np.array(cut.normal) <= 0)
        shown = panels.squares(behind, "fibre_direction") if len(behind) else []
        if shown:
            # A little aslant, so that the rim behind the cut gives depth; x1 runs to the right when seen from above.
            aslant = [0.0, -0.25, 0.0] if abs(cut.normal[2]) > 0.9 else [0.07, -0.07, 0.15]
            x, y, z = (float(v) for v in np.array(cut.normal) + np.array(aslant))
            caption = (
                f"Cut '{title}' through {cut.point} mm, opened towards {tuple(round(v, 3) for v in cut.normal)}: "
                f"{CAPTIONS['fibre_direction']}; {counted}"
            )
            view = CloudView(behind.positions, spacing, shown, direction=(x, y, z))
            jobs.append((f"cut_{title}_{suffix}", "Views", caption, view))
    return jobs


def _flow_views(results: Results, section: AnalysisSection) -> list[tuple[str, str, str, CloudView]]:
    maps = results.flow_maps
    if maps is None:
        return []
    jobs = []
    s, n = maps.samples, len(maps.samples)
    if "fill_time" in section.views and maps.fill_time is not None:
        top = float(np.nanmax(maps.fill_time))
        panel = Panel("fill time", maps.fill_time, "t [s]", (0.0, max(top, 1e-9)))
        caption = (
            f"Time at which each place was first reached [s], as fine as the frames are; last state, {n:,} particles."
        )
        jobs.append(("fill_time", "Filling and knit lines", caption, CloudView(s.positions, maps.spacing, [panel])))
    if "knit_line" in section.views and len(maps.knit):
        k = maps.knit
        bounds = CloudView(s.positions, maps.spacing, []).frame
        crossing = Panel("fibres across", k.crossing, "$A_{cc}$ [–]", (0.0, 1.0))
        normal = Panel("normals across", k.normal_across, "$N_{cc}$ [–]", (0.0, 1.0))
        view = CloudView(s.positions[k.index], maps.spacing, [crossing, normal], bounds)
        caption = (
            f"Knit lines: the {len(k):,} of {n:,} particles that met neighbours from elsewhere. Share of fibres "
            "across the "
            "line A_cc [–] (0: nothing reinforces it) and of normals N_cc [–]."
        )
        jobs.append(("knit_line", "Filling and knit lines", caption, view))
    return jobs
