"""Three-dimensional pictures that can never take the report down: VTK runs in a process of its own.

A VTK wheel without a working OpenGL ends in a segmentation fault, not in an exception. So pictures are drawn by
``python -m ppmc.analysis.figures.render_worker``; when that process dies the reason comes back as text and the caller
draws with matplotlib.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

SECONDS_A_PICTURE = 60.0
SECONDS_TO_START = 60.0
EGL = "vtkEGLRenderWindow"


@dataclass(frozen=True)
class PointsView:
    """Points drawn as balls, or as the corners of a surface, coloured by a value.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        mm.
    values : ndarray, shape (n,)
        What the colour shows.
    radius : float
        Of the balls, mm.
    limits : (float, float)
        Values at the ends of the colour map.
    colours : str
        Name of a matplotlib colour map.
    bounds : tuple of 6 float, optional
        Frame (xmin, xmax, ymin, ymax, zmin, zmax) so that several pictures share one scale.
    direction : (float, float, float)
        From the object to the eye.
    size : (int, int)
        Pixels.
    triangles : ndarray, shape (m, 3), optional
        With them the points are the corners of a surface.
    ghost : ndarray, shape (k, 3), optional
        Points that hint at the rest of the part, mm.
    """

    points: np.ndarray
    values: np.ndarray
    radius: float
    limits: tuple[float, float] = (0.0, 1.0)
    colours: str = "viridis"
    bounds: tuple[float, ...] | None = None
    direction: tuple[float, float, float] = (0.9, -1.5, 1.0)
    size: tuple[int, int] = (960, 760)
    triangles: np.ndarray | None = None
    ghost: np.ndarray | None = None


@dataclass(frozen=True)
class Rendered:
    """PNG bytes of each view, ``None`` where it failed, and why.

    Attributes
    ----------
    images : list of bytes or None
        In the order of the views.
    reason : str or None
        What went wrong, for the report; ``None`` if nothing did.
    """

    images: list[bytes | None]
    reason: str | None = None


@dataclass(frozen=True)
class RenderingStatus:
    """Whether three-dimensional pictures can be drawn here.

    Attributes
    ----------
    available : bool
    reason : str
        Why not, or which window VTK used.
    """

    available: bool
    reason: str = ""
    environment: dict[str, str] = field(default_factory=dict)


def render(views: Sequence[PointsView], environment: Mapping[str, str] | None = None) -> Rendered:
    """Draw views off screen.

    Parameters
    ----------
    views : sequence of PointsView
        What to draw.
    environment : mapping, optional
        Extra environment variables for the drawing process.
    """
    if not views:
        return Rendered([])
    with tempfile.TemporaryDirectory(prefix="ppmc-views-") as folder:
        jobs = [_store(view, Path(folder), k) for k, view in enumerate(views)]
        (Path(folder) / "jobs.json").write_text(json.dumps(jobs))
        reason = _run(Path(folder), len(views), dict(environment or {}))
        if reason is not None and os.environ.get("DISPLAY") and not environment:
            # A display that cannot draw (a dead forward, no GLX) is worth one more try without it.
            reason = _run(Path(folder), len(views), {"DISPLAY": "", "VTK_DEFAULT_OPENGL_WINDOW": EGL})
        images = [_read(Path(folder) / f"{k}.png") for k in range(len(views))]
    if reason is None and any(image is None for image in images):
        reason = "the drawing process left pictures out"
    return Rendered(images, reason)


def probe(environment: Mapping[str, str] | None = None) -> RenderingStatus:
    """Draw 64 x 64 pixels in a process of its own and report whether that worked."""
    point = PointsView(np.zeros((1, 3)), np.zeros(1), 1.0, size=(64, 64))
    rendered = render([point], environment)
    return RenderingStatus(rendered.images[0] is not None, rendered.reason or "", dict(environment or {}))


def drawing_environment() -> dict[str, str]:
    """Return the environment for VTK: its EGL window where there is no display (the X11 one crashes without libX11)."""
    environment = dict(os.environ)
    if not environment.get("DISPLAY"):
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", EGL)
    return environment


def _store(view: PointsView, folder: Path, k: int) -> dict[str, Any]:
    arrays = {"points": view.points.astype(np.float32), "values": view.values.astype(np.float32)}
    if view.triangles is not None:
        arrays["triangles"] = view.triangles.astype(np.int64)
    if view.ghost is not None and len(view.ghost):
        arrays["ghost"] = view.ghost.astype(np.float32)
    np.savez(folder / f"{k}.npz", **arrays)  # type: ignore[arg-type]
    return {
        "number": k,
        "radius": float(view.radius),
        "limits": [float(v) for v in view.limits],
        "colours": view.colours,
        "bounds": None if view.bounds is None else [float(b) for b in view.bounds],
        "direction": list(view.direction),
        "size": list(view.size),
    }


def _run(folder: Path, count: int, extra: dict[str, str]) -> str | None:
    environment = {**drawing_environment(), **extra}
    command = [sys.executable, "-m", "ppmc.analysis.figures.render_worker", str(folder)]
    try:
        done = subprocess.run(
            command,
            env=environment,
            capture_output=True,
            text=True,
            timeout=SECONDS_TO_START + count * SECONDS_A_PICTURE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "drawing took too long"
    except OSError as error:
        return f"the drawing process could not start: {error}"
    if done.returncode == 0:
        return None
    if done.returncode < 0 or done.returncode > 128:
        number = abs(done.returncode) & 127
        return f"VTK crashed (signal {number}); install EGL or OSMesa, e.g. apt install libegl1 libgl1-mesa-dri"
    last = [line for line in done.stderr.strip().splitlines() if line.strip()]
    return f"VTK could not draw: {last[-1] if last else f'exit code {done.returncode}'}"


def _read(path: Path) -> bytes | None:
    if not path.exists():
        return None
    data = path.read_bytes()
    return data if data.startswith(b"\x89PNG") and data.rstrip().endswith(b"IEND\xaeB`\x82") else None
