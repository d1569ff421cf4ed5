"""Everything an analysis writes: tables, figures, JSON, report, mapped mesh, and at last the analysis file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
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
from ppmc.errors import InputFileError
from ppmc.files import MemorySeries, Provenance, SeriesFile, check_output, file_digest, whole_file, write_series
from ppmc.files.beside import is_marked, mark
from ppmc.files.guard import open_guarded
from ppmc.files.lock import remove_leftovers
from ppmc.files.storage import is_text_with
from ppmc.files.text import read_json
from ppmc.orientation import to_six

MARKED = (".gif", ".msh", ".png", ".vtu")
DECKS = (".inp", ".k")  # begin with two lines that are ours and always the same
# What stands near the start of texts that have no place for a mark.
TEXTS = {"report.html": b"ppmc analysis", "analysis.json": b'"scene": ', "scene.html": b"ppmc"}

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
    *,
    keep: Iterable[Path | None] = (),
    force: bool = False,
) -> None:
    """Write all results beside `output`; it comes last, so its presence says that everything is there.

    Parameters
    ----------
    keep : iterable of Path
        Files that are not replaced: those that were read.
    force : bool
        Replace files of other programs.

    Raises
    ------
    SceneError
        If a result would replace a file that was read, or another program's; nothing is written then.
    StorageError
        If a file cannot be written.
    """
    folder, contents = output.parent, dict[str, bytes]()
    for name, table in result_tables(results).items():
        contents[f"tables/{name}.csv"] = _csv(table)
    for name, picture in zip(file_names([picture.name for picture in pictures]), pictures, strict=True):
        contents[f"figures/{name}.{picture.kind}"] = picture.image
    for label, mesh in (mapped or {}).items():
        name = "mapped" if label == "input" else file_names([f"mapped_{label}"])[0]
        with TemporaryDirectory(prefix="ppmc-mapped-") as fresh:
            write_mapped(mesh, Path(fresh), name, section.mesh.formats if section.mesh is not None else ())
            contents |= {path.name: path.read_bytes() for path in sorted(Path(fresh).iterdir())}
        contents[f"tables/{name}_elements.csv"] = _csv(element_table(mesh))
    if section.interactive and results.frames:
        contents["scene.html"] = _scene_page(scene, section, results).encode()
    summary = {
        "scene": scene.name,
        "key": own.key,
        "inputs": {i.name: i.digest for i in inputs},
        **flat_summary(results),
    }
    contents["analysis.json"] = json.dumps(to_json_ready(summary), indent=1).encode()
    title = f"ppmc analysis: {scene.name}"
    page = write_report(title, scene.description, results, pictures, inputs, own, mapped)
    contents["report.html"] = page.encode()
    _check_all(output, contents, keep, force)
    for name, data in contents.items():
        _write(folder / name, data)
    # Damage to what stands beside the analysis file is noticed by its digests.
    beside = {name: file_digest(folder / name) for name in sorted(contents)}
    write_series(analysis_series(results, own, beside), output)


def _check_all(output: Path, contents: Mapping[str, bytes], keep: Iterable[Path | None], force: bool) -> None:
    """Make sure that every file may be written, before the first one is; remove what a killed run has left of them.

    An existing file is ours if it bears a mark, begins as the new one does, or is as the last analysis has noted it.
    """
    try:
        with open_guarded(output, "analysis") as file:
            noted = read_json(file["ppmc"], "extra").get("files", {})
    except InputFileError:
        noted = {}
    kept = list(keep)

    def what(path: Path) -> str:
        name = path.relative_to(output.parent).as_posix()
        if noted.get(name) == file_digest(path):
            return ""
        if path.suffix in MARKED:
            return is_marked(path)
        start = TEXTS.get(name) or b"\n".join(contents[name].split(b"\n", 2)[: 2 if path.suffix in DECKS else 1])
        return is_text_with(start, max(len(start), 4096))(path)

    for name in contents:
        path = output.parent / name
        check_output(path, kept, is_own=what, force=force)
        remove_leftovers(path.parent, path.name)


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


def _csv(table: pd.DataFrame) -> bytes:
    return table.to_csv(index=False, float_format="%.9g").encode()


def _write(path: Path, data: bytes) -> None:
    with whole_file(path) as temporary:
        temporary.write_bytes(data)
        if path.suffix in (".png", ".gif"):
            mark(temporary, path.suffix)


def _scene_page(scene: Scene, section: AnalysisSection, results: Results) -> str:
    source = results.frames[-1].source
    samples = source.thinned(section.view_points)
    maps = scalar_maps(samples)
    if results.flow_maps is not None and len(samples) == len(results.flow_maps.samples):
        maps = scalar_maps(results.flow_maps.samples)
    shown = [*squares(samples, "fibre_direction"), *squares(samples, "platelet_normal"), *maps]
    return scene_page(f"{scene.name}: {source.title}", samples.positions, source.spacing, shown)


def analysis_series(results: Results, own: Provenance, beside: Mapping[str, str]) -> SeriesFile:
    """Return the input's tensors over regions and paths, a frame a time step, as points at the regions' centres.

    Parameters
    ----------
    results : Results
        With at least one frame.
    own : Provenance
    beside : mapping of str to str
        Digests of the files that are written beside.
    """
    # A local path has the regions of the path it was made from; the file keeps tool axes and so holds them once.
    kept = [k for k, path in enumerate(results.paths) if path.components != COMPONENTS]
    regions: tuple[Region, ...] = (*results.regions, *(r for k in kept for r in results.paths[k].regions))
    fields = (
        "fibre_tensor", "normal_tensor", "principal_fibre_direction", "principal_normal_direction",
        "particle_count", "region_volume",
    )  # fmt: skip
    static = {"region_id": np.arange(len(regions), dtype=np.int32)}
    series = MemorySeries("analysis", static, fields, (), own)
    for entry in results.frames:
        averages = (entry.regions, *(entry.paths[k] for k in kept))
        centroid = np.concatenate([a.centroid for a in averages])
        fibre = np.concatenate([a.fibre_tensor for a in averages])
        normal = np.concatenate([a.normal_tensor for a in averages])
        known = np.isfinite(centroid).all(axis=1, keepdims=True)
        near = np.where(known, centroid, [r.origin for r in regions])
        series.append(
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
            {},
        )
    names = [region.name for region in regions]
    described = {"region_names": names, "region_descriptions": [r.describe() for r in regions]}
    series.seal({}, {**described, "files": dict(beside)})
    return series.opened()


def principal_directions(tensor: np.ndarray) -> np.ndarray:
    """Return the direction of the largest eigenvalue, shape (m, 3), NaN for tensors that are not known."""
    out = np.full(tensor.shape[:-1], np.nan)
    known = np.isfinite(tensor).all(axis=(-1, -2))
    if known.any():
        out[known] = np.linalg.eigh(tensor[known])[1][..., -1]
    return out
