"""The process that draws a charge in its tool with VTK: one job in, one PNG out; run by `pictures`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np


def draw(job: Path, picture: Path) -> None:
    """Draw platelets by colour beside p1 squared, the tools cut open in front."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import pyvista as pv

    data = np.load(job)
    spacing = data["spacing"]
    cloud = pv.PolyData(data["points"])
    cloud["colours"] = (255 * data["colours"]).astype(np.uint8)
    cloud["square"] = data["squares"][:, int(data["right"])]
    cubes = cloud.glyph(
        geom=pv.Cube(x_length=spacing[0], y_length=spacing[1], z_length=spacing[2]), scale=False, orient=False
    )
    plotter: Any = pv.Plotter(off_screen=True, window_size=[1000, 1300], shape=(2, 1))
    depth, toward, right = int(data["depth"]), float(data["toward"]), int(data["right"])
    side = 3 - depth - right
    eye, up = np.zeros(3), np.zeros(3)
    eye[depth], eye[right], eye[side] = 1.1 * toward, -0.5, -1.3
    up[depth] = toward
    centre = 0.5 * (data["points"].min(axis=0) + data["points"].max(axis=0))
    tools = _tools(data, pv, centre, side) if "grid" in data else None
    for row, name in enumerate(("colours", "square")):
        plotter.subplot(row, 0)
        plotter.set_background("white")
        if name == "colours":
            plotter.add_mesh(cubes, scalars="colours", rgb=True)
            plotter.add_text(str(data["meaning"]), position="upper_left", font_size=10, color="black")
        else:
            bar = {"title": f"p{right + 1}^2", "color": "black", "height": 0.06, "position_y": 0.02}
            plotter.add_mesh(cubes, scalars="square", cmap="viridis", clim=[0, 1], scalar_bar_args=bar)
        if tools is not None and tools.n_points:
            plotter.add_mesh(tools, color="lightsteelblue", opacity=0.35)
        plotter.camera_position = [tuple(centre + 300.0 * eye), tuple(centre), tuple(up)]
        plotter.reset_camera(bounds=_seen(cubes, tools))
        plotter.camera.zoom(1.3)
    plotter.screenshot(str(picture))
    plotter.close()


def _seen(cubes: Any, tools: Any) -> list[float]:
    """Return the bounds of charge and tools."""
    both = np.array([m.bounds for m in (cubes, tools) if m is not None and m.n_points]).reshape(-1, 3, 2)
    return [float(v) for v in np.stack([both[..., 0].min(axis=0), both[..., 1].max(axis=0)], axis=1).ravel()]


def _tools(data: Any, pv: Any, centre: np.ndarray, side: int) -> Any:
    """Return the tools' surfaces behind the middle plane."""
    grid = pv.ImageData(
        dimensions=data["grid_shape"], spacing=[float(data["grid_step"])] * 3, origin=data["grid_origin"]
    )
    grid["distance"] = data["grid"]
    surface = grid.contour([0.0], scalars="distance")
    normal = np.zeros(3)
    normal[side] = -1.0
    return surface.clip(normal=normal, origin=centre) if surface.n_points else surface


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
