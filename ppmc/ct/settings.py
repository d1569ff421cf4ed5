"""Filters and windows of a run: what the scene asks for, or what follows from voxel size and platelet thickness."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.ct import filters
from ppmc.ct.follow import variance_along
from ppmc.ct.signal import Signal
from ppmc.errors import SceneError
from ppmc.scene.sections.ct import CtSection

Triple = tuple[float, float, float]
Three = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]

CLEAN = Signal()
FINEST_SIGMA = 0.5
THIN = 0.9
"""Default sigma, voxels, where platelets may be but a few voxels thick: what the finest Gaussian derivative that knows
no direction takes in of the next platelet is an error that no window averages away."""
REACHES, ACROSS, FINE = (4.5, 10.0), 0.9, 0.5
"""Window for p where the platelets' plane is known, voxels: half axes in that plane, and across it, of two ellipsoids
over which is averaged in turn, and standard deviation of the round window before them, which joins their lattices."""
ROUND, FOLLOWING = 2.0, 1.5
"""Standard deviation of the round window for p where no platelets are known, in those of the derivative: one window
that must do alone, and windows that follow the fibre, which together hold more."""
NOISY, WIDEST = 0.25, 2.0
"""How much larger that is, per energy of noise over that of the signal in the gradients; and how many times larger it
may be, lest there be no gradient within it, where what is seen is coarse."""
NORMAL_VOXELS, NORMAL_THICKNESSES = 8.0, 1.3
"""Standard deviation of the window for r: the larger of so many voxels and so many platelet thicknesses."""


@dataclass(frozen=True)
class Steering:
    """Ellipsoids over which the window for p averages, one after the other.

    Attributes
    ----------
    reaches : tuple of float
        Half axes in the platelet's plane, mm.
    across : float
        Half axis across it, mm.
    voxels : two tuples of int
        Voxels (x, y, z) within each reach.
    """

    reaches: tuple[float, float]
    across: float
    voxels: tuple[tuple[int, int, int], tuple[int, int, int]]


@dataclass(frozen=True)
class Settings:
    """Standard deviations in mm and the filters they give; triples are in the order x, y, z.

    Attributes
    ----------
    sigma, fibre_window, normal_window : tuple of float
        Standard deviations, mm. ``normal_window`` is None where r comes from the window of p. With ``steering`` the
        last of ``fibre_window`` is that across the platelet.
    smooth, slope, window : three arrays
        Taps of Gaussian, derivative (per mm) and window for p.
    cell : tuple of int
        Voxels per cell of the coarse grid on which the window for r is applied.
    cell_reach : tuple of int
        Half length of that window, cells.
    side_steps : int
        Reach of displaced windows, voxels.
    steering : Steering or None
        How the window for p follows the platelet's plane; None where its axes are the volume's.
    follow : bool
        Whether windows for p follow the fibre. The first of ``fibre_window`` is then that along it.
    planar : bool
        Whether fibres are known to lie in platelets, so that a doubtful p is kept in their plane.
    """

    sigma: Triple
    fibre_window: Triple
    normal_window: Triple | None
    smooth: Three
    slope: Three
    window: Three
    cell: tuple[int, int, int]
    cell_reach: tuple[int, int, int]
    side_steps: int
    steering: Steering | None = None
    follow: bool = False
    planar: bool = False

    @property
    def gradient_radius(self) -> tuple[int, int, int]:
        """Half length of the derivative filters, voxels."""
        return _radii(self.smooth)

    @property
    def window_radius(self) -> tuple[int, int, int]:
        """Half length of the window for p, voxels."""
        return _radii(self.window)


def settings(
    section: CtSection, spacing: Triple, shape: tuple[int, int, int], thickness: float | None, signal: Signal = CLEAN
) -> Settings:
    """Work out filters and windows.

    Parameters
    ----------
    section : CtSection
        The scene's wishes.
    spacing : tuple of float
        Voxel size (x, y, z), mm.
    shape : tuple of int
        Number of voxels (nz, ny, nx).
    thickness : float or None
        Platelet thickness, mm, if known.
    signal : Signal
        What the volume bears, for what the scene leaves open.

    Raises
    ------
    SceneError
        If a filter is finer than the voxels, or a window larger than the volume.
    """
    h = np.array(spacing)
    extent = h * shape[::-1]
    if thickness is not None:
        _check_thickness(thickness, spacing, extent)
    follows = section.normals if section.follow is None else section.follow
    free = section.fibre_window is None and follows
    steering = _steering(h) if free and thickness is not None else None
    follow = free and thickness is None and not section.side_steps
    sigma = section.sigma
    if sigma is None:
        sigma = float(max(h.min(), 0.7 * h.max())) * (THIN if steering else 1.0 if thickness else signal.sigma)
    if sigma < FINEST_SIGMA * h.max():
        raise SceneError(
            f"ct: sigma is {sigma:.4g} mm, finer than half a voxel ({h.max():.4g} mm); "
            f"use at least {FINEST_SIGMA * h.max():.4g} mm"
        )
    window = FINE * h if steering else _fibre_window(section, sigma, float(h.min()), signal, follow)
    fibre = _widths(steering, window) if steering else window
    if follow:
        fibre = np.array([math.hypot(float(window[0]), math.sqrt(variance_along()) * float(h.min())), *window[1:]])
    normal = section.normal_window
    if normal is None:
        wish = max(NORMAL_VOXELS * float(h.min()), NORMAL_THICKNESSES * (thickness or 0.0))
        normal = min(wish, float(extent.min()) / 4.0) if follows else float(window.max())
    for name, given in (("fibre_window", window), ("normal_window", np.full(3, normal)), ("sigma", np.full(3, sigma))):
        for axis, width, edge in zip("xyz", given, extent, strict=True):
            if 4.0 * width > edge:
                raise SceneError(
                    f"ct: {name}: a window of standard deviation {width:.4g} mm is larger than the volume, "
                    f"which measures {edge:.4g} mm along {axis}; use at most {edge / 4.0:.4g} mm"
                )
    fine = [float(sigma / step) for step in h]
    slope = [filters.derivative(s) / np.float32(step) for s, step in zip(fine, h, strict=True)]
    two_scales = section.normals and (
        steering is not None or section.normal_window is not None or normal > float(window.max()) * 1.01
    )
    cells = tuple(_odd_cell(normal / step) for step in h)
    reach = tuple(
        len(filters.gaussian(coarse_sigma(normal, step, cell))) // 2 for step, cell in zip(h, cells, strict=True)
    )
    return Settings(
        sigma=(sigma, sigma, sigma),
        fibre_window=_triple(fibre),
        normal_window=(normal, normal, normal) if two_scales else None,
        smooth=_three([filters.gaussian(s) for s in fine]),
        slope=_three([s.astype(np.float32) for s in slope]),
        window=_three(
            [filters.gaussian(float(w / step), filters.WINDOW_CUT) for w, step in zip(window, h, strict=True)]
        ),
        cell=cells,  # type: ignore[arg-type]
        cell_reach=reach,  # type: ignore[arg-type]
        side_steps=section.side_steps if section.side_steps is not None else (1 if thickness and follows else 0),
        steering=steering,
        follow=follow,
        planar=thickness is not None,
    )


def _check_thickness(thickness: float, spacing: Triple, extent: NDArray[np.float64]) -> None:
    """Refuse a platelet thickness that cannot be one in this volume."""
    if thickness >= extent.max():
        raise SceneError(
            f"ct: platelet_thickness is {thickness:.4g} mm, but the whole volume measures "
            f"{' x '.join(f'{e:.4g}' for e in extent)} mm (x, y, z) with voxels of {_size(spacing)} mm; "
            "give the unit of the length, such as '140 um', or correct the voxel size"
        )
    if thickness < min(spacing):
        raise SceneError(
            f"ct: platelet_thickness is {thickness:.4g} mm, less than a voxel of {_size(spacing)} mm: such platelets "
            "are not seen; correct the length or the voxel size, or leave the thickness out"
        )


def _size(spacing: Triple) -> str:
    """Return a voxel's size as text."""
    return f"{spacing[0]:.4g}" if len(set(spacing)) == 1 else " x ".join(f"{h:.4g}" for h in spacing)


def _fibre_window(section: CtSection, sigma: float, finest: float, signal: Signal, follow: bool) -> NDArray[np.float64]:
    """Return the window for p along the axes: what is asked for, else round."""
    window = section.fibre_window
    if window is None:
        fine = sigma * (1.0 + NOISY * min(signal.odds, 1.0))
        return np.full(3, (FOLLOWING if follow else ROUND) * max(fine, min(signal.scale * finest, WIDEST * sigma)))
    return np.array(window if isinstance(window, tuple) else (window,) * 3)


def _steering(h: NDArray[np.float64]) -> Steering:
    """Return the ellipsoids for voxels of size h."""
    near, wide = (reach * float(h.min()) for reach in REACHES)
    (x0, y0, z0), (x1, y1, z1) = ([int(reach / step + 1e-6) for step in h] for reach in (near, wide))
    return Steering((near, wide), ACROSS * float(h.max()), ((x0, y0, z0), (x1, y1, z1)))


def _widths(steering: Steering, window: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return standard deviations in the platelet's plane, twice, and across it.

    An ellipsoid of three half axes a weighted by (1 - q^2)^2 has variance a^2 / 9 along each; of a thin one few planes
    of voxels are left, and in the plane the variance is that of a disc, a^2 / 8.
    """
    before = float(np.max(window)) ** 2
    along = math.sqrt(sum(reach**2 for reach in steering.reaches) / 8.0 + before)
    return np.array([along, along, math.sqrt(2.0 * steering.across**2 / 9.0 + before)])


def _odd_cell(width: float) -> int:
    """Return the odd number of voxels of a cell, at most about half the window's standard deviation in voxels."""
    return max(1, min(7, 2 * int((0.5 * width + 0.5 - 1.0) // 2.0) + 1))


def coarse_sigma(width: float, spacing: float, cell: int) -> float:
    """Return the standard deviation, in cells, that makes up a window of ``width`` mm on the coarse grid.

    Averaging over the cell and interpolating between cells widen the window too; their variance is taken off.
    """
    variance = (width / spacing) ** 2 - (cell**2 - 1) / 12.0 - cell**2 / 6.0 * (cell > 1)
    return math.sqrt(max(variance, 0.25)) / cell


def _radii(taps: Three) -> tuple[int, int, int]:
    return (len(taps[0]) // 2, len(taps[1]) // 2, len(taps[2]) // 2)


def _three(parts: list[NDArray[np.float32]]) -> Three:
    return (parts[0], parts[1], parts[2])


def _triple(values: NDArray[np.float64]) -> Triple:
    return (float(values[0]), float(values[1]), float(values[2]))
