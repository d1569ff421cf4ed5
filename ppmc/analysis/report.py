"""The report: results and figures in one page, each with what it shows, units, region and count of particles."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppmc.analysis.html import Document
from ppmc.analysis.results import Analysed, Results
from ppmc.analysis.structural import MappedMesh
from ppmc.analysis.tables import SIX_INDICES
from ppmc.analysis.truth import TruthRow
from ppmc.files import Provenance
from ppmc.orientation import to_six

TENSORS = (("A", "fibre_tensor"), ("N", "normal_tensor"))
AGREES_WITHIN = 0.03


@dataclass(frozen=True)
class Picture:
    """One figure of the report.

    Attributes
    ----------
    name : str
        File name without ending.
    section : str
        Heading it stands under.
    caption : str
    png : bytes
    """

    name: str
    section: str
    caption: str
    png: bytes


@dataclass(frozen=True)
class InputFile:
    """One input as the report names it.

    Attributes
    ----------
    name, product, digest : str
        File name, contract, SHA-256.
    provenance : Provenance
    """

    name: str
    product: str
    digest: str
    provenance: Provenance


def write_report(
    title: str,
    description: str,
    results: Results,
    pictures: Sequence[Picture],
    inputs: Sequence[InputFile],
    own: Provenance,
    *,
    mapped: Mapping[str, MappedMesh] | None = None,
    movie: bytes | None = None,
) -> str:
    """Return the whole report as HTML."""
    page = Document(title, description)
    drawn: set[str] = set()

    def figures(section: str) -> None:
        for picture in pictures:
            if picture.section == section:
                page.picture(picture.png, picture.caption, picture.name)
                drawn.add(picture.name)

    page.section("Overview")
    _overview(page, results)
    for note in results.notes:
        page.note(note)
    if results.truth is not None:
        page.section("CT and chain beside the phantom's truth")
        _truth(page, results)
    page.section("Regions")
    _regions(page, results)
    figures("Regions")
    page.section("Paths")
    figures("Paths")
    if results.seeds is not None or results.comparisons:
        page.section("Other runs")
        _other_runs(page, results)
    page.section("Views")
    figures("Views")
    if movie is not None:
        page.picture(
            movie, "Filling, p_1² [–] from 0 (dark) to 1 (bright); all particles, start to end.", "filling", "gif"
        )
    if results.kinematics:
        page.section("Deformation and volume")
        _kinematics(page, results)
        figures("Deformation and volume")
    if results.press_force is not None:
        page.section("Press force")
        figures("Press force")
    if results.flow_maps is not None:
        page.section("Filling and knit lines")
        _knit(page, results)
        figures("Filling and knit lines")
    if mapped:
        page.section("Structural mesh")
        _mesh(page, mapped)
    rest = list(dict.fromkeys(p.section for p in pictures if p.name not in drawn))
    for section in rest:
        page.section(section)
        figures(section)
    page.section("Where this comes from")
    _provenance(page, inputs, own)
    return page.html(
        f"ppmc {own.ppmc_version}; lengths in mm, times in s, stresses in Pa; x1, x2, x3 are the axes of the tool."
    )


def describe_counts(entries: Sequence[Analysed]) -> str:
    """Return the number of points of each source, for captions."""
    return "; ".join(
        f"{e.source.title}: {e.source.count:,} {'voxels' if is_voxels(e) else 'particles'}" for e in entries
    )


def is_voxels(entry: Analysed) -> bool:
    """Tell whether a source counts voxels."""
    return entry.source.product in ("volume", "orientations", "moulded")


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


def _tensor_rows(results: Results, region: int, name: str) -> list[list[Any]]:
    rows = []
    for e in results.analysed:
        count = int(e.regions.particle_count[region])
        values = to_six(getattr(e.regions, name)[region])
        cells: list[Any] = [float(v) for v in values] if count else [("empty", "none")] * 6
        share = float(np.diagonal(values).sum()) if values.ndim == 2 else float(values[:3].sum())
        rows.append([e.source.label, e.source.time, count, *cells, share if count else None])
    return rows


def _regions(page: Document, results: Results) -> None:
    page.text(
        "A = ⟨p p⟩ of the fibre direction p and N = ⟨r r⟩ of the platelet normal r, volume averages over each "
        "region in tool axes. "
        "Planar random fibres would give A11 = A22 = 1/2 and N33 = 1. Fourth order and spread are in tables/."
    )
    for k, region in enumerate(results.regions):
        page.subsection(f"{region.name}: {region.describe()}")
        for symbol, name in TENSORS:
            heads = ("source", "time [s]", "points", *(f"{symbol}{i}" for i in SIX_INDICES), "trace")
            word = "fibre directions" if symbol == "A" else "platelet normals"
            page.table(heads, _tensor_rows(results, k, name), f"{symbol} [–] of {word} in '{region.name}'.")


def _truth(page: Document, results: Results) -> None:
    comparison = results.truth
    if comparison is None:
        return
    page.text(
        f"Interior of the specimen, {comparison.margin:.3g} mm away from its faces: {comparison.region.describe()}. "
        f"Differences are to the first row; orange marks more than {AGREES_WITHIN}."
    )
    for symbol, index in (("A", 0), ("N", 1)):
        rows = [_truth_cells(row, index) for row in comparison.rows]
        heads = (
            "source",
            "what",
            "points",
            *(f"{symbol}{i}" for i in SIX_INDICES),
            *(f"Δ{symbol}{i}" for i in SIX_INDICES),
        )
        page.table(heads, rows, f"{symbol} [–] in the interior and its difference from the phantom's truth.")
    page.table(
        ("angle between CT and truth", "voxels", "mean [°]", "median [°]", "90 % below [°]", "99 % below [°]"),
        [
            [name, e.count, e.mean, e.percentile(50), e.percentile(90), e.percentile(99)]
            for name, e in (
                ("fibre direction p", comparison.fibre_errors),
                ("platelet normal r", comparison.normal_errors),
            )
        ],
        "Voxel by voxel in the interior: valid CT voxels against the phantom voxel at the same place, where "
        "that lies in a platelet.",
    )


def _truth_cells(row: TruthRow, index: int) -> list[Any]:
    tensor = (row.averages.fibre_tensor, row.averages.normal_tensor)[index][0]
    difference = (row.fibre_difference, row.normal_difference)[index]
    count = int(row.averages.particle_count[0])
    if not count:
        return [row.label, row.note, 0, *[("empty", "none")] * 12]
    # The material after the squeeze is meant to differ: only measurements are judged.
    judged = row.note.startswith("CT") or row.label == "CT"

    def mark(value: float) -> Any:
        text = "none" if np.isnan(value) else f"{value:+.4f}"
        return (text, ("bad" if abs(value) > AGREES_WITHIN else "good") if judged else "")

    return [
        row.label,
        row.note,
        count,
        *(float(v) for v in to_six(tensor)),
        *(mark(float(v)) for v in to_six(difference)),
    ]


def _kinematics(page: Document, results: Results) -> None:
    heads = (
        "time [s]", "J mean", "J sd", "J least", "J 1 %", "J 99 %", "J largest",
        "F11", "F22", "F33", "sd F11", "sd F22", "sd F33", "largest |F_ij|, i≠j", "extent [mm]",
    )  # fmt: skip
    rows = []
    for k in _few(results.kinematics):
        F, sd = k.mean_deformation_gradient, k.deformation_gradient_spread
        off = np.abs(F - np.diag(np.diagonal(F)))
        rows.append(
            [
                k.time, k.volume_ratio_mean, k.volume_ratio_spread,
                k.volume_ratio_min, k.volume_ratio_low, k.volume_ratio_high, k.volume_ratio_max,
                *(float(v) for v in np.diagonal(F)), *(float(v) for v in np.diagonal(sd)), float(off.max()),
                " × ".join("none" if np.isnan(s) else f"{s:.4g}" for s in k.extent),
            ]
        )  # fmt: skip
    count = results.kinematics[0].particle_count
    page.table(
        heads,
        rows,
        "Volume ratio J = det F and mean deformation gradient F since the start, volume-weighted over all "
        f"{count:,} particles; "
        "sd is the standard deviation over particles. Every frame is in tables/kinematics.csv.",
    )


def _other_runs(page: Document, results: Results) -> None:
    if results.seeds is not None:
        e = results.seeds
        for symbol, mean, spread in (("A", e.fibre_mean, e.fibre_spread), ("N", e.normal_mean, e.normal_spread)):
            rows = []
            for k, region in enumerate(results.regions):
                values = zip(to_six(mean[k]), to_six(spread[k]), strict=True)
                cells = [("empty", "none") if np.isnan(m) else f"{m:.4f} ± {s:.4f}" for m, s in values]
                rows.append([region.name, int(e.filled[k]), *cells])
            heads = ("region", "runs with material", *(f"{symbol}{i}" for i in SIX_INDICES))
            page.table(
                heads,
                rows,
                f"{symbol} [–]: mean and standard deviation between {e.runs} runs with different seeds, last state.",
            )
    if results.others and results.frames:
        for symbol, name in TENSORS:
            rows = []
            for other in results.others:
                gaps = getattr(other.regions, name) - getattr(results.frames[-1].regions, name)
                for region, gap in zip(results.regions, gaps, strict=True):
                    cells = [("empty", "none") if np.isnan(v) else f"{v:+.4f}" for v in to_six(gap)]
                    rows.append([other.source.title, region.name, *cells])
            heads = ("source", "region", *(f"Δ{symbol}{i}" for i in SIX_INDICES))
            page.table(heads, rows, f"{symbol} [–] of each source minus that of the input's last state, by region.")
    if results.comparisons:
        page.table(
            ("run", "overlap [–]", "mean distance [mm]", "99 % below [mm]", "mean angle of p [°]", "99 % below [°]"),
            [
                [
                    c.label, c.difference.overlap, c.difference.distance_mean, c.difference.distance_p99,
                    c.difference.angle_mean, c.difference.angle_p99,
                ]
                for c in results.comparisons
            ],
            "The input's last state beside that of other runs: intersection over union of the filled space; "
            "distance and "
            "angle between the same particles, where both runs move the same.",
        )  # fmt: skip


def _knit(page: Document, results: Results) -> None:
    maps = results.flow_maps
    if maps is None:
        return
    n, knit = len(maps.samples), maps.knit
    if not len(knit):
        page.text(f"No knit line: none of the {n:,} particles met neighbours that came from elsewhere.")
        return
    page.pairs(
        {
            "particles at knit lines": f"{len(knit):,} of {n:,}",
            "fibres across, A_cc, mean [–]": float(knit.crossing.mean()),
            "lowest tenth below": float(np.percentile(knit.crossing, 10)),
            "normals across, N_cc, mean [–]": float(knit.normal_across.mean()),
        }
    )
    page.text(
        "A particle is at a knit line if neighbours within 2.5 spacings started more than 4 spacings from "
        "where its own "
        "deformation would have put them. c points across the line; A_cc is the share of fibres along c within "
        "3 spacings: "
        "1/3 would be isotropic, 0 means that nothing but resin holds the line."
    )


def _mesh(page: Document, mapped: Mapping[str, MappedMesh]) -> None:
    rows = []
    for label, m in mapped.items():
        e = m.elements
        kinds = ", ".join(sorted({kind for kind, _ in m.mesh.blocks}))
        lonely = int((e.particle_count == 0).sum())
        rows.append(
            [label, m.mesh.path.name, kinds, len(e.distance), float(e.distance.mean()), float(e.distance.max()), lonely]
        )
    page.table(
        ("source", "mesh", "types", "elements", "mean distance [mm]", "largest [mm]", "without a point of their own"),
        rows,
        "Distance from element centres to the nearest point. Element data are in mapped*.vtu, element axes for Abaqus "
        "in mapped*_axes.inp.",
    )


def _few(rows: Sequence[Any], most: int = 12) -> list[Any]:
    if len(rows) <= most:
        return list(rows)
    return [rows[int(i)] for i in np.unique(np.linspace(0, len(rows) - 1, most).round())]


def _provenance(page: Document, inputs: Sequence[InputFile], own: Provenance) -> None:
    page.table(
        ("input", "file", "made by", "ppmc", "seed", "SHA-256"),
        [
            [
                i.product,
                i.name,
                i.provenance.creator,
                i.provenance.ppmc_version,
                "none" if i.provenance.seed is None else str(i.provenance.seed),
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


def flat_summary(results: Results) -> Mapping[str, Any]:
    """Return the results as plain nested data, for JSON."""
    return {
        "regions": [
            {
                "name": region.name,
                "description": region.describe(),
                "sources": [
                    {
                        "source": e.source.label,
                        "time_s": e.source.time,
                        "particle_count": int(e.regions.particle_count[k]),
                        "material_volume_mm3": float(e.regions.material_volume[k]),
                        "A": e.regions.fibre_tensor[k],
                        "N": e.regions.normal_tensor[k],
                        "A_spread": e.regions.fibre_spread[k],
                        "N_spread": e.regions.normal_spread[k],
                    }
                    for e in results.analysed
                ],
            }
            for k, region in enumerate(results.regions)
        ],
        "truth": None
        if results.truth is None
        else {
            "interior": results.truth.region.describe(),
            "margin_mm": results.truth.margin,
            "rows": [
                {
                    "source": row.label,
                    "note": row.note,
                    "particle_count": int(row.averages.particle_count[0]),
                    "A": row.averages.fibre_tensor[0],
                    "N": row.averages.normal_tensor[0],
                    "A_difference": row.fibre_difference,
                    "N_difference": row.normal_difference,
                    "largest_difference": row.largest_difference,
                }
                for row in results.truth.rows
            ],
            "fibre_angle_error_deg": {
                "mean": results.truth.fibre_errors.mean,
                "median": results.truth.fibre_errors.percentile(50),
            },
            "normal_angle_error_deg": {
                "mean": results.truth.normal_errors.mean,
                "median": results.truth.normal_errors.percentile(50),
            },
        },
        "kinematics": [
            {
                "time_s": k.time,
                "J_mean": k.volume_ratio_mean,
                "J_sd": k.volume_ratio_spread,
                "F_mean": k.mean_deformation_gradient,
            }
            for k in results.kinematics
        ],
        "comparisons": [
            {"run": c.label, "overlap": c.difference.overlap, "angle_mean_deg": c.difference.angle_mean}
            for c in results.comparisons
        ],
        "knit_line": None
        if results.flow_maps is None
        else {
            "particles": len(results.flow_maps.knit),
            "A_across_mean": float(results.flow_maps.knit.crossing.mean()) if len(results.flow_maps.knit) else None,
            "N_across_mean": float(results.flow_maps.knit.normal_across.mean())
            if len(results.flow_maps.knit)
            else None,
        },
        "notes": results.notes,
    }
