"""Tables of the report on the flow: deformation, other runs, knit lines, structural meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ppmc.analysis.flow.results import Results
from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.analysis.report.html import Document
from ppmc.analysis.report.tables import SIX_INDICES
from ppmc.analysis.report.tensors import TENSORS
from ppmc.orientation import to_six


def kinematics_table(page: Document, results: Results) -> None:
    """Add J and F in time."""
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


def run_tables(page: Document, results: Results) -> None:
    """Add seed statistics, differences by region, and overlaps."""
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
        heads = (
            "beside", "at [s]", "overlap [–]", "seen along x1 [–]", "along x2 [–]", "along x3 [–]",
            "mean distance [mm]", "99 % below [mm]", "mean angle of p [°]", "99 % below [°]",
        )  # fmt: skip
        lines: list[list[Any]] = []
        for c in results.comparisons:
            d = c.difference
            pairs = (d.distance_mean, d.distance_p99, d.angle_mean, d.angle_p99)
            lines.append([c.label, c.time, d.overlap, *c.seen, *pairs])
        page.table(
            heads,
            lines,
            "The input beside other runs, the measured part, a mask: intersection over union of the filled space and "
            "of its silhouettes; distance and angle between the same particles, where both runs move the same.",
        )


def knit_tables(page: Document, results: Results) -> None:
    """Add what is known of knit lines."""
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


def mesh_table(page: Document, mapped: Mapping[str, MappedMesh]) -> None:
    """Add how well mesh and material meet."""
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
        "Distance from element centres to the nearest point. Element data are in mapped*.vtu and "
        "tables/mapped*_elements.csv, element axes for Abaqus in mapped*_axes.inp.",
    )
    if any(m.stiffness is not None for m in mapped.values()):
        page.text(
            "Stiffness of each element: C = B1 𝔸 + B2 (Aδ + δA) + B3 (four permutations) + B4 δδ + B5 (δδ + δδ), the "
            "volume average over its platelets' directions with B1 to B5 from the lamina's constants (Advani and "
            "Tucker, J. Rheol. 31 (1987) 751). It is a "
            "Voigt average, an upper bound, in Pa, order XX, YY, ZZ, XY, YZ, XZ, for engineering shear strains."
        )


def _few(rows: Sequence[Any], most: int = 12) -> list[Any]:
    if len(rows) <= most:
        return list(rows)
    return [rows[int(i)] for i in np.unique(np.linspace(0, len(rows) - 1, most).round())]
