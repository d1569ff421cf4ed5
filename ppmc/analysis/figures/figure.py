"""A figure of the report: picture, heading and caption."""

from __future__ import annotations

import io
from dataclasses import dataclass

from matplotlib.figure import Figure

from ppmc.analysis.flow.results import Analysed

DPI = 110


@dataclass(frozen=True)
class Picture:
    """One figure of the report.

    Attributes
    ----------
    name : str
        File name without ending.
    section : str
        Heading it stands under.
    caption : str
    image : bytes
    kind : str
        ``"png"`` or ``"gif"``, the file's ending too.
    """

    name: str
    section: str
    caption: str
    image: bytes
    kind: str = "png"


def to_png(drawing: Figure) -> bytes:
    """Return a figure as PNG, without dates, so that equal results give equal bytes."""
    stream = io.BytesIO()
    drawing.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    return stream.getvalue()


def is_voxels(entry: Analysed) -> bool:
    """Tell whether a source counts voxels."""
    return entry.source.product in ("volume", "orientations", "moulded")
