"""Pictures of an orientations file: what a glance should tell before any number is trusted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ppmc.files import read_voxels
from ppmc.files.beside import marked_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_VOXELS = 3_000_000
GLYPHS = 700
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "0.55"
"""Colours that stay apart for colour-blind readers."""
AXES = ("x1", "x2", "x3")


def draw(path: Path, folder: Path, *, force: bool = False) -> list[Path]:
    """Draw all figures of an orientations file.

    Parameters
    ----------
    path : Path
        Orientations file.
    folder : Path
        Where the PNG files go.
    force : bool
        Replace pictures of other programs.

    Returns
    -------
    list of Path
        The files: slices, angles, poles, thickness, glyphs.
    """
    with read_voxels(path, "orientations") as file:
        k = max(1, int(np.ceil((np.prod(file.grid.shape) / MOST_VOXELS) ** (1 / 3))))
        every = (slice(None, None, k),) * 3
        grid = file.grid.strided(k)
        p, r = file.read("fibre_direction", every), file.read("platelet_normal", every)
        valid = file.read("valid", every) > 0
        sure = file.read("confidence", every) if "confidence" in file.names else valid.astype(np.float32)
    figures = {
        "slices": slices(p, sure, valid, grid.spacing),
        "angles": angles(p[valid], r[valid]),
        "poles": poles(p[valid], r[valid]),
        "thickness": through_thickness(p, r, valid, grid.spacing[2]),
        "glyphs": glyphs(p, valid, grid.spacing),
    }
    written = []
    for name, figure in figures.items():
        written.append(folder / f"orientations_{name}.png")
        with marked_file(written[-1], [path], force=force) as temporary:
            figure.savefig(temporary, format="png", dpi=130)
    return written


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def slices(p: NDArray[Any], sure: NDArray[Any], valid: NDArray[Any], spacing: tuple[float, float, float]) -> Figure:
    """Three middle sections coloured by the in-plane angle of p, and how certain it is."""
    figure = _figure(10.0, 6.4)
    axes = figure.subplots(2, 3)
    nz, ny, nx = valid.shape
    angle = np.degrees(np.arctan2(p[..., 1], p[..., 0])) % 180.0
    sections = (((nz // 2, slice(None), slice(None)), 0, 1), ((slice(None), ny // 2, slice(None)), 0, 2),
                ((slice(None), slice(None), nx // 2), 1, 2))  # fmt: skip
    for column, (cut, a, b) in enumerate(sections):
        extent = (0, spacing[a] * valid.shape[2 - a], 0, spacing[b] * valid.shape[2 - b])
        for row, (values, colours, low, high) in enumerate(((angle, "twilight", 0, 180), (sure, "cividis", 0, 1))):
            shown = np.where(valid[cut], values[cut], np.nan)
            ax = axes[row, column]
            image = ax.imshow(
                shown, origin="lower", extent=extent, cmap=colours, vmin=low, vmax=high, interpolation="nearest"
            )
            ax.set_facecolor("white")
            ax.set_xlabel(f"{AXES[a]} (mm)")
            ax.set_ylabel(f"{AXES[b]} (mm)")
            if column == 2:
                label = "angle of p from x1 (degrees)" if row == 0 else "confidence of p"
                figure.colorbar(image, ax=axes[row, :], label=label, shrink=0.9)
    return figure


def angles(p: NDArray[Any], r: NDArray[Any]) -> Figure:
    """Histograms of the in-plane angle of p and of the slopes of p and r out of the plane."""
    figure = _figure(9.0, 3.4)
    left, right = figure.subplots(1, 2)
    in_plane = np.degrees(np.arctan2(p[:, 1], p[:, 0])) % 180.0
    left.hist(in_plane, bins=np.arange(0, 181, 5), weights=np.full(len(p), 100.0 / max(len(p), 1)), color=BLUE)
    left.axhline(100.0 / 36.0, color=GREY, ls="--", label="random in plane")
    left.set(xlabel="angle of p from x1 (degrees)", ylabel="share of voxels per 5 degrees (%)", xlim=(0, 180))
    left.legend(frameon=False)
    bins = np.arange(0, 91, 2.5)
    for vectors, label, colour, style in (
        (np.abs(p[:, 2]), "p out of x1-x2", BLUE, "-"),
        (np.sqrt(np.clip(1.0 - r[:, 2] ** 2, 0, 1)), "r away from x3", ORANGE, "--"),
    ):
        tilt = np.degrees(np.arcsin(np.clip(vectors, 0, 1)))
        right.hist(tilt, bins=bins, weights=np.full(len(p), 100.0 / max(len(p), 1)), histtype="step", color=colour,
                   ls=style, lw=1.8, label=label)  # fmt: skip
    right.set(xlabel="tilt (degrees)", ylabel="share of voxels per 2.5 degrees (%)", xlim=(0, 90))
    right.legend(frameon=False)
    return figure


def poles(p: NDArray[Any], r: NDArray[Any]) -> Figure:
    """Equal-area pole figures of p and r, seen along x3; 1 is the density of random directions."""
    figure = _figure(8.4, 4.0)
    edges = np.linspace(-1.0, 1.0, 61)
    for ax, v, title in zip(figure.subplots(1, 2), (p, r), ("fibre direction p", "platelet normal r"), strict=True):
        up = v * np.where(v[:, 2:] < 0, -1.0, 1.0)
        # Lambert's projection of the upper half onto the unit disc keeps areas.
        scale = 1.0 / np.sqrt(1.0 + up[:, 2])
        x, y = up[:, 0] * scale, up[:, 1] * scale
        level = np.abs(up[:, 2]) < 1e-6
        x, y = np.concatenate([x, -x[level]]), np.concatenate([y, -y[level]])
        density, _, _ = np.histogram2d(y, x, bins=edges)
        density *= np.pi / (max(density.sum(), 1.0) * (edges[1] - edges[0]) ** 2)
        centre = 0.5 * (edges[1:] + edges[:-1])
        density[np.hypot(*np.meshgrid(centre, centre)) > 1.0] = np.nan
        image = ax.imshow(np.sqrt(density), origin="lower", extent=(-1, 1, -1, 1), cmap="cividis")
        bar = figure.colorbar(image, ax=ax, shrink=0.8, label="density (random = 1)")
        ticks = np.linspace(0.0, float(np.nanmax(np.sqrt(density))), 5)
        bar.set_ticks(ticks.tolist(), labels=[f"{t * t:.0f}" if t > 3 else f"{t * t:.2g}" for t in ticks])
        ax.add_artist(_circle())
        ax.set_title(title, pad=16)
        ax.text(1.03, 0, "x1", va="center")
        ax.text(0, 1.03, "x2", ha="center")
        ax.set_axis_off()
    return figure


def _circle() -> Any:
    from matplotlib.patches import Circle

    return Circle((0, 0), 1.0, fill=False, color="black", lw=0.8)


def through_thickness(p: NDArray[Any], r: NDArray[Any], valid: NDArray[Any], step: float) -> Figure:
    """Components of A and N averaged over each plane of voxels, through x3."""
    figure = _figure(9.0, 3.6)
    z = (np.arange(len(valid)) + 0.5) * step
    styles = (("11", BLUE, "-"), ("22", ORANGE, "--"), ("33", GREEN, "-."), ("12", GREY, ":"))
    for ax, v, symbol in zip(figure.subplots(1, 2), (p, r), "AN", strict=True):
        weight = valid.sum(axis=(1, 2)).clip(1)
        for index, colour, style in styles:
            a, b = int(index[0]) - 1, int(index[1]) - 1
            mean = np.sum(v[..., a] * v[..., b] * valid, axis=(1, 2), dtype=np.float64) / weight
            ax.plot(z, mean, color=colour, ls=style, label=f"{symbol}{index}")
        ax.set(xlabel="distance along x3 (mm)", ylabel=f"component of {symbol}", ylim=(-0.5, 1.05))
        ax.legend(frameon=False, ncols=2)
    return figure


def glyphs(p: NDArray[Any], valid: NDArray[Any], spacing: tuple[float, float, float]) -> Figure:
    """Short lines along p at some voxels, coloured by their tilt out of the x1-x2 plane."""
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

    figure = _figure(7.0, 5.4)
    ax: Any = figure.add_subplot(projection="3d")
    size = np.array(valid.shape[::-1]) * spacing
    gap = float((np.prod(size) / GLYPHS) ** (1 / 3))
    grids = np.meshgrid(*(np.arange(gap / 2, edge, gap) for edge in size), indexing="ij")
    points = np.stack([g.ravel() for g in grids], axis=-1)
    index = np.minimum((points / spacing).astype(int), np.array(valid.shape[::-1]) - 1)
    cut = index[:, 2], index[:, 1], index[:, 0]
    keep = valid[cut]
    points, vectors = points[keep], p[cut][keep]
    ends = np.stack([points - 0.45 * gap * vectors, points + 0.45 * gap * vectors], axis=1)
    tilt = np.degrees(np.arcsin(np.clip(np.abs(vectors[:, 2]), 0, 1)))
    lines = Line3DCollection(ends.tolist(), linewidths=1.6, cmap=colormaps["cividis"])
    lines.set_array(tilt)
    lines.set_clim(0, 45)
    ax.add_collection3d(lines)
    ax.set(xlim=(0, size[0]), ylim=(0, size[1]), zlim=(0, size[2]))
    ax.set(xlabel="x1 (mm)", ylabel="x2 (mm)", zlabel="x3 (mm)")
    ax.set_box_aspect(size)
    figure.colorbar(lines, ax=ax, shrink=0.6, label="tilt of p out of the x1-x2 plane (degrees)", pad=0.12)
    return figure
