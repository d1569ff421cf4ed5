"""From opened files to results: which sources there are, their averages, and what only a flow can tell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.averages.averages import RegionAverages
from ppmc.analysis.averages.build import build_path, build_regions, local_path
from ppmc.analysis.averages.paths import AXIS_NAMES
from ppmc.analysis.averages.sources import Source, charge_source, flow_source, orientations_source, truth_source
from ppmc.analysis.flow.comparisons import compare_runs, compare_with_mask, compare_with_part
from ppmc.analysis.flow.ensemble import ensemble
from ppmc.analysis.flow.fill import CELL_IN_SPACINGS, fill_times
from ppmc.analysis.flow.kinematics import Kinematics, kinematics
from ppmc.analysis.flow.knit import find_knit_lines
from ppmc.analysis.flow.occupancy import cells_around
from ppmc.analysis.flow.results import Analysed, FlowMaps, Results, press_force
from ppmc.files import ParticleFile, SeriesFile, VoxelFile
from ppmc.files.verdict import FORCE_ESTIMATE, read_verdict
from ppmc.particles import Particles

if TYPE_CHECKING:
    from ppmc.scene import Scene
    from ppmc.scene.sections.analysis import AnalysisSection

FILL_FRAMES = 100
LEAST_KNOWN_SHARE = 0.9999
MOULDED = "CT of the part"


@dataclass
class Opened:
    """The files of one analysis, open for its length.

    Attributes
    ----------
    main : str
        Product of the input.
    volume, orientations, charge, flow
        The chain's files, as far as they are given.
    moulded : VoxelFile, optional
        Orientations measured in the moulded part, to stand beside the flow's last frame.
    compare, seeds : list of (str, SeriesFile)
        Other runs by label: to show beside the input, and to join with it into statistics.
    """

    main: str
    volume: VoxelFile | None = None
    orientations: VoxelFile | None = None
    charge: ParticleFile | None = None
    flow: SeriesFile | None = None
    moulded: VoxelFile | None = None
    compare: list[tuple[str, SeriesFile]] = field(default_factory=list)
    seeds: list[tuple[str, SeriesFile]] = field(default_factory=list)


def gather(scene: Scene, section: AnalysisSection, opened: Opened) -> Results:
    """Average every source over every region and path, and add what the flow tells."""
    notes: list[str] = []
    sources = _sources(opened, section.frames == "all", notes)
    regions = build_regions(section)
    known = [s for s in sources if s.count]
    for s in sources:
        if not s.count:
            notes.append(f"{s.title} holds no point with a known direction.")
    paths = tuple(build_path(name, p, known) for name, p in section.every_path.items()) if known else ()
    results = Results(regions, paths, [], opened.main, notes=notes)
    results.analysed = [analyse(source, results) for source in sources]
    for e in results.shown:
        share = float(e.regions.known_share[0])
        if share < LEAST_KNOWN_SHARE:
            notes.append(
                f"{e.source.title}: {1 - share:.2%} of the volume has no known fibre direction and is left out."
            )
    for k, region in enumerate(regions):
        empty = [e.source.title for e in results.shown if e.source.count and not e.regions.particle_count[k]]
        if empty:
            notes.append(f"Region '{region.name}' ({region.describe()}) holds no point of: {'; '.join(empty)}.")
    for k, path in enumerate(paths):
        empty = [e.source.title for e in results.shown if e.source.count and not e.paths[k].particle_count.any()]
        if empty:
            notes.append(f"Path '{path.name}' meets no point of: {'; '.join(empty)}.")
    seeds = [analyse(_run_source(label, file), results) for label, file in opened.seeds]
    _add_local_paths(scene, section, results, seeds)
    if seeds and results.frames:
        runs = [results.frames[-1], *seeds]
        results.seeds = ensemble([e.regions for e in runs])
        results.path_seeds = tuple(
            ensemble([results.path_averages(e, k) for e in runs]) for k in range(len(results.paths))
        )
    if opened.flow is not None:
        results.verdict = read_verdict(opened.flow.extra, opened.flow.path)
        _add_flow(results, opened.flow)
        axis, end = AXIS_NAMES.index(section.front.axis), float(opened.flow.times[-1])
        for label, file in (*opened.compare, *opened.seeds):
            verdict = read_verdict(file.extra, file.path)
            if verdict is not None and not verdict.passed:
                broken = "; ".join(finding.told() for finding in verdict.broken)
                notes.append(f"Run '{label}': verdict {verdict.headline} ({broken}).")
            if not np.isclose(file.times[-1], end, rtol=1e-6):
                notes.append(f"Run '{label}' ends at t = {file.times[-1]:.4g} s, the input at {end:.4g} s.")
        results.comparisons = [compare_runs(opened.flow, label, file, axis) for label, file in opened.compare]
        if opened.moulded is not None:
            results.comparisons.append(compare_with_part(opened.flow, opened.moulded, MOULDED, axis))
        mask = section.front.mask
        if mask is not None:
            results.comparisons.append(compare_with_mask(opened.flow, scene.locate(mask.path), mask, axis))
    return results


def analyse(source: Source, results: Results) -> Analysed:
    """Average one source over the regions and paths of the results, in one go."""
    every = [*results.regions, *(region for path in results.paths for region in path.regions)]
    averages = source.averages(every)
    parts: list[RegionAverages] = []
    at = len(results.regions)
    for path in results.paths:
        parts.append(averages[at : at + len(path)])
        at += len(path)
    return Analysed(source, averages[: len(results.regions)], tuple(parts))


def truth_links(opened: Opened) -> list[tuple[str, str, Source, bool]]:
    """Return what follows CT in the comparison: label, note, source, whether the interior is that of the start."""
    rows: list[tuple[str, str, Source, bool]] = []
    if opened.charge is not None:
        rows.append(("charge", "particles in the interior", charge_source(opened.charge), False))
    if opened.flow is not None:
        start, end = float(opened.flow.times[0]), float(opened.flow.times[-1])
        note = "the charge: particles that start in the interior"
        rows.append((f"flow, t = {start:.4g} s", note, flow_source(opened.flow, 0), True))
        rows.append((f"flow, t = {end:.4g} s", "the same particles after the flow", flow_source(opened.flow, -1), True))
    return rows


def _sources(opened: Opened, every_frame: bool, notes: list[str]) -> list[Source]:
    """Return what to average, in the order of the chain."""
    sources = []
    if opened.volume is not None:
        if {"fibre_direction", "platelet_normal"} <= set(opened.volume.names):
            sources.append(truth_source(opened.volume))
        else:
            notes.append("The volume carries no true directions (only phantoms do), so it is left out.")
    if opened.orientations is not None:
        sources.append(orientations_source(opened.orientations))
    if opened.charge is not None:
        sources.append(charge_source(opened.charge))
    flow = opened.flow
    if flow is not None:
        last = len(flow.times) - 1
        frames = range(last + 1) if every_frame else sorted({0, last})
        sources += [flow_source(flow, k) for k in frames]
        if last == 0:
            notes.append("The flow file holds one time step only: start and end are the same.")
        if not flow.complete:
            notes.append("The flow file is still growing: the run has not come to its end.")
    sources += [_run_source(label, file) for label, file in opened.compare]
    if opened.moulded is not None:
        sources.append(replace(orientations_source(opened.moulded, MOULDED), product="moulded"))
    return sources


def _run_source(label: str, file: SeriesFile) -> Source:
    """Return the last frame of another run; its product says that it is not the input."""
    return replace(flow_source(file, -1, label), product="run")


def _add_local_paths(scene: Scene, section: AnalysisSection, results: Results, seeds: list[Analysed]) -> None:
    """Show swept paths in local axes too, with the normal of the tool nearest to the material of each region (D6)."""
    if not results.shown:
        return
    last = results.frames[-1] if results.frames else results.shown[-1]
    for k, path in enumerate(results.paths):
        spec = section.every_path[path.name]
        if spec.kind != "swept" or not spec.local:
            continue
        local = local_path(scene, path, spec, last.paths[k], last.source.time or 0.0)
        results.paths = (*results.paths, local)
        for entries in (results.analysed, seeds):
            entries[:] = [replace(e, paths=(*e.paths, e.paths[k])) for e in entries]


def _add_flow(results: Results, flow: SeriesFile) -> None:
    """Add J and F of every frame, the press force, the fill times and the knit lines."""
    results.kinematics = [_kinematics_of(flow, k) for k in range(len(flow.times))]
    results.press_force = press_force(flow.history, flow.times, flow.scalars)
    estimate = flow.extra.get(FORCE_ESTIMATE)
    bound = str(estimate.get("told", "")) if isinstance(estimate, dict) else ""
    if results.press_force is not None and bound:
        results.press_force = replace(results.press_force, bound=bound)
        results.notes.append(f"{bound[0].upper()}{bound[1:]}.")
    if results.press_force is None:
        results.notes.append("The flow file carries no forces: there is no press-force curve.")
    if "platelet_normal" not in flow.names and "in_plane_direction" not in flow.names:
        results.notes.append("The flow file carries neither platelet_normal nor in_plane_direction: N is not known.")
    source = flow_source(flow, -1)
    last = next(source.parts())
    ends = (last.positions, flow.frame(0, ())["position"])
    cells = cells_around(ends, source.spacing, CELL_IN_SPACINGS * source.spacing)
    times = fill_times(_states(flow), cells, last) if len(flow.times) > 1 else None
    if last.fibre_direction is None:
        return
    knit = find_knit_lines(
        last.positions,
        last.fields["reference_position"],
        source.spacing,
        last.fibre_direction,
        last.platelet_normal,
        last.fields.get("deformation_gradient"),
        last.volume,
    )
    results.flow_maps = FlowMaps(last, source.spacing, times, knit)


def _states(flow: SeriesFile) -> Iterator[tuple[float, Particles]]:
    """Yield times and where the material is, at most `FILL_FRAMES` of them."""
    volume = flow.static["volume"].astype(float)
    for k in np.unique(np.linspace(0, len(flow.times) - 1, FILL_FRAMES).round().astype(int)):
        values = flow.frame(int(k), ("deformation_gradient",))
        fields = {"deformation_gradient": values["deformation_gradient"]}
        yield float(flow.times[k]), Particles("flow", values["position"], volume, fields=fields)


def _kinematics_of(flow: SeriesFile, k: int) -> Kinematics:
    names = [name for name in ("deformation_gradient", "volume_ratio") if name in flow.names]
    values = flow.frame(k, names)
    F, J = values.get("deformation_gradient"), values.get("volume_ratio")
    return kinematics(flow.times[k], flow.static["volume"], values["position"], F, J)
