"""The plane figures of a report: path plots, curves in time, press force, flow fronts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ppmc.analysis.averages.paths import AXIS_NAMES
from ppmc.analysis.figures.figure import Picture, is_voxels, to_png
from ppmc.analysis.figures.plots import (
    PathSeries,
    plot_front,
    plot_kinematics,
    plot_path,
    plot_press_force,
    plot_region_history,
)
from ppmc.analysis.flow.comparisons import Comparison
from ppmc.analysis.flow.results import Analysed, Results, scalar_series


def draw_curves(results: Results) -> list[Picture]:
    """Draw path plots, tensors in time, J and F, press force, and flow fronts beside others."""
    pictures = []
    for k, path in enumerate(results.paths):
        entries = results.shown
        series, band = _path_series(results, k)
        caption = (
            f"Path '{path.name}': {path.description}. Diagonal of A (fibre directions) and N (platelet normals) [–] "
            f"in components {', '.join(path.components)}; volume averages over each region. {band} "
            f"Gaps and grey strokes at the foot: no material. {_counts(entries, k)}."
        )
        pictures.append(Picture(f"path_{path.name}", "Paths", caption, to_png(plot_path(path, series))))
    frames = results.frames
    if len(frames) > 2:
        times = [e.source.time or 0.0 for e in frames]
        for k, region in enumerate(results.regions):
            if not any(e.regions.particle_count[k] for e in frames):
                continue
            fibre, normal = scalar_series(frames, k, "fibre_tensor"), scalar_series(frames, k, "normal_tensor")
            counts = [int(e.regions.particle_count[k]) for e in frames]
            caption = (
                f"A_ii and N_ii [–] in time, region '{region.name}' ({region.describe()}), fixed in space; "
                f"{counts[0]:,} particles in it at the start, {counts[-1]:,} at the end. Gaps: no material."
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
        if force.bound:
            caption += f" {force.bound[0].upper()}{force.bound[1:]}."
        drawing = plot_press_force(force.time, force.forces, upper_bound=bool(force.bound))
        pictures.append(Picture("press_force", "Press force", caption, to_png(drawing)))
    return pictures + [_front(comparison) for comparison in results.comparisons]


def _counts(entries: Sequence[Analysed], k: int) -> str:
    """Return how many points the regions of a path hold, source by source."""
    words = []
    for e in entries:
        counts = e.paths[k].particle_count
        kind = "voxels" if is_voxels(e) else "particles"
        words.append(f"{e.source.title}: {int(counts.min()):,} to {int(counts.max()):,} {kind} a region")
    return "; ".join(words)


def _front(c: Comparison) -> Picture:
    axis = AXIS_NAMES[c.view.axis]
    shared = c.seen[c.view.axis]
    caption = (
        f"Flow front at t = {c.time:.4g} s ({c.particle_count:,} particles) beside '{c.label}', seen along {axis}: "
        f"intersection over union {shared:.3f} [–] of the two silhouettes. Axes in mm."
    )
    drawing = plot_front(c.view, "input", c.label)
    return Picture(f"front_{c.label}", "Other runs", caption, to_png(drawing))


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
