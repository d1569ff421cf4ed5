"""The last state to turn and zoom in a browser: one HTML file with data and a small WebGL program, no network."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files

import numpy as np

from ppmc.analysis.figures.views import Panel

STEPS = 64


def scene_page(title: str, positions: np.ndarray, spacing: float, panels: Sequence[Panel]) -> str:
    """Return the page.

    Parameters
    ----------
    title : str
    positions : ndarray, shape (n, 3)
        mm.
    spacing : float
        Distance of neighbours, mm.
    panels : sequence of Panel
        What can be chosen as colour.
    """
    from matplotlib import colormaps

    data = {
        "n": len(positions),
        "spacing": float(spacing),
        "positions": _packed(np.asarray(positions, dtype="<f4")),
        "panels": [
            {
                "title": panel.title.replace("$", ""),
                "label": panel.label.replace("$", ""),
                "limits": [float(v) for v in panel.limits],
                "values": _packed(np.asarray(panel.values, dtype="<f4")),
                "colours": [
                    [round(float(c), 4) for c in row[:3]] for row in colormaps[panel.colours](np.linspace(0, 1, STEPS))
                ],
            }
            for panel in panels
        ],
    }
    page = files("ppmc.analysis.figures").joinpath("scene_viewer.html").read_text(encoding="utf-8")
    return page.replace("__TITLE__", escape(title)).replace("__DATA__", json.dumps(data))


def _packed(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
