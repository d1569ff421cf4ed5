"""One way to draw particles for all objects of the API."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from ppmc.particles import Particles


def plot(
    particles: Particles, name: str, cut: tuple[ArrayLike, ArrayLike] | None = None, save: str | Path | None = None
) -> Figure:
    """Draw particles off screen.

    Parameters
    ----------
    particles : Particles
    name : str
        A view of the report (``fibre_direction``, ``platelet_normal``, ``dominant_direction``, ``iso_surface``,
        ``platelets``, ``maps``), or any field: a scalar, or the length of a vector.
    cut : (point, normal), optional
        Plane that opens the part, mm; what lies on the normal's side is left out.
    save : str or Path, optional
        Picture to write as well, in the format of its ending.

    Raises
    ------
    SceneError
        If there is no such view or field.
    """
    from ppmc.analysis.explore import view_figure

    figure = view_figure(particles, name, cut)
    if save is not None:
        figure.savefig(Path(save), dpi=150)
    return figure
