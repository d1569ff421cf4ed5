"""The filling as a moving picture: fibres along x1 by colour, a frame a time step."""

from __future__ import annotations

import io

import numpy as np

from ppmc.analysis.rendering import PointsView, render
from ppmc.analysis.sources import flow_source
from ppmc.analysis.views import BALL, COLOURS, cloud_bounds, outer_points
from ppmc.files import SeriesFile

FRAMES = 24
MILLISECONDS = 160
SIZE = (640, 480)


def filling_movie(flow: SeriesFile, component: int = 0) -> bytes | None:
    """Return an animated GIF of p_i² from start to end; None where VTK cannot draw.

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
    images = [Image.open(io.BytesIO(png)).convert("P") for png in render(jobs).images if png is not None]
    if len(images) < len(jobs):
        return None
    stream = io.BytesIO()
    images[0].save(stream, "GIF", save_all=True, append_images=images[1:], duration=MILLISECONDS, loop=0)
    return stream.getvalue()
