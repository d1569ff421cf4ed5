"""The results as plain nested data, for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ppmc.analysis.averages.averages import RegionAverages, fourth_components
from ppmc.analysis.flow.results import Results
from ppmc.analysis.report.tables import FOURTH_INDICES


def flat_summary(results: Results) -> Mapping[str, Any]:
    """Return the results as plain nested data, for JSON.

    Second-order tensors are 3 x 3 lists; fourth-order ones are lists of their 15 independent components, in the order
    that ``fourth_order_indices`` gives. Paths are in their own components.
    """
    return {
        "verdict": None if results.verdict is None else results.verdict.as_facts(),
        "fourth_order_indices": list(FOURTH_INDICES),
        "regions": [
            {
                "name": region.name,
                "description": region.describe(),
                "sources": [
                    {
                        "source": e.source.label,
                        "time_s": e.source.time,
                        **_averages(e.regions, k),
                    }
                    for e in results.analysed
                ],
            }
            for k, region in enumerate(results.regions)
        ],
        "paths": [
            {
                "name": path.name,
                "description": path.description,
                "components": list(path.components),
                "coordinate_label": path.coordinate_label,
                "coordinate": path.coordinate,
                "sources": [
                    {
                        "source": e.source.label,
                        "time_s": e.source.time,
                        **_averages(results.path_averages(e, k), slice(None)),
                    }
                    for e in results.shown
                ],
            }
            for k, path in enumerate(results.paths)
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
            {
                "run": c.label,
                "time_s": c.time,
                "overlap": c.difference.overlap,
                "overlap_along_x1_x2_x3": c.seen,
                "distance_mean_mm": c.difference.distance_mean,
                "angle_mean_deg": c.difference.angle_mean,
            }
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


def _averages(a: RegionAverages, k: int | slice) -> dict[str, Any]:
    """Return the averages of one region, or of the regions of a slice."""
    return {
        "particle_count": a.particle_count[k],
        "effective_platelets": a.effective_platelets[k],
        "material_volume_mm3": a.material_volume[k],
        "A": a.fibre_tensor[k],
        "N": a.normal_tensor[k],
        "A_spread": a.fibre_spread[k],
        "N_spread": a.normal_spread[k],
        "A_fourth": fourth_components(a.fibre_tensor4)[k],
        "N_fourth": fourth_components(a.normal_tensor4)[k],
    }
