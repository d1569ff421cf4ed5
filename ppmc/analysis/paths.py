"""Paths of inspection regions: where a path plot takes its averages, and in which components it shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ppmc.analysis.regions import Region, box
from ppmc.errors import SceneError

AXIS_NAMES = ("x1", "x2", "x3")


@dataclass(frozen=True)
class InspectionPath:
    """A row of regions with a coordinate along it.

    Parameters
    ----------
    name
        As in tables and captions.
    coordinate : ndarray, shape (m,)
        Position of each region along the path.
    coordinate_label
        Axis label with unit, e.g. ``"x1 [mm]"``.
    regions : tuple of Region, length m
    frames : ndarray, shape (m, 3, 3)
        Rows are the axes the components refer to at each region.
    components : tuple of 3 str
        Their names, e.g. ``("1", "2", "3")`` or ``("r", "θ", "x1")``.
    description
        One line for captions.
    """

    name: str
    coordinate: np.ndarray
    coordinate_label: str
    regions: tuple[Region, ...]
    frames: np.ndarray
    components: tuple[str, str, str]
    description: str

    def __len__(self) -> int:
        return len(self.regions)


def straight_path(
    name: str,
    axis: int,
    slices: int,
    lower: np.ndarray,
    upper: np.ndarray,
) -> InspectionPath:
    """Cut a box into equal slices along one axis and average over width and thickness (J Figs 13 and 14).

    Parameters
    ----------
    name
        Name of the path.
    axis : int
        0, 1 or 2.
    slices : int
        Number of equal slices.
    lower, upper : ndarray, shape (3,)
        The box, mm; bounds across the path may be infinite.

    Raises
    ------
    SceneError
        If the box is empty or unbounded along the path.
    """
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if not np.isfinite([lower[axis], upper[axis]]).all() or not upper[axis] > lower[axis]:
        raise SceneError(f"path '{name}': needs finite bounds along {AXIS_NAMES[axis]}, got {lower[axis]} to {upper[axis]} mm")
    edges = np.linspace(lower[axis], upper[axis], slices + 1)
    regions = []
    for k in range(slices):
        low, high = lower.copy(), upper.copy()
        low[axis], high[axis] = edges[k], edges[k + 1]
        regions.append(box(f"{name}[{k}]", low, high))
    width = edges[1] - edges[0]
    return InspectionPath(
        name=name,
        coordinate=0.5 * (edges[1:] + edges[:-1]),
        coordinate_label=f"{AXIS_NAMES[axis]} [mm]",
        regions=tuple(regions),
        frames=np.broadcast_to(np.eye(3), (slices, 3, 3)).copy(),
        components=("1", "2", "3"),
        description=f"{slices} equal slices of {width:.3g} mm along {AXIS_NAMES[axis]} from {edges[0]:.4g} to {edges[-1]:.4g} mm, "
        "averaged over the cross-section",
    )
