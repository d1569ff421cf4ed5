"""Pictures of a charge: top view as in the papers' photographs, a cut with the tools, and a view in the tool."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import SceneError
from ppmc.files import ParticleFile
from ppmc.geometry.cavity.cavity import cavity_volume
from ppmc.geometry.tools.toolset import ToolSet

Array = NDArray[np.floating]
# Maps points, shape (n, 3), to the distance to the nearest tool, shape (n,).
Clearance = Callable[[Array], Array]
# Lowest and highest corner of a box, mm.
Box = tuple[Array, Array]

SECONDS_TO_DRAW = 180.0
# The cavity is looked for from so many particles, on cells of this share of the charge.
MOST_SEEDS, COARSE_STEPS = 2000, 80
NAMES = ("x1", "x2", "x3")
# Squares of a draped charge are drawn larger, for its particles no longer stand in rows.
DRAPED_GROWTH = 1.6


@dataclass(frozen=True)
class View:
    """How to look at a charge.

    Attributes
    ----------
    right, up : int
        Axes of the paper; the third axis points to the eye.
    toward : float
        1 if the eye is at high coordinates of the third axis.
    """

    right: int = 0
    up: int = 1
    toward: float = 1.0

    @property
    def depth(self) -> int:
        """Axis that points to the eye."""
        return 3 - self.right - self.up

    @classmethod
    def against(cls, down: tuple[float, float, float]) -> View:
        """Return the view from above, with the longer free axis to the right."""
        depth = int(np.argmax(np.abs(down)))
        right, up = (2, 0) if depth == 1 else (0, 3 - depth)
        return cls(right, up, -float(np.sign(down[depth])))


def colours_of_ids(ids: NDArray[np.int64]) -> Array:
    """Return an RGB colour for every particle, shape (n, 3): one a platelet, grey for none."""
    from matplotlib.colors import hsv_to_rgb

    # Steps of the golden ratio keep the hues of successive platelets apart.
    hue = (ids * 0.6180339887498949) % 1.0
    value = 0.55 + 0.4 * ((ids * 0.7548776662466927) % 1.0)
    rgb = hsv_to_rgb(np.stack([hue, np.full(len(ids), 0.55), value], axis=1))
    rgb[ids < 0] = 0.6
    return np.asarray(rgb)


def groups_of(charge: ParticleFile) -> tuple[str, NDArray[np.int64] | None]:
    """Return what particles belong to, for colours, and its name: platelets, else regions, else nothing."""
    for name, field in (("platelets", "platelet_id"), ("regions", "region_id")):
        ids = charge.fields.get(field)
        if ids is not None and np.any(ids >= 0):
            return name, np.asarray(ids, dtype=np.int64)
    return "", None


def coloured(charge: ParticleFile) -> tuple[str, Array]:
    """Return what the colours mean, and an RGB colour for every particle, shape (n, 3): by groups, else direction."""
    name, groups = groups_of(charge)
    if groups is not None:
        return name, colours_of_ids(groups)
    squares = np.asarray(charge.fields["fibre_direction"]) ** 2
    return "red p1^2, green p2^2, blue p3^2", 0.15 + 0.8 * squares


def draw_top_view(charge: ParticleFile, path: Path, view: View) -> None:
    """Draw the uppermost particles, by platelet and by p1 squared, p2 squared (the third along the sight left out)."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    seen = uppermost(charge, view)
    x, y = charge.positions[seen][:, [view.right, view.up]].T
    p = charge.fields["fibre_direction"][seen]
    name, groups = groups_of(charge)
    rows = 2 if groups is None else 3
    wide = float(np.clip(3.0 * np.ptp(x) / max(float(np.ptp(y)), 1e-9), 3.0, 8.0))
    figure = Figure(figsize=(wide + 2.0, 3.2 * rows), layout="constrained")
    axes: Any = figure.subplots(rows, 1)
    pictures = []
    if groups is not None:
        pictures.append((name, colours_of_ids(groups[seen])))
    scale = ScalarMappable(Normalize(0.0, 1.0), "viridis")
    for axis in (view.right, view.up):
        pictures.append((f"$p_{axis + 1}^2$", scale.to_rgba(p[:, axis] ** 2)))
    width, height = (DRAPED_GROWTH if "width_ratio" in charge.extra else 1.0) * np.asarray(
        charge.extra.get("spacing", [1.0, 1.0, 1.0])[:2]
    )
    for ax, (title, colours) in zip(axes, pictures, strict=True):
        _squares(ax, x, y, float(width), float(height), colours)
        ax.set(title=title, xlabel=f"{NAMES[view.right]} [mm]", ylabel=f"{NAMES[view.up]} [mm]", aspect="equal")
    figure.colorbar(scale, ax=list(axes), shrink=0.6, label="square of the fibre direction's component")
    figure.savefig(path, format="png", dpi=150)


def uppermost(charge: ParticleFile, view: View) -> NDArray[np.int64]:
    """Return the particles that no other hides, the highest last: by columns of a grid as coarse as the lattice."""
    spacing = charge.extra.get("spacing", [1.0, 1.0, 1.0])
    step = 1.05 * max(float(spacing[0]), float(spacing[1]))
    xy = charge.positions[:, [view.right, view.up]]
    column = np.floor((xy - xy.min(axis=0)) / step).astype(np.int64)
    key = column[:, 0] * (int(column[:, 1].max()) + 1) + column[:, 1]
    height = view.toward * charge.positions[:, view.depth]
    order = np.lexsort((height, key))
    last = np.append(np.diff(key[order]) > 0, True)
    top = np.full(int(key.max()) + 1, -np.inf)
    top[key[order][last]] = height[order][last]
    # All particles of the column near its top: a column may hold several of one layer.
    seen = np.flatnonzero(height > top[key] - 0.5 * float(spacing[2]))
    return seen[np.argsort(height[seen], kind="stable")]


def space_of(charge: ParticleFile, tools: ToolSet | None) -> Box:
    """Return the box to show: that of the cavity with a little of the tools, or of the charge where that is open."""
    low, high = charge.positions.min(axis=0), charge.positions.max(axis=0)
    if tools is not None:
        try:
            every = max(1, len(charge.positions) // MOST_SEEDS)
            cavity = cavity_volume(tools, charge.positions[::every], spacing=float((high - low).max()) / COARSE_STEPS)
        except SceneError:
            pass  # a charge inside a tool is drawn, so that the picture shows it
        else:
            if cavity.closed:
                low, high = np.minimum(low, cavity.bounds[0]), np.maximum(high, cavity.bounds[1])
    margin = 0.05 * float((high - low).max())
    return low - margin, high + margin


def draw_cut(charge: ParticleFile, path: Path, view: View, clearance: Clearance | None, space: Box) -> None:
    """Draw a slice through the middle along and across, with the outlines of the tools at their drawn positions."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.5), layout="constrained")
    axes: Any = figure.subplots(2, 1)
    low, high = charge.positions.min(axis=0), charge.positions.max(axis=0)
    spacing = max(float(s) for s in charge.extra.get("spacing", [1.0]))
    meaning, rgb = coloured(charge)
    for ax, along in zip(axes, (view.right, view.up), strict=True):
        across = view.up if along == view.right else view.right
        middle = 0.5 * (low[across] + high[across])
        near = np.abs(charge.positions[:, across] - middle) <= 0.75 * spacing
        x, y = charge.positions[near][:, [along, view.depth]].T
        _squares(ax, x, y, spacing, float(charge.extra.get("spacing", [1.0] * 3)[2]), rgb[near])
        if clearance is not None:
            _tool_lines(ax, clearance, along, view.depth, across, middle, space)
        ax.set(xlabel=f"{NAMES[along]} [mm]", ylabel=f"{NAMES[view.depth]} [mm]", aspect="equal")
        ax.set_title(f"cut at {NAMES[across]} = {middle:.1f} mm: {meaning}".replace("-0.0", "0.0"))
    figure.savefig(path, format="png", dpi=150)


def _squares(ax: Any, x: Array, y: Array, width: float, height: float, colours: Array) -> None:
    """Draw one rectangle a particle."""
    from matplotlib.collections import PolyCollection

    corners = 0.5 * np.array([[-width, -height], [width, -height], [width, height], [-width, height]])
    ax.add_collection(
        PolyCollection(list(np.stack([x, y], axis=1)[:, None] + corners), facecolors=colours, linewidths=0)
    )
    ax.autoscale_view()


def _tool_lines(ax: Any, clearance: Clearance, a: int, b: int, c: int, middle: float, space: Box) -> None:
    """Draw where the tools' surfaces meet the plane of axes a and b."""
    low, high = space
    u, v = np.linspace(low[a], high[a], 500), np.linspace(low[b], high[b], 400)
    U, V = np.meshgrid(u, v)
    points = np.empty((U.size, 3))
    points[:, a], points[:, b], points[:, c] = U.ravel(), V.ravel(), middle
    phi = clearance(points).reshape(U.shape)
    ax.contourf(U, V, phi, levels=[-1e9, 0.0], colors=["0.8"], zorder=0)
    if phi.min() < 0 < phi.max():
        ax.contour(U, V, phi, levels=[0.0], colors="k", linewidths=1.0)


def draw_in_tool(charge: ParticleFile, view: View, clearance: Clearance | None, space: Box) -> bytes | str:
    """Draw the charge in its tool in three dimensions; return the PNG, or in words why there is none.

    VTK runs in a process of its own: without a working OpenGL it ends in a segmentation fault.
    """
    meaning, rgb = coloured(charge)
    with tempfile.TemporaryDirectory(prefix="ppmc-charge-") as folder:
        job, path = Path(folder) / "job.npz", Path(folder) / "picture.png"
        arrays: dict[str, Any] = {
            "points": charge.positions,
            "colours": rgb,
            "meaning": meaning,
            "squares": charge.fields["fibre_direction"] ** 2,
            "spacing": np.asarray(charge.extra.get("spacing", [1.0] * 3), dtype=float),
            "depth": view.depth,
            "toward": view.toward,
            "right": view.right,
        }
        if clearance is not None:
            arrays |= _tool_grid(space, clearance)
        np.savez(job, **arrays)
        try:
            done = subprocess.run(
                [sys.executable, "-m", "ppmc.charge.figures.render_worker", str(job), str(path)],
                capture_output=True, text=True, timeout=SECONDS_TO_DRAW, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return f"the drawing process took more than {SECONDS_TO_DRAW:g} s"
        if done.returncode == 0 and path.is_file():
            return path.read_bytes()
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"the drawing process ended with code {done.returncode} (no working OpenGL?)"


def _tool_grid(space: Box, clearance: Clearance, nodes: int = 140) -> dict[str, Any]:
    """Return the tools' distance on a grid."""
    low, high = space
    step = float((high - low).max()) / nodes
    shape = np.ceil((high - low) / step).astype(int) + 1
    axes = [low[a] + step * np.arange(shape[a]) for a in range(3)]
    # VTK runs x fastest.
    Z, Y, X = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    phi = clearance(np.stack([X.ravel(), Y.ravel(), Z.ravel()], axis=1))
    return {"grid_shape": shape, "grid_origin": low, "grid_step": step, "grid": phi}
