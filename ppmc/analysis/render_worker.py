"""The process that draws with VTK: reads jobs from a folder, writes one PNG a job; run by `ppmc.analysis.rendering`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np


def draw(job: dict[str, Any], folder: Path) -> None:
    """Draw one job to ``<number>.png``."""
    import pyvista as pv

    data = np.load(folder / f"{job['number']}.npz")
    width, height = job["size"]
    plotter: Any = pv.Plotter(off_screen=True, window_size=[width, height])
    plotter.set_background("white")
    cloud = pv.PolyData(data["points"])
    cloud["value"] = data["values"]
    if cloud.n_points:
        plotter.add_mesh(
            cloud,
            scalars="value",
            style="points_gaussian",
            render_points_as_spheres=True,
            emissive=False,
            cmap=job["colours"],
            clim=job["limits"],
            point_size=5,
            show_scalar_bar=False,
        )
        # The mapper takes the ball's radius in mm; pyvista's point_size counts pixels.
        plotter.mapper.scale_factor = job["radius"]
    bounds = job["bounds"] or list(cloud.bounds)
    if width > 100:
        plotter.show_bounds(
            bounds=bounds, xtitle="x1 [mm]", ytitle="x2 [mm]", ztitle="x3 [mm]", color="black", font_size=16,
            n_xlabels=4, n_ylabels=3, n_zlabels=2, location="outer", ticks="outside", use_3d_text=False,
        )  # fmt: skip
    centre = np.array([0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3]), 0.5 * (bounds[4] + bounds[5])])
    plotter.enable_parallel_projection()
    plotter.camera_position = [tuple(centre + 100.0 * np.array(job["direction"])), tuple(centre), (0.0, 0.0, 1.0)]
    plotter.reset_camera(bounds=bounds)
    plotter.camera.zoom(0.95)
    plotter.screenshot(str(folder / f"{job['number']}.png"))
    plotter.close()


def main(folder: Path) -> None:
    """Draw every job of the folder; a job that fails leaves the rest untouched and the exit code nonzero."""
    failures = []
    import pyvista as pv

    # Software OpenGL spends half its time on multisampling, which balls with soft edges do not need.
    pv.global_theme.multi_samples = 1
    for job in json.loads((folder / "jobs.json").read_text()):
        try:
            draw(job, folder)
        except Exception as error:
            failures.append(f"{type(error).__name__}: {error}")
    if failures:
        sys.exit(failures[0])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
