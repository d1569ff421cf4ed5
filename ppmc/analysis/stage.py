"""The analysis stage: read the chain's files, average, compare, draw, write; the only module here that opens files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ppmc.analysis.build import build_path, build_regions, tool_normals
from ppmc.analysis.compare import compare_with_truth
from ppmc.analysis.kinematics import Kinematics, kinematics
from ppmc.analysis.local import localise, material_normals
from ppmc.analysis.paths import AXIS_NAMES
from ppmc.analysis.pictures import draw_curves, draw_views
from ppmc.analysis.regions import Region
from ppmc.analysis.report import InputFile, Picture, flat_summary, write_report
from ppmc.analysis.results import Analysed, Results, press_force
from ppmc.analysis.sources import Source, charge_source, flow_source, orientations_source, truth_source
from ppmc.analysis.tables import fourth_table, kinematics_table, path_table, region_table, to_json_ready, truth_table
from ppmc.errors import InputFileError, SceneError
from ppmc.files import (
    Provenance,
    SeriesFile,
    SeriesWriter,
    check_output,
    open_series,
    read_particles,
    read_voxels,
    whole_file,
)
from ppmc.files.guard import product_of
from ppmc.orientation import to_six
from ppmc.progress import Progress

if TYPE_CHECKING:
    import pandas as pd

    from ppmc.scene import Scene
    from ppmc.scene.analysis import AnalysisSection

KINDS = ("flow", "charge", "orientations")


def run(
    scene: Scene,
    *,
    input: Path,
    output: Path,
    volume: Path | None = None,
    orientations: Path | None = None,
    charge: Path | None = None,
) -> Path:
    """Analyse a flow, a charge or an orientations file, beside its forerunners where they are given.

    Parameters
    ----------
    scene : Scene
        Its ``analysis`` section names regions and paths; without one the defaults hold.
    input : Path
        The file to analyse: flow, charge or orientations; its contract is read from the file.
    output : Path
        ``analysis.vtkhdf``; beside it appear ``tables/``, ``figures/``, ``analysis.json`` and ``report.html``.
    volume : Path, optional
        Phantom volume with true directions; with `orientations` the report sets CT beside truth.
    orientations, charge : Path, optional
        Forerunners of the input, overlaid in the plots.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    InputFileError
        If a file is missing, damaged or of no use here.
    SceneError
        If a path cannot be laid through the material, or input and output are the same file.
    StorageError
        If the results cannot be written.
    """
    from ppmc.scene.analysis import AnalysisSection

    section = scene.analysis or AnalysisSection()
    given = [path for path in (input, volume, orientations, charge) if path is not None]
    check_output(output, given)
    product = _product(input)
    with ExitStack() as stack, Progress("analysis", total=6, unit="parts") as bar:
        opened = _open(stack, product, input, volume, orientations, charge)
        bar.update(1, "sources")
        results = _average(scene, section, product, opened)
        bar.update(2, "averages")
        if "volume" in opened and "orientations" in opened:
            results.truth = compare_with_truth(
                opened["volume"], opened["orientations"], section.margin, _truth_sources(opened), results.notes
            )
        flow = opened.get("flow")
        if flow is not None:
            results.kinematics = [_kinematics_of(flow, k) for k in range(len(flow.times))]
            results.press_force = press_force(flow.history, flow.times, flow.scalars)
            _note_missing(results, flow)
        bar.update(3, "kinematics")
        pictures, reason = draw_views(results, section.views, section.view_points)
        if reason is not None:
            results.notes.append(
                f"Three-dimensional views were drawn with matplotlib, as VTK could not be used here: {reason}."
            )
        bar.update(4, "views")
        pictures = draw_curves(results) + pictures
        bar.update(5, "curves")
        own = Provenance.collect("ppmc.analysis", scene=scene, sections=("analysis",), inputs=given)
        inputs = [
            InputFile(path.name, name, own.inputs.get(path.name, ""), opened[name].provenance)
            for name, path in _named(product, input, volume, orientations, charge).items()
        ]
        _write(scene, results, pictures, inputs, own, output)
        bar.update(6, "report")
    return output


def _product(path: Path) -> str:
    """Return the contract of the input file."""
    product = product_of(path)
    if product not in KINDS:
        raise InputFileError(
            f"{path}: holds '{product}'; ppmc analyze reads {', '.join(KINDS)} (a phantom volume goes to --volume)"
        )
    return product


def _named(
    product: str, input: Path, volume: Path | None, orientations: Path | None, charge: Path | None
) -> dict[str, Path]:
    paths = {"volume": volume, "orientations": orientations, "charge": charge}
    if paths.get(product) is not None and Path(paths[product] or "").absolute() != Path(input).absolute():
        raise SceneError(f"two {product} files: {input} and {paths[product]}; give one")
    paths[product] = input
    return {name: path for name, path in paths.items() if path is not None}


def _open(
    stack: ExitStack, product: str, input: Path, volume: Path | None, orientations: Path | None, charge: Path | None
) -> dict[str, Any]:
    """Open every file for the length of the run."""
    opened: dict[str, Any] = {}
    for name, path in _named(product, input, volume, orientations, charge).items():
        if name == "flow":
            opened[name] = stack.enter_context(open_series(path, "flow"))
        elif name == "charge":
            opened[name] = read_particles(path, "charge")
        else:
            opened[name] = stack.enter_context(read_voxels(path, name))
    return opened


def _sources(opened: dict[str, Any], every_frame: bool, notes: list[str]) -> list[Source]:
    """Return what to average, in the order of the chain."""
    sources = []
    if "volume" in opened:
        if {"fibre_direction", "platelet_normal"} <= set(opened["volume"].names):
            sources.append(truth_source(opened["volume"]))
        else:
            notes.append("The volume carries no true directions (only phantoms do), so it is left out.")
    if "orientations" in opened:
        sources.append(orientations_source(opened["orientations"]))
    if "charge" in opened:
        sources.append(charge_source(opened["charge"]))
    flow: SeriesFile | None = opened.get("flow")
    if flow is not None:
        last = len(flow.times) - 1
        frames = range(last + 1) if every_frame else sorted({0, last})
        sources += [flow_source(flow, k) for k in frames]
        if last == 0:
            notes.append("The flow file holds one time step only: start and end are the same.")
        if not flow.complete:
            notes.append("The flow file is still growing: the run has not come to its end.")
    return sources


def _average(scene: Scene, section: AnalysisSection, product: str, opened: dict[str, Any]) -> Results:
    """Average every source over every region and path."""
    notes: list[str] = []
    sources = _sources(opened, section.frames == "all", notes)
    regions = build_regions(section)
    known = [s for s in sources if s.count]
    for s in sources:
        if not s.count:
            notes.append(f"{s.title} holds no point with a known direction.")
    paths = tuple(build_path(name, p, known) for name, p in section.every_path.items()) if known else ()
    every = [*regions, *(region for path in paths for region in path.regions)]
    analysed = []
    for source in sources:
        averages = source.averages(every)
        parts, at = [], len(regions)
        for path in paths:
            parts.append(averages[at : at + len(path)])
            at += len(path)
        analysed.append(Analysed(source, averages[: len(regions)], tuple(parts)))
    results = Results(regions, paths, analysed, product, notes=notes)
    _add_local_paths(scene, section, results)
    for k, region in enumerate(regions):
        empty = [e.source.title for e in results.shown if e.source.count and not e.regions.particle_count[k]]
        if empty:
            notes.append(f"Region '{region.name}' ({region.describe()}) holds no point of: {'; '.join(empty)}.")
    return results


def _add_local_paths(scene: Scene, section: AnalysisSection, results: Results) -> None:
    """Show swept paths in local axes too, with the normal of the tool nearest to the material of each region (D6)."""
    if not results.shown:
        return
    last = results.shown[-1]
    for k, path in enumerate(results.paths):
        spec = section.every_path[path.name]
        if spec.kind != "swept" or not spec.local:
            continue
        axial = np.eye(3)[AXIS_NAMES.index(spec.along)]
        normals, origin = tool_normals(scene, last.paths[k].centroid, last.source.time or 0.0), "the nearest tool"
        if normals is None:
            third = 3 - AXIS_NAMES.index(spec.along) - AXIS_NAMES.index(spec.sweep)
            normals, origin = (
                material_normals(last.paths[k].normal_tensor, np.eye(3)[third]),
                "the platelets, as no tool is known",
            )
        local = localise(path, normals, axial, origin)
        results.paths = (*results.paths, local)
        results.analysed = [replace(e, paths=(*e.paths, e.paths[k])) for e in results.analysed]


def _truth_sources(opened: dict[str, Any]) -> list[tuple[str, str, Source, bool]]:
    """Return what follows CT in the comparison: label, note, source, whether the interior is that of the start."""
    rows: list[tuple[str, str, Source, bool]] = []
    if "charge" in opened:
        rows.append(("charge", "particles in the interior", charge_source(opened["charge"]), False))
    flow: SeriesFile | None = opened.get("flow")
    if flow is not None:
        start, end = float(flow.times[0]), float(flow.times[-1])
        rows.append((f"flow, t = {start:.4g} s", "particles that start in the interior", flow_source(flow, 0), True))
        rows.append((f"flow, t = {end:.4g} s", "the same particles after the flow", flow_source(flow, -1), True))
    return rows


def _kinematics_of(flow: SeriesFile, k: int) -> Kinematics:
    names = [name for name in ("deformation_gradient", "volume_ratio") if name in flow.names]
    values = flow.frame(k, names)
    return kinematics(
        flow.times[k],
        flow.static["volume"],
        values["position"],
        values.get("deformation_gradient"),
        values.get("volume_ratio"),
    )


def _note_missing(results: Results, flow: SeriesFile) -> None:
    if "platelet_normal" not in flow.names and "in_plane_direction" not in flow.names:
        results.notes.append("The flow file carries neither platelet_normal nor in_plane_direction: N is not known.")
    if results.press_force is None:
        results.notes.append("The flow file carries no forces: there is no press-force curve.")


def _write(
    scene: Scene,
    results: Results,
    pictures: Sequence[Picture],
    inputs: Sequence[InputFile],
    own: Provenance,
    output: Path,
) -> None:
    """Write tables, figures, JSON, report, and at last the analysis file, whose presence says that all is there."""
    import pandas as pd

    folder = output.parent
    tables: dict[str, pd.DataFrame] = {
        "regions": pd.concat([region_table(e.source.label, e.source.time, e.regions) for e in results.analysed]),
        "fourth_order": pd.concat([fourth_table(e.source.label, e.source.time, e.regions) for e in results.analysed]),
    }
    if results.paths:
        tables["paths"] = pd.concat(
            [
                path_table(path, e.source.label, e.source.time, results.path_averages(e, k))
                for e in results.analysed
                for k, path in enumerate(results.paths)
            ]
        )
    if results.kinematics:
        tables["kinematics"] = kinematics_table(results.kinematics)
    if results.truth is not None:
        tables["truth"] = truth_table(results.truth.rows)
    if results.press_force is not None:
        force = results.press_force
        tables["press_force"] = pd.DataFrame(
            {"time_s": force.time, **{f"{tool}_N": f * 1e-6 for tool, f in force.forces.items()}}
        )
    for name, table in tables.items():
        _write_text(folder / "tables" / f"{name}.csv", table.to_csv(index=False, float_format="%.9g"))
    for picture in pictures:
        with whole_file(folder / "figures" / f"{picture.name}.png") as temporary:
            temporary.write_bytes(picture.png)
    summary = {
        "scene": scene.name,
        "key": own.key,
        "inputs": {i.name: i.digest for i in inputs},
        **flat_summary(results),
    }
    _write_text(folder / "analysis.json", json.dumps(to_json_ready(summary), indent=1))
    _write_text(
        folder / "report.html",
        write_report(f"ppmc analysis: {scene.name}", scene.description, results, pictures, inputs, own),
    )
    _write_series(results, own, output)


def _write_text(path: Path, text: str) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _write_series(results: Results, own: Provenance, output: Path) -> None:
    """Write the main input's tensors over regions and paths, a frame a time step, as points at the regions' centres."""
    regions: tuple[Region, ...] = (*results.regions, *(region for path in results.paths for region in path.regions))
    fields = (
        "fibre_tensor", "normal_tensor", "principal_fibre_direction", "principal_normal_direction",
        "particle_count", "region_volume",
    )  # fmt: skip
    partial = output.with_name(f"{output.stem}.partial{output.suffix}")
    static = {"region_id": np.arange(len(regions), dtype=np.int32)}
    writer = SeriesWriter.create(partial, len(regions), static, fields, (), provenance=own, product="analysis")
    for entry in results.frames:
        averages = (entry.regions, *entry.paths)
        joined = {
            name: np.concatenate([getattr(a, name) for a in averages])
            for name in ("fibre_tensor", "normal_tensor", "particle_count", "material_volume", "centroid")
        }
        bounded = np.array([np.isfinite(r.lower).any() or np.isfinite(r.upper).any() for r in regions])
        centres = np.array([r.centre for r in regions])
        known = np.isfinite(joined["centroid"]).all(axis=1)
        positions = np.where((~bounded & known)[:, None], joined["centroid"], centres)
        writer.append(
            entry.source.time or 0.0,
            positions,
            {
                "fibre_tensor": to_six(joined["fibre_tensor"]),
                "normal_tensor": to_six(joined["normal_tensor"]),
                "principal_fibre_direction": principal_directions(joined["fibre_tensor"]),
                "principal_normal_direction": principal_directions(joined["normal_tensor"]),
                "particle_count": joined["particle_count"],
                "region_volume": joined["material_volume"],
            },
        )
    names = [region.name for region in regions]
    described = [region.describe() for region in regions]
    writer.seal(output, extra={"region_names": names, "region_descriptions": described})


def principal_directions(tensor: np.ndarray) -> np.ndarray:
    """Return the direction of the largest eigenvalue, shape (m, 3), NaN for tensors that are not known."""
    out = np.full(tensor.shape[:-1], np.nan)
    known = np.isfinite(tensor).all(axis=(-1, -2))
    if known.any():
        out[known] = np.linalg.eigh(tensor[known])[1][..., -1]
    return out
