"""The report: results and figures in one page, each with what it shows, units, region and count of particles."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ppmc.analysis.figures.figure import Picture, is_voxels
from ppmc.analysis.flow.results import Results
from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.analysis.report.flow import kinematics_table, knit_tables, mesh_table, run_tables
from ppmc.analysis.report.html import Document
from ppmc.analysis.report.tensors import region_tables, truth_tables
from ppmc.analysis.report.verdict import verdict_table
from ppmc.files import Provenance


@dataclass(frozen=True)
class InputFile:
    """One input as the report names it.

    Attributes
    ----------
    name, product, digest : str
        File name, contract or what it is here for, SHA-256.
    provenance : Provenance or None
        None for files that carry none, such as meshes.
    """

    name: str
    product: str
    digest: str
    provenance: Provenance | None


def write_report(
    title: str,
    description: str,
    results: Results,
    pictures: Sequence[Picture],
    inputs: Sequence[InputFile],
    own: Provenance,
    mapped: Mapping[str, MappedMesh] | None = None,
) -> str:
    """Return the whole report as HTML."""
    page = Document(title, description)
    drawn: set[str] = set()

    def figures(section: str) -> None:
        for picture in pictures:
            if picture.section == section:
                page.picture(picture.image, picture.caption, picture.name, picture.kind)
                drawn.add(picture.name)

    if results.main == "flow":
        page.section("Verdict")
        verdict_table(page, results.verdict)
    page.section("Overview")
    _overview(page, results)
    for note in results.notes:
        page.note(note)
    if results.truth is not None:
        page.section("CT and chain beside the phantom's truth")
        truth_tables(page, results)
    page.section("Regions")
    region_tables(page, results)
    figures("Regions")
    page.section("Paths")
    figures("Paths")
    if not results.paths:
        page.text("No path could be laid, as no source holds a point.")
    if results.seeds is not None or results.comparisons:
        page.section("Other runs")
        run_tables(page, results)
        figures("Other runs")
    if any(picture.section == "Views" for picture in pictures):
        page.section("Views")
        figures("Views")
    if results.kinematics:
        page.section("Deformation and volume")
        kinematics_table(page, results)
        figures("Deformation and volume")
    if results.press_force is not None:
        page.section("Press force")
        figures("Press force")
    if results.flow_maps is not None:
        page.section("Filling and knit lines")
        knit_tables(page, results)
        figures("Filling and knit lines")
    if mapped:
        page.section("Structural mesh")
        mesh_table(page, mapped)
    rest = list(dict.fromkeys(p.section for p in pictures if p.name not in drawn))
    for section in rest:
        page.section(section)
        figures(section)
    page.section("Where this comes from")
    _provenance(page, inputs, own)
    return page.html(
        f"ppmc {own.ppmc_version}; lengths in mm, times in s, stresses in Pa; x1, x2, x3 are the axes of the tool."
    )


def _overview(page: Document, results: Results) -> None:
    rows = []
    for e in results.analysed:
        size = e.source.upper - e.source.lower
        rows.append(
            [
                e.source.label,
                e.source.product,
                e.source.time,
                e.source.count,
                "voxels" if is_voxels(e) else "particles",
                float(e.regions.material_volume[0]),
                " × ".join("none" if np.isnan(s) else f"{s:.4g}" for s in size),
            ]
        )
    page.table(
        ("source", "file", "time [s]", "points", "kind", "volume [mm³]", "extent [mm]"),
        rows,
        "What was averaged. Every average is weighted by volume: of voxels their own, of particles the volume "
        "they had at the start.",
    )


def _provenance(page: Document, inputs: Sequence[InputFile], own: Provenance) -> None:
    page.table(
        ("input", "file", "made by", "ppmc", "seed", "SHA-256"),
        [
            [
                i.product,
                i.name,
                i.provenance.creator if i.provenance is not None else None,
                i.provenance.ppmc_version if i.provenance is not None else None,
                None if i.provenance is None or i.provenance.seed is None else str(i.provenance.seed),
                i.digest,
            ]
            for i in inputs
        ],
        "Files this report was made from.",
    )
    page.pairs(
        {
            "ppmc": own.ppmc_version,
            **own.packages,
            "key of this analysis": own.key,
        }
    )
    page.details("Resolved scene (mm, s, g, Pa)", json.dumps(own.scene, indent=1, sort_keys=True))
