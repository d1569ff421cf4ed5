"""Everything an analysis writes: tables, figures, JSON, report, mapped mesh, and at last the analysis file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.averages.local import COMPONENTS
from ppmc.analysis.averages.regions import Region
from ppmc.analysis.figures.figure import Picture
from ppmc.analysis.figures.panels import scalar_maps, squares
from ppmc.analysis.figures.scene_html import scene_page
from ppmc.analysis.flow.results import Results
from ppmc.analysis.mesh.formats import write_mapped
from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.analysis.report.report import InputFile, write_report
from ppmc.analysis.report.summary import flat_summary
from ppmc.analysis.report.tables import (
    comparison_table,
    difference_table,
    element_table,
    ensemble_table,
    fourth_table,
    kinematics_table,
    knit_table,
    path_table,
    region_table,
    to_json_ready,
    truth_table,
)
from ppmc.files import Provenance, SeriesWriter, file_digest, growing_folder, whole_file
from ppmc.orientation import to_six

if TYPE_CHECKING:
    import pandas as pd

    from ppmc.scene import Scene
    from ppmc.scene.sections.analysis import AnalysisSection


def write_results(
    scene: Scene,
    section: AnalysisSection,
    results: Results,
    pictures: Sequence[Picture],
    inputs: Sequence[InputFile],
    own: Provenance,
    output: Path,
    mapped: Mapping[str, MappedMesh] | None = None,
) -> None:
    """Write all results beside `output`; it comes last, so its presence says that everything is there.

    Raises
    ------
    StorageError
        If a file cannot be written.
    """
    folder = output.parent
    names = ["analysis.json", "report.html"]
    tables = result_tables(results)
    for name, table in tables.items():
        _write_text(folder / "tables" / f"{name}.csv", table.to_csv(index=False, float_format="%.9g"))
        names.append(f"tables/{name}.csv")
    for name, picture in zip(file_names([picture.name for picture in pictures]), pictures, strict=True):
        _write_bytes(folder / "figures" / f"{name}.{picture.kind}", picture.image)
        names.append(f"figures/{name}.{picture.kind}")
    for label, mesh in (mapped or {}).items():
        name = "mapped" if label == "input" else file_names([f"mapped_{label}"])[0]
        write_mapped(mesh, folder, name, section.mesh.formats if section.mesh is not None else ())
        elements = element_table(mesh).to_csv(index=False, float_format="%.9g")
        _write_text(folder / "tables" / f"{name}_elements.csv", elements)
        made = [path.name for path in folder.glob(f"{name}[._]*") if path.is_file()]
        names += [*made, f"tables/{name}_elements.csv"]
    if section.interactive and results.frames:
        _write_scene_page(scene, section, results, folder)
        names.append("scene.html")
    summary = {
        "scene": scene.name,
        "key": own.key,
        "inputs": {i.name: i.digest for i in inputs},
        **flat_summary(results),
    }
    _write_text(folder / "analysis.json", json.dumps(to_json_ready(summary), indent=1))
    title = f"ppmc analysis: {scene.name}"
    page = write_report(title, scene.description, results, pictures, inputs, own, mapped)
    _write_text(folder / "report.html", page)
    _write_series(results, own, output, _digests(folder, names))


def _digests(folder: Path, names: Sequence[str]) -> dict[str, str]:
    """Return the digests of what was written beside the analysis file, so that damage to it is noticed."""
    return {name: file_digest(folder / name) for name in sorted(set(names))}


def file_names(names: Sequence[str]) -> list[str]:
    """Return names safe for files and all different: runs are labelled after folders, which may hold anything."""
    out: list[str] = []
    for name in names:
        plain = re.sub(r"[^\w.-]+", "_", name).strip("._") or "figure"
        unique, k = plain, 2
        while unique in out:
            unique, k = f"{plain}_{k}", k + 1
        out.append(unique)
    return out


def result_tables(results: Results) -> dict[str, pd.DataFrame]:
    """Return every table of the results by name, as pandas frames."""
    import pandas as pd

    each = results.analysed
    tables = {
        "regions": pd.concat([region_table(e.source.label, e.source.time, e.regions) for e in each]),
        "fourth_order": pd.concat([fourth_table(e.source.label, e.source.time, e.regions) for e in each]),
    }
    if results.paths:
        tables["paths"] = pd.concat(
            [
                path_table(path, e.source.label, e.source.time, results.path_averages(e, k))
                for e in each
                for k, path in enumerate(results.paths)
            ]
        )
    if results.kinematics:
        tables["kinematics"] = kinematics_table(results.kinematics)
    if results.truth is not None:
        tables["truth"] = truth_table(results.truth.rows)
    if results.press_force is not None:
        force = results.press_force
        newtons = {f"{tool}_N": f * 1e-6 for tool, f in force.forces.items()}
        table = pd.DataFrame({"time_s": force.time, **newtons})
        tables["press_force"] = table.assign(upper_bound=True) if force.bound else table
    if results.seeds is not None:
        tables["seeds_regions"] = ensemble_table([r.name for r in results.regions], results.seeds)
        for path, seeds in zip(results.paths, results.path_seeds, strict=True):
            names = [r.name for r in path.regions]
            table = ensemble_table(names, seeds)
            table.insert(1, "coordinate", path.coordinate)
            tables[f"seeds_path_{path.name}"] = table
    if results.comparisons:
        tables["comparisons"] = comparison_table(results.comparisons)
    if results.others and results.frames:
        tables["differences"] = difference_table(results.frames[-1], results.others)
    if results.flow_maps is not None and len(results.flow_maps.knit):
        tables["knit_line"] = knit_table(results.flow_maps.samples.positions, results.flow_maps.knit)
    return tables


def _write_text(path: Path, text: str) -> None:
    _write_bytes(path, text.encode("utf-8"))


def _write_bytes(path: Path, data: bytes) -> None:
    with whole_file(path) as temporary:
        temporary.write_bytes(data)


def _write_scene_page(scene: Scene, section: AnalysisSection, results: Results, folder: Path) -> None:
    source = results.frames[-1].source
    samples = source.thinned(section.view_points)
    maps = scalar_maps(samples)
    if results.flow_maps is not None and len(samples) == len(results.flow_maps.samples):
        maps = scalar_maps(results.flow_maps.samples)
    shown = [*squares(samples, "fibre_direction"), *squares(samples, "platelet_normal"), *maps]
    page = scene_page(f"{scene.name}: {source.title}", samples.positions, source.spacing, shown)
    _write_text(folder / "scene.html", page)


def _write_series(results: Results, own: Provenance, output: Path, beside: Mapping[str, str]) -> None:
    """Write the input's tensors over regions and paths, a frame a time step, as points at the regions' centres."""
    # A local path has the regions of the path it was made from; the file keeps tool axes and so holds them once.
    kept = [k for k, path in enumerate(results.paths) if path.components != COMPONENTS]
    regions: tuple[Region, ...] = (*results.regions, *(r for k in kept for r in results.paths[k].regions))
    fields = (
        "fibre_tensor", "normal_tensor", "principal_fibre_direction", "principal_normal_direction",
        "particle_count", "region_volume",
    )  # fmt: skip
    static = {"region_id": np.arange(len(regions), dtype=np.int32)}
    writer = SeriesWriter.create(
        growing_folder(output), len(regions), static, fields, (), provenance=own, product="analysis"
    )
    try:
        for entry in results.frames:
            averages = (entry.regions, *(entry.paths[k] for k in kept))
            centroid = np.concatenate([a.centroid for a in averages])
            fibre = np.concatenate([a.fibre_tensor for a in averages])
            normal = np.concatenate([a.normal_tensor for a in averages])
            known = np.isfinite(centroid).all(axis=1, keepdims=True)
            near = np.where(known, centroid, [r.origin for r in regions])
            writer.append(
                entry.source.time or 0.0,
                np.array([r.centre_near(x) for r, x in zip(regions, near, strict=True)]),
                {
                    "fibre_tensor": to_six(fibre),
                    "normal_tensor": to_six(normal),
                    "principal_fibre_direction": principal_directions(fibre),
                    "principal_normal_direction": principal_directions(normal),
                    "particle_count": np.concatenate([a.particle_count for a in averages]),
                    "region_volume": np.concatenate([a.material_volume for a in averages]),
                },
            )
        names = [region.name for region in regions]
        described = {"region_names": names, "region_descriptions": [r.describe() for r in regions]}
        writer.seal(output, extra={**described, "files": dict(beside)})
    finally:
        writer.remove()  # gone already if it was sealed


def principal_directions(tensor: np.ndarray) -> np.ndarray:
    """Return the direction of the largest eigenvalue, shape (m, 3), NaN for tensors that are not known."""
    out = np.full(tensor.shape[:-1], np.nan)
    known = np.isfinite(tensor).all(axis=(-1, -2))
    if known.any():
        out[known] = np.linalg.eigh(tensor[known])[1][..., -1]
    return out
