"""The analysis stage: open the chain's files, gather results, draw, write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ppmc.analysis.figures.curves import draw_curves
from ppmc.analysis.figures.movie import filling_movie
from ppmc.analysis.figures.pictures import draw_views
from ppmc.analysis.flow.compare import compare_with_truth
from ppmc.analysis.gather import Opened, gather, truth_links
from ppmc.analysis.mesh.mesh import read_mesh
from ppmc.analysis.mesh.structural import map_mesh
from ppmc.analysis.output import TEXTS, write_results
from ppmc.analysis.report.report import InputFile
from ppmc.errors import InputFileError, SceneError
from ppmc.files import (
    Claim,
    Provenance,
    SeriesFile,
    check_output,
    is_product,
    one_writer,
    open_series,
    read_particles,
    read_voxels,
)
from ppmc.files.guard import product_of
from ppmc.files.storage import is_text_with
from ppmc.progress import Progress
from ppmc.scene.depends import of_analysis

if TYPE_CHECKING:
    from ppmc.scene import Scene

KINDS = ("flow", "charge", "orientations")


def _claims(given: Mapping[str, Any]) -> list[Claim]:
    """Return what an analysis writes: its file, and the report, tables and figures of the folder."""
    output = Path(given["output"])
    return [Claim(output), Claim(output.with_name("report.html"))]


@one_writer(_claims)
def run(
    scene: Scene,
    *,
    input: Path,
    output: Path,
    volume: Path | None = None,
    orientations: Path | None = None,
    charge: Path | None = None,
    moulded: Path | None = None,
    compare: Sequence[Path] = (),
    seeds: Sequence[Path] = (),
    force: bool = False,
) -> Path:
    """Analyse a flow, a charge or an orientations file, beside its forerunners and other runs where they are given.

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
    moulded : Path, optional
        Orientations measured by CT in the moulded part, set beside the flow's last frame (J Figs 11 to 14).
    compare : sequence of Path
        Flows of other runs, overlaid and compared with the input.
    seeds : sequence of Path
        Flows of the same case with other seeds, joined with the input into mean and spread.
    force : bool
        Replace an output, or a report, that ppmc did not write.

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
    from ppmc.scene.sections.analysis import AnalysisSection

    section = scene.analysis or AnalysisSection()
    product = _product(input)
    if (compare or seeds or moulded) and product != "flow":
        raise SceneError(
            f"{input}: only a flow can be set beside other runs or a moulded part, this file holds '{product}'"
        )
    named = _named(product, input, volume, orientations, charge)
    mesh_path = scene.locate(section.mesh.path) if section.mesh is not None else None
    mask = section.front.mask
    mask_path = scene.locate(mask.path) if mask is not None else None
    if mask_path is not None and product != "flow":
        raise SceneError(f"{input}: analysis.front.mask needs a flow to compare with, this file holds '{product}'")
    depends = of_analysis(scene, [*named.values(), *compare, *seeds, moulded])
    check_output(output, [*depends.inputs, scene.file], is_own=is_product("analysis"), force=force)
    for name, mark in TEXTS.items():
        check_output(output.with_name(name), depends.inputs, is_own=is_text_with(mark), force=force)
    mesh = read_mesh(mesh_path, section.mesh.scale) if mesh_path is not None and section.mesh is not None else None
    with ExitStack() as stack, Progress("analysis", total=6, unit="parts") as bar:
        opened = _open(stack, product, named, compare, seeds)
        if moulded is not None:
            opened.moulded = stack.enter_context(read_voxels(moulded, "orientations"))
        bar.update(1, "files opened")
        results = gather(scene, section, opened)
        bar.update(2, "averages")
        if opened.volume is not None and opened.orientations is not None:
            links = truth_links(opened)
            results.truth = compare_with_truth(opened.volume, opened.orientations, section.margin, links, results.notes)
        mapped = None
        if mesh is not None and section.mesh is not None and results.frames:
            # CT goes to the same mesh, so that prediction and measurement can be compared element by element (A).
            scans = {e.source.label: e.source for e in results.shown if e.source.product in ("orientations", "moulded")}
            mapped = {
                label: map_mesh(mesh, source, section.mesh, results.notes)
                for label, source in {"input": results.frames[-1].source, **scans}.items()
                if source.count
            }
            if not mapped:
                results.notes.append(f"Mesh {mesh.path.name}: no source holds a point to map.")
        bar.update(3, "comparisons")
        pictures, reason = draw_views(results, section)
        if reason is not None:
            results.notes.append(f"Views were drawn with matplotlib, as VTK could not be used here: {reason}.")
        if section.animation and opened.flow is not None:
            movie = filling_movie(opened.flow)
            pictures += [movie] if movie is not None else []
            if movie is None:
                results.notes.append("The filling could not be drawn as a moving picture, as VTK could not be used.")
        bar.update(4, "views")
        pictures = draw_curves(results) + pictures
        bar.update(5, "curves")
        own = Provenance.of(scene, depends)
        kinds = [*named, *["compare"] * len(compare), *["seed"] * len(seeds)]
        origins = [getattr(opened, name).provenance for name in named]
        origins += [file.provenance for _, file in (*opened.compare, *opened.seeds)]
        if opened.moulded is not None:
            kinds, origins = [*kinds, "moulded"], [*origins, opened.moulded.provenance]
        roles = {mesh_path: "mesh", mask_path: "mask"}
        kinds += [roles.get(path, "tool") for path in depends.inputs[len(kinds) :]]
        inputs = [
            InputFile(name, kind, digest, origin)
            for (name, digest), kind, origin in zip_longest(own.inputs.items(), kinds, origins)
        ]
        keep = [*depends.inputs, *scene.every_named_file()]
        write_results(scene, section, results, pictures, inputs, own, output, mapped, keep=keep, force=force)
        bar.update(6, "report")
    return output


def _product(path: Path) -> str:
    """Return the contract of the input file."""
    product = product_of(path)
    if product not in KINDS:
        kinds = ", ".join(KINDS)
        raise InputFileError(
            f"{path}: holds '{product}'; ppmc analyze reads {kinds} (a phantom volume goes to --volume)"
        )
    return product


def _named(
    product: str, input: Path, volume: Path | None, orientations: Path | None, charge: Path | None
) -> dict[str, Path]:
    """Return the chain's files by product, each product once."""
    paths = {"volume": volume, "orientations": orientations, "charge": charge}
    other = paths.get(product)
    if other is not None and Path(other).absolute() != Path(input).absolute():
        raise SceneError(f"two {product} files: {input} and {other}; give one")
    paths[product] = input
    return {name: Path(path) for name, path in paths.items() if path is not None}


def _open(
    stack: ExitStack, product: str, named: dict[str, Path], compare: Sequence[Path], seeds: Sequence[Path]
) -> Opened:
    """Open every file for the length of the run."""
    opened = Opened(product)
    if "volume" in named:
        opened.volume = stack.enter_context(read_voxels(named["volume"], "volume"))
    if "orientations" in named:
        opened.orientations = stack.enter_context(read_voxels(named["orientations"], "orientations"))
    if "charge" in named:
        opened.charge = read_particles(named["charge"], "charge")
    if "flow" in named:
        opened.flow = stack.enter_context(open_series(named["flow"], "flow"))

    def runs(paths: Sequence[Path]) -> list[tuple[str, SeriesFile]]:
        labels = run_labels(paths)
        return [(n, stack.enter_context(open_series(p, "flow"))) for n, p in zip(labels, paths, strict=True)]

    opened.compare, opened.seeds = runs(compare), runs(seeds)
    return opened


def run_labels(paths: Sequence[Path]) -> list[str]:
    """Name each run after its folder, as runs keep their files in folders, and its file if folders agree."""
    folders = [Path(p).absolute().parent.name for p in paths]
    return [
        folder if folders.count(folder) == 1 else f"{folder}/{Path(p).stem}"
        for folder, p in zip(folders, paths, strict=True)
    ]
