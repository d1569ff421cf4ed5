"""The three-dimensional figures of a report: which views the scene asks for, with what they show in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.figures import panels
from ppmc.analysis.figures.figure import Picture, to_png
from ppmc.analysis.figures.views import CloudView, Panel, draw_clouds
from ppmc.analysis.flow.results import Analysed, Results
from ppmc.particles import Particles

if TYPE_CHECKING:
    from ppmc.scene.sections.analysis import AnalysisSection

CAPTIONS = {
    "fibre_direction": "Squares of the components of the fibre direction p, p_i² [–]",
    "platelet_normal": "Squares of the components of the platelet normal r, r_i² [–]",
    "dominant_direction": "Points split by the axis nearest to their fibre, coloured by p_i² [–]",
    "iso_surface": "The part split by the axis its fibres favour: closed surfaces around the pieces in which A_ii, "
    "averaged over about two spacings, is the largest of the three, coloured by that A_ii [–] from 1/3 to 1",
    "platelets": "Platelets, neighbours told apart by colour (which has no other meaning) [–]",
    "maps": "Largest principal stretch λ1 [–], platelet shear angle [°], volume ratio J [–], as far as known",
}
SPLIT = ("dominant_direction", "iso_surface")  # pieces, with the rest of the part shown faintly
MAKERS: dict[str, Callable[[Particles, float], list[Panel]]] = {
    "fibre_direction": lambda s, _: panels.squares(s, "fibre_direction"),
    "platelet_normal": lambda s, _: panels.squares(s, "platelet_normal"),
    "dominant_direction": lambda s, _: panels.dominant(s),
    "iso_surface": panels.dominant_split,
    "platelets": lambda s, _: panels.platelets(s),
    "maps": lambda s, _: panels.scalar_maps(s),
}


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
    if "difference" in section.views:
        jobs += _difference_views(results)
    _note_missing(results, section, [name for name, *_ in jobs])
    figures, reason = draw_clouds([view for *_, view in jobs])
    return [
        Picture(name, heading, caption, to_png(drawing))
        for (name, heading, caption, _), drawing in zip(jobs, figures, strict=True)
    ], reason


def _note_missing(results: Results, section: AnalysisSection, drawn: list[str]) -> None:
    """Say which views and cuts that the scene asks for have nothing to show."""
    wanted = {name: (f"view_{name}_", name, f"{name}_") for name in section.views if name != "difference"}
    missing = [name for name, marks in wanted.items() if not any(d.startswith(marks) for d in drawn)]
    if results.flow_maps is not None and not len(results.flow_maps.knit) and "knit_line" in missing:
        missing.remove("knit_line")  # the section on knit lines says that there is none
    if missing and "views" in section.model_fields_set:
        results.notes.append(f"Views not drawn, as no source carries what they show: {', '.join(missing)}.")
    for title in section.cuts:
        if not any(d.startswith(f"cut_{title}_") for d in drawn):
            results.notes.append(f"Cut '{title}' leaves no material to show.")


def _source_views(entry: Analysed, section: AnalysisSection, last: bool) -> list[tuple[str, str, str, CloudView]]:
    jobs = []
    source = entry.source
    samples = source.thinned(section.view_points)
    spacing = source.spacing * (source.count / max(len(samples), 1)) ** (1 / 3)
    thin = "" if len(samples) == source.count else f" ({len(samples):,} drawn)"
    counted = f"{source.title}, whole file, {source.count:,} points{thin}. Axes x1, x2, x3 in mm."
    suffix = (source.label + ("" if source.time is None else f"_t{source.time:.6g}")).replace(" ", "_")
    for name in section.views:
        shown = MAKERS[name](samples, spacing) if name in MAKERS and len(samples) else []
        if shown and not (name == "maps" and not last):
            jobs.append(
                (
                    f"view_{name}_{suffix}",
                    "Views",
                    f"{CAPTIONS[name]}; {counted}",
                    CloudView(samples.positions, spacing, shown, ghost=samples.positions if name in SPLIT else None),
                )
            )
    for title, cut in section.cuts.items() if last or source.product in ("orientations", "moulded") else ():
        behind = samples.select((samples.positions - np.array(cut.point)) @ np.array(cut.normal) <= 0)
        shown = panels.squares(behind, "fibre_direction") if len(behind) else []
        if shown:
            caption = (
                f"Cut '{title}' through {cut.point} mm, opened towards {tuple(round(v, 3) for v in cut.normal)}: "
                f"{CAPTIONS['fibre_direction']}; {len(behind):,} of the {len(samples):,} points drawn lie behind it; "
                f"{counted}"
            )
            view = CloudView(behind.positions, spacing, shown, direction=open_to(np.array(cut.normal)))
            jobs.append((f"cut_{title}_{suffix}", "Views", caption, view))
    return jobs


def open_to(normal: np.ndarray) -> tuple[float, float, float]:
    """Return where to look from at a cut: a little aslant, so that the rim behind it gives depth.

    Seen from above x1 runs to the right.
    """
    aslant = [0.0, -0.25, 0.0] if abs(normal[2]) > 0.9 else [0.07, -0.07, 0.15]
    x, y, z = (float(v) for v in normal + np.array(aslant))
    return x, y, z


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
        view = CloudView(s.positions[k.index], maps.spacing, [crossing, normal], bounds, ghost=s.positions)
        caption = (
            f"Knit lines: the {len(k):,} of {n:,} particles that met neighbours from elsewhere. Share of fibres across "
            "the line A_cc [–] (0: nothing reinforces it) and of normals N_cc [–]; the rest of the part in grey. "
            "Axes in mm."
        )
        jobs.append(("knit_line", "Filling and knit lines", caption, view))
    return jobs


def _difference_views(results: Results) -> list[tuple[str, str, str, CloudView]]:
    maps = results.flow_maps
    if maps is None:
        return []
    jobs = []
    for c in results.comparisons:
        shown = panels.differences(c)
        if shown:
            caption = (
                f"Input beside run '{c.label}', last states: distance of each particle to itself [mm] and angle "
                f"between its fibre directions [°], drawn where the input has them; {c.particle_count:,} particles."
            )
            view = CloudView(maps.samples.positions, maps.spacing, shown)
            jobs.append((f"difference_{c.label}", "Other runs", caption, view))
    return jobs
