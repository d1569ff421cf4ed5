"""Tables of the report on orientation: A and N over regions, and the chain beside the phantom's truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from ppmc.analysis.flow.results import Results
from ppmc.analysis.flow.truth import TruthRow
from ppmc.analysis.report.html import Document
from ppmc.analysis.report.tables import SIX_INDICES
from ppmc.orientation import to_six

TENSORS = (("A", "fibre_tensor"), ("N", "normal_tensor"))
AGREES_WITHIN = 0.03


def region_tables(page: Document, results: Results) -> None:
    """Add A and N of every region and source."""
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


def truth_tables(page: Document, results: Results) -> None:
    """Add the comparison with the phantom's truth, if there is one."""
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


def _tensor_rows(results: Results, region: int, name: str) -> list[list[Any]]:
    rows = []
    for e in results.analysed:
        count = int(e.regions.particle_count[region])
        values = to_six(getattr(e.regions, name)[region])
        cells: list[Any] = [float(v) for v in values] if count else [("empty", "none")] * 6
        share = float(np.diagonal(values).sum()) if values.ndim == 2 else float(values[:3].sum())
        rows.append([e.source.label, e.source.time, count, *cells, share if count else None])
    return rows


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
