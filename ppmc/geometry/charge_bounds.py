"""The box that a charge takes before it is made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import SceneError
from ppmc.geometry.domain import closed_domain
from ppmc.geometry.tools.toolset import ToolSet
from ppmc.scene.sections.charge import BoxDomain, Domain, DrapedDomain

Array = NDArray[np.float64]
SAMPLES = 25
# A drop stops at its distance from the tool; few slopes need more steps to come this close, in thicknesses.
STEPS, NEAR = 200, 1e-3


def charge_bounds(domain: Domain, tools: ToolSet | None, directory: Path) -> tuple[Array, Array]:
    """Return the lower and upper corner, shape (3,), mm, of the box round a charge.

    Parameters
    ----------
    domain : one of the domains of :mod:`ppmc.scene.sections.charge`
        Exact but for a draped sheet, whose box is that of its flat outline put down on the tool: a little too large
        across slopes.
    tools : ToolSet or None
        The scene's tools; a draped sheet needs them.
    directory : Path
        Folder to which files are relative.

    Raises
    ------
    SceneError
        If a draped sheet misses its tool or names none.
    InputFileError
        If a surface cannot be read or is not closed.
    """
    if isinstance(domain, BoxDomain):
        low = np.array(domain.origin, dtype=float)
        return low, low + np.array(domain.size)
    if not isinstance(domain, DrapedDomain):
        return closed_domain(domain, directory).bounds
    if tools is None or domain.tool not in tools.names:
        known = "none" if tools is None else ", ".join(tools.names)
        raise SceneError(f"charge.domain.tool: no tool '{domain.tool}' in the scene's tooling (it has {known})")
    return _draped_bounds(domain, tools)


def _draped_bounds(domain: DrapedDomain, tools: ToolSet) -> tuple[Array, Array]:
    """Return about the box of a sheet on its tool: its flat outline, dropped along `down` onto the tool."""
    down = np.array(domain.down)
    along = np.array(domain.along) - float(np.dot(domain.along, down)) * down
    along /= np.linalg.norm(along)
    across = np.cross(down, along)
    u, v = (np.linspace(-0.5, 0.5, SAMPLES) * size for size in domain.size[:2])
    flat = (u[:, None, None] * along + v[:, None] * across).reshape(-1, 3)
    reach = 2.0 * max(domain.size)
    tool = tools.names.index(domain.tool)
    points = np.array(domain.centre) + flat - reach * down
    for _ in range(STEPS):
        phi = tools.distances(points)[0][tool]
        points = points + np.minimum(phi, 4.0 * reach)[:, None] * down
    met = np.abs(tools.distances(points)[0][tool]) < NEAR * domain.size[2]
    if not met.any():
        raise SceneError(f"charge.domain: the sheet misses tool '{domain.tool}'; move `centre` or turn `down`")
    lower = points[met]
    upper = lower - domain.size[2] * down
    both = np.concatenate([lower, upper])
    return both.min(axis=0), both.max(axis=0)
