"""The process that draws with VTK: reads jobs from a folder, writes one PNG a job; run by `rendering`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

GHOST_OPACITY = 0.12
ROOM_FOR_LABELS = 0.78  # zoom; the white rim that is left is cut off
SHORT_AXIS = 0.15  # of the longest; ticks on a shorter one would print over each other


def draw(job: dict[str, Any], folder: Path) -> None:
    """Draw one job to ``<number>.png``."""
    import pyvista as pv

    data = np.load(folder / f"{job['number']}.npz")
    width, height = job["size"]
    plotter: Any = pv.Plotter(off_screen=True, window_size=[width, height])
    plotter.set_background("white")
    surface = "triangles" in data
    cloud = (
        pv.PolyData.from_regular_faces(data["points"], data["triangles"]) if surface else pv.PolyData(data["points"])
    )
    cloud["value"] = data["values"]
    if surface and cloud.n_points:
        plotter.add_mesh(
            cloud,
            scalars="value",
            smooth_shading=True,
            cmap=job["colours"],
            clim=job["limits"],
            show_scalar_bar=False,
        )
    elif cloud.n_points:
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
    if "ghost" in data:
        # Coarse dots, seen through: enough to tell where in the part one looks.
        ghost = pv.PolyData(data["ghost"])
        plotter.add_mesh(ghost, color="gray", style="points", point_size=2, opacity=GHOST_OPACITY, lighting=False)
    bounds = job["bounds"] or list(cloud.bounds)
    if width > 100:
        titles, labels = axis_titles(bounds)
        plotter.show_bounds(
            bounds=bounds, xtitle=titles[0], ytitle=titles[1], ztitle=titles[2], color="black", font_size=16,
            n_xlabels=4, n_ylabels=3, n_zlabels=2, show_xlabels=labels[0], show_ylabels=labels[1],
            show_zlabels=labels[2], location="outer", ticks="outside", use_3d_text=False,
        )  # fmt: skip
    centre = np.array([0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3]), 0.5 * (bounds[4] + bounds[5])])
    plotter.enable_parallel_projection()
    plotter.camera_position = [tuple(centre + 100.0 * np.array(job["direction"])), tuple(centre), (0.0, 0.0, 1.0)]
    plotter.reset_camera(bounds=bounds)
    plotter.camera.zoom(ROOM_FOR_LABELS)
    plotter.screenshot(str(folder / f"{job['number']}.png"))
    plotter.close()


def axis_titles(bounds: list[float]) -> tuple[list[str], list[bool]]:
    """Return the title of each axis and whether its ticks have numbers: a short axis has its ends in the title."""
    sizes = [bounds[2 * k + 1] - bounds[2 * k] for k in range(3)]
    labels = [size >= SHORT_AXIS * max(sizes) for size in sizes]
    titles = [
        f"x{k + 1} [mm]" if labels[k] else f"x{k + 1} {bounds[2 * k]:.3g} to {bounds[2 * k + 1]:.3g} [mm]"
        for k in range(3)
    ]
    return titles, labels


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
