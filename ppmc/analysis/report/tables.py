"""Tables of results as pandas frames; one name a column, with the unit in the name where there is one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ppmc.analysis.averages.averages import FOURTH, RegionAverages, fourth_components
from ppmc.analysis.averages.paths import InspectionPath
from ppmc.analysis.flow.comparisons import Comparison
from ppmc.analysis.flow.ensemble import Ensemble
from ppmc.analysis.flow.kinematics import Kinematics
from ppmc.analysis.flow.knit import KnitLine
from ppmc.analysis.flow.results import Analysed
from ppmc.analysis.flow.truth import TruthRow
from ppmc.analysis.mesh.stiffness import engineering_moduli
from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.orientation import to_six

if TYPE_CHECKING:
    import pandas as pd

SIX_INDICES = ("11", "22", "33", "12", "23", "13")
MODULI = ("E1", "E2", "E3", "G12", "G23", "G13")
FOURTH_INDICES = tuple("".join(str(i + 1) for i in c) for c in FOURTH)


def region_table(label: str, time: float | None, averages: RegionAverages) -> pd.DataFrame:
    """Return one row a region: counts, volumes, A, N, and their standard deviations over the region (``sd_``).

    Empty regions keep their row with count 0 and empty tensors.
    """
    import pandas as pd

    columns: dict[str, Any] = {
        "source": label,
        "time_s": np.nan if time is None else time,
        "region": [region.name for region in averages.regions],
        "particle_count": averages.particle_count,
        "effective_count": averages.effective_count,
        "effective_platelets": averages.effective_platelets,
        "material_volume_mm3": averages.material_volume,
        "region_volume_mm3": averages.region_volume,
        "known_share": averages.known_share,
    }
    for axis in range(3):
        columns[f"centroid_x{axis + 1}_mm"] = averages.centroid[:, axis]
    for symbol, tensor, spread in (
        ("A", averages.fibre_tensor, averages.fibre_spread),
        ("N", averages.normal_tensor, averages.normal_spread),
    ):
        for k, index in enumerate(SIX_INDICES):
            columns[f"{symbol}{index}"] = to_six(tensor)[:, k]
        for k, index in enumerate(SIX_INDICES):
            columns[f"sd_{symbol}{index}"] = to_six(spread)[:, k]
    return pd.DataFrame(columns)


def fourth_table(label: str, time: float | None, averages: RegionAverages) -> pd.DataFrame:
    """Return one row a region: the 15 independent components of 𝔸 and ℕ, columns A1111, A1112, ... N3333."""
    import pandas as pd

    columns: dict[str, Any] = {
        "source": label,
        "time_s": np.nan if time is None else time,
        "region": [region.name for region in averages.regions],
        "particle_count": averages.particle_count,
    }
    for symbol, tensor in (("A", averages.fibre_tensor4), ("N", averages.normal_tensor4)):
        for k, index in enumerate(FOURTH_INDICES):
            columns[f"{symbol}{index}"] = fourth_components(tensor)[:, k]
    return pd.DataFrame(columns)


def path_table(path: InspectionPath, label: str, time: float | None, averages: RegionAverages) -> pd.DataFrame:
    """Return the region table of a path's regions, in the path's own components, with the coordinate along it.

    Columns A11 ... keep their digits: 1, 2, 3 stand for the components named in the column ``components``.
    """
    table = region_table(label, time, averages)
    table.insert(0, "path", path.name)
    table.insert(1, "coordinate", path.coordinate)
    table.insert(2, "coordinate_label", path.coordinate_label)
    table.insert(3, "components", " ".join(path.components))
    return table


def kinematics_table(rows: Sequence[Kinematics]) -> pd.DataFrame:
    """Return one row a frame: J and mean F with their spread."""
    import pandas as pd

    def line(k: Kinematics) -> dict[str, float]:
        entry: dict[str, float] = {
            "time_s": k.time,
            "particle_count": k.particle_count,
            "J_mean": k.volume_ratio_mean,
            "J_sd": k.volume_ratio_spread,
            "J_min": k.volume_ratio_min,
            "J_p01": k.volume_ratio_low,
            "J_p99": k.volume_ratio_high,
            "J_max": k.volume_ratio_max,
        }
        for i in range(3):
            for j in range(3):
                entry[f"F{i + 1}{j + 1}_mean"] = float(k.mean_deformation_gradient[i, j])
                entry[f"F{i + 1}{j + 1}_sd"] = float(k.deformation_gradient_spread[i, j])
        for i in range(3):
            entry[f"extent_x{i + 1}_mm"] = float(k.extent[i])
        return entry

    return pd.DataFrame([line(k) for k in rows])


def truth_table(rows: Sequence[TruthRow]) -> pd.DataFrame:
    """Return one row a source: A, N in the interior and their difference from the truth (``d_``)."""
    import pandas as pd

    def line(row: TruthRow) -> dict[str, Any]:
        entry: dict[str, Any] = {
            "source": row.label,
            "note": row.note,
            "particle_count": int(row.averages.particle_count[0]),
            "largest_difference": row.largest_difference,
        }
        for symbol, tensor, difference in (
            ("A", row.averages.fibre_tensor[0], row.fibre_difference),
            ("N", row.averages.normal_tensor[0], row.normal_difference),
        ):
            entry |= {f"{symbol}{index}": float(v) for index, v in zip(SIX_INDICES, to_six(tensor), strict=True)}
            entry |= {f"d_{symbol}{index}": float(v) for index, v in zip(SIX_INDICES, to_six(difference), strict=True)}
        return entry

    return pd.DataFrame([line(row) for row in rows])


def to_json_ready(value: Any) -> Any:
    """Return plain lists, dicts and numbers for JSON; NaN and infinity become null (JSON has neither)."""
    if isinstance(value, dict):
        return {str(k): to_json_ready(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [to_json_ready(v) for v in value]
    if isinstance(value, np.ndarray):
        return to_json_ready(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def ensemble_table(names: Sequence[str], ensemble: Ensemble) -> pd.DataFrame:
    """Return one row a region: mean of A and N over the runs and their standard deviation between runs (``sd_``)."""
    import pandas as pd

    columns: dict[str, Any] = {"region": list(names), "runs": ensemble.runs, "runs_with_material": ensemble.filled}
    for symbol, mean, spread in (
        ("A", ensemble.fibre_mean, ensemble.fibre_spread),
        ("N", ensemble.normal_mean, ensemble.normal_spread),
    ):
        for k, index in enumerate(SIX_INDICES):
            columns[f"{symbol}{index}"] = to_six(mean)[:, k]
        for k, index in enumerate(SIX_INDICES):
            columns[f"sd_{symbol}{index}"] = to_six(spread)[:, k]
    return pd.DataFrame(columns)


def comparison_table(comparisons: Sequence[Comparison]) -> pd.DataFrame:
    """Return one row a run, part or mask: overlaps of the filled space, distances and angles particle by particle."""
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "run": c.label,
                "time_s": c.time,
                "overlap": c.difference.overlap,
                **{f"overlap_along_x{k + 1}": share for k, share in enumerate(c.seen)},
                "same_particles": c.same_particles,
                "distance_mean_mm": c.difference.distance_mean,
                "distance_p99_mm": c.difference.distance_p99,
                "angle_mean_deg": c.difference.angle_mean,
                "angle_p99_deg": c.difference.angle_p99,
            }
            for c in comparisons
        ]
    )


def knit_table(positions: np.ndarray, knit: KnitLine) -> pd.DataFrame:
    """Return one row a particle at a knit line: place, direction across, fibres and normals across."""
    import pandas as pd

    columns: dict[str, Any] = {"particle": knit.index}
    for axis in range(3):
        columns[f"x{axis + 1}_mm"] = positions[knit.index, axis]
    for axis in range(3):
        columns[f"across_{axis + 1}"] = knit.across[:, axis]
    columns |= {"foreign_share": knit.share[knit.index], "A_across": knit.crossing, "N_across": knit.normal_across}
    return pd.DataFrame(columns)


def difference_table(reference: Analysed, others: Sequence[Analysed]) -> pd.DataFrame:
    """Return one row a run and region: A and N of the other run minus those of the reference (``d_``)."""
    import pandas as pd

    frames = []
    for other in others:
        columns: dict[str, Any] = {
            "source": other.source.label,
            "region": [region.name for region in other.regions.regions],
            "particle_count": other.regions.particle_count,
        }
        for symbol, name in (("A", "fibre_tensor"), ("N", "normal_tensor")):
            difference = to_six(getattr(other.regions, name) - getattr(reference.regions, name))
            columns |= {f"d_{symbol}{index}": difference[:, k] for k, index in enumerate(SIX_INDICES)}
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames)


def element_table(mapped: MappedMesh) -> pd.DataFrame:
    """Return one row an element of a mesh: place, count, axes p, q, r, A and N of both orders, spread, moduli.

    Second-order tensors by `SIX_INDICES`, fourth-order ones by `FOURTH_INDICES`.
    """
    import pandas as pd

    e = mapped.elements
    columns: dict[str, Any] = {"element": mapped.mesh.numbers}
    columns |= {f"centre_x{k + 1}_mm": mapped.mesh.centres[:, k] for k in range(3)}
    columns |= {"particle_count": e.particle_count, "material_volume_mm3": e.material_volume, "distance_mm": e.distance}
    for symbol, axis in (("p", e.fibre_direction), ("q", e.in_plane_direction), ("r", e.platelet_normal)):
        columns |= {f"{symbol}{k + 1}": axis[:, k] for k in range(3)}
    for prefix, tensor in (
        ("A", e.fibre_tensor), ("N", e.normal_tensor), ("sd_A", e.fibre_spread), ("sd_N", e.normal_spread)
    ):  # fmt: skip
        columns |= {f"{prefix}{index}": v for index, v in zip(SIX_INDICES, to_six(tensor).T, strict=True)}
    for symbol, tensor in (("A", e.fibre_tensor4), ("N", e.normal_tensor4)):
        components = fourth_components(tensor).T
        columns |= {f"{symbol}{index}": v for index, v in zip(FOURTH_INDICES, components, strict=True)}
    if mapped.stiffness is not None:
        moduli = engineering_moduli(mapped.stiffness).T
        columns |= {f"{name}_Pa": v for name, v in zip(MODULI, moduli, strict=True)}
    return pd.DataFrame(columns)
