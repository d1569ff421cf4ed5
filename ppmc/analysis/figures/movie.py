"""The filling as a moving picture: one component of the fibre direction by colour, a frame a time step."""

from __future__ import annotations

import io

import numpy as np

from ppmc.analysis.averages.sources import flow_source
from ppmc.analysis.figures.figure import Picture
from ppmc.analysis.figures.plots import figure
from ppmc.analysis.figures.rendering import PointsView, render
from ppmc.analysis.figures.views import BALL, COLOURS, Panel, cloud_bounds, colour_bars, outer_points
from ppmc.files import SeriesFile

FRAMES = 24
MILLISECONDS = 160
SIZE = (640, 480)
DPI = 100
COLOURS_IN_GIF = 128


def filling_movie(flow: SeriesFile, component: int = 0) -> Picture | None:
    """Return an animated GIF of p_i² from start to end, each frame with its time; None where VTK cannot draw.

    Parameters
    ----------
    flow : SeriesFile
    component : int
        0, 1 or 2.
    """
    from PIL import Image

    chosen = np.unique(np.linspace(0, len(flow.times) - 1, FRAMES).round().astype(int))
    ends = [flow.frame(int(k), ())["position"] for k in (chosen[0], chosen[-1])]
    spacing = flow_source(flow, int(chosen[0])).spacing
    bounds = cloud_bounds(np.vstack(ends), spacing)
    jobs = []
    for k in chosen:
        values = flow.frame(int(k), ("fibre_direction",))
        seen = outer_points(values["position"], spacing)
        share = values["fibre_direction"][seen, component] ** 2
        jobs.append(PointsView(values["position"][seen], share, BALL * spacing, (0, 1), COLOURS, bounds, size=SIZE))
    drawn = [png for png in render(jobs).images if png is not None]
    if len(drawn) < len(jobs):
        return None
    images = [
        Image.open(io.BytesIO(_framed(png, component, float(flow.times[k])))).convert("RGB").quantize(COLOURS_IN_GIF)
        for png, k in zip(drawn, chosen, strict=True)
    ]
    stream = io.BytesIO()
    images[0].save(stream, "GIF", save_all=True, append_images=images[1:], duration=MILLISECONDS, loop=0)
    caption = (
        f"Filling: p_{component + 1}² [–] of all {flow.n:,} particles, {len(chosen)} of {len(flow.times)} frames, "
        f"t = {flow.times[0]:.4g} s to {flow.times[-1]:.4g} s. Axes x1, x2, x3 in mm."
    )
    return Picture("filling", "Views", caption, stream.getvalue(), "gif")


def _framed(png: bytes, component: int, time: float) -> bytes:
    """Return the picture under its time and beside its colour bar."""
    from matplotlib import image

    drawing = figure((SIZE[0] + 110) / DPI, (SIZE[1] + 60) / DPI)
    ax = drawing.subplots()
    ax.imshow(image.imread(io.BytesIO(png), format="png"))
    ax.set_axis_off()
    ax.set_title(f"t = {time:.4f} s", fontsize=11)
    colour_bars(drawing, [ax], [Panel("", np.empty(0), f"$p_{component + 1}^2$ [–]")])
    stream = io.BytesIO()
    drawing.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    return stream.getvalue()
