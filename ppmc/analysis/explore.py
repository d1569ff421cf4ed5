"""Short cuts for notebooks: the paths of a file's scene, and path plots in one call.

>>> import ppmc
>>> from ppmc.analysis.explore import path_figure, scene_paths
>>> flow = ppmc.read("runs/bracket/flow.vtkhdf")
>>> path_figure(scene_paths(flow.path)["hole_minus"], flow[0], flow[-1])
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ppmc.analysis.averages.averages import RegionAverages, in_frames, region_averages
from ppmc.analysis.averages.build import build_path, local_path
from ppmc.analysis.averages.paths import InspectionPath
from ppmc.analysis.averages.regions import Region
from ppmc.analysis.averages.sources import flow_source
from ppmc.errors import InputFileError, SceneError
from ppmc.files import open_series
from ppmc.particles import Particles
from ppmc.scene import Scene
from ppmc.scene.sections.analysis import AnalysisSection

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from ppmc.orientation.tensor_ode import TensorModel


def scene_paths(path: str | Path, frame: int = -1) -> dict[str, InspectionPath]:
    """Return the inspection paths, by name, of the scene that a flow file carries.

    Parameters
    ----------
    path : str or Path
        Flow file.
    frame : int
        Open ends reach as far as the material of this frame; local paths (``<name>_local``) take the tools as they
        stand then.

    Raises
    ------
    InputFileError
        If the file is no flow, or was made without a scene.
    """
    with open_series(Path(path), "flow") as file:
        source, stored = flow_source(file, frame), file.provenance.scene
    if not stored:
        raise InputFileError(f"{path}: carries no scene to take paths from; lay them by ppmc.analysis.averages.paths")
    # Of what the charge flows and rubs does not matter here, and laws of one's own cannot be read from a file.
    tools = {
        name: {k: v for k, v in tool.items() if k != "wall"} for name, tool in (stored.get("tooling") or {}).items()
    }
    scene = Scene.model_validate({**stored, "material": None, "tooling": tools or None})
    section = scene.analysis or AnalysisSection()
    out = {}
    for name, spec in section.every_path.items():
        out[name] = build_path(name, spec, [source])
        if spec.kind == "swept" and spec.local:
            averages = source.averages(out[name].regions)
            local = local_path(scene, out[name], spec, averages, source.time or 0.0)
            out[local.name] = local
    return out


def path_averages(path: InspectionPath, samples: Particles) -> RegionAverages:
    """Average over a path's regions, in the path's own components."""
    return in_frames(region_averages(samples, path.regions), path.frames)


def path_figure(path: InspectionPath, *samples: Particles) -> Figure:
    """Draw A and N along a path for one or more sources; band: the standard error where platelets are numbered."""
    from ppmc.analysis.figures.plots import PathSeries, plot_path

    series = []
    for s in samples:
        a = path_averages(path, s)
        known = bool(np.isfinite(a.effective_platelets).any())
        bands = (a.fibre_error, a.normal_error) if known else (None, None)
        series.append(PathSeries(s.title, a.fibre_tensor, a.normal_tensor, *bands))
    return plot_path(path, series)


def view_figure(samples: Particles, name: str, cut: tuple[ArrayLike, ArrayLike] | None = None) -> Figure:
    """Draw a view of the report: squares of a direction, the part split by direction, platelets, maps.

    Parameters
    ----------
    samples : Particles
    name : str
        ``fibre_direction``, ``platelet_normal``, ``dominant_direction``, ``iso_surface``, ``platelets`` or ``maps``;
        or any field of the samples: a scalar, or the length of a vector.
    cut : (point, normal), optional
        Plane that opens the part; what lies on the normal's side is left out.

    Raises
    ------
    SceneError
        If there is no such view, or the samples do not carry what it shows.
    """
    from ppmc.analysis.figures.panels import field_panel
    from ppmc.analysis.figures.pictures import MAKERS, SPLIT, open_to
    from ppmc.analysis.figures.views import EYE, CloudView, draw_clouds

    if name not in MAKERS and name not in samples.arrays():
        fields = ", ".join(samples.arrays())
        raise SceneError(f"no view '{name}'; there are {', '.join(MAKERS)}, and the fields {fields}")
    direction = EYE
    if cut is not None:
        point, normal = (np.asarray(v, dtype=float) for v in cut)
        samples = samples.select((samples.positions - point) @ normal <= 0)
        direction = open_to(normal)
    make = MAKERS.get(name, lambda s, _: [field_panel(s, name)])
    panels = make(samples, samples.spacing) if len(samples) else []
    if not panels:
        raise SceneError(f"{samples.title}: carries nothing that the view '{name}' could show")
    ghost = samples.positions if name in SPLIT else None
    view = CloudView(samples.positions, samples.spacing, panels, direction=direction, ghost=ghost)
    return draw_clouds([view])[0][0]


def disk_figure(
    radius: float = 20.0, inlet_radius: float = 1.0, heights: ArrayLike | None = None, model: TensorModel | None = None
) -> Figure:
    """Draw A and N through the thickness of the centre-gated disk (J Figs 15 and 16).

    Parameters
    ----------
    radius, inlet_radius : float
        In half-thicknesses.
    heights : array_like, optional
        In half-thicknesses, inside (−1, 1); 199 of them if left out.
    model : TensorModel, optional
        Integrates A1 and A2 with this closure and these options; the exact solution if left out.
    """
    from ppmc.analysis.figures.plots import plot_profile
    from ppmc.analysis.flow.disk import disk_tensor_mode, disk_tensors

    z = np.linspace(-0.99, 0.99, 199) if heights is None else np.asarray(heights, dtype=float)
    if model is None:
        A, N = disk_tensors(radius, z, inlet_radius)
    else:
        A, N = disk_tensor_mode(radius, z, inlet_radius, model)
    return plot_profile(z, A, N, "height z / half-thickness [–]")


def region_frame(samples: Particles, regions: list[Region] | tuple[Region, ...]) -> pd.DataFrame:
    """Return counts, A, N and their spread over regions as a pandas frame."""
    from ppmc.analysis.report.tables import region_table

    return region_table(samples.label, samples.time, region_averages(samples, regions))


def fourth_frame(samples: Particles, regions: list[Region] | tuple[Region, ...]) -> pd.DataFrame:
    """Return the 15 independent components of 𝔸 and ℕ over regions as a pandas frame, columns A1111 to N3333."""
    from ppmc.analysis.report.tables import fourth_table

    return fourth_table(samples.label, samples.time, region_averages(samples, regions))


def relabelled(samples: Particles, label: str) -> Particles:
    """Return the same samples under another name."""
    return replace(samples, label=label)
