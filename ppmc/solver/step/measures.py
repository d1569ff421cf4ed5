"""What a step says about itself beside the solve: packing, particles that are outside, and where the worst of each is.

All is measured on one order of the particles, at once, and named by the particles' numbers in the charge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ppmc.solver.particles.neighbours import NeighbourList, Pairs
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.packing import Packing, inside
from ppmc.solver.step.model import NOWHERE, Place
from ppmc.solver.walls.tools import Walls, faces_near

LOW, HIGH = 0.05, 0.95  # quantiles of packing in the table of steps
# A velocity gradient in space needs three neighbours that do not lie in a plane with their particle. Whoever has fewer
# within the list's reach, a tenth beyond its kernel's, has left the charge.
LEAST_NEIGHBOURS = 3


@dataclass(frozen=True)
class PackingMeasure:
    """Packing of the particles inside the material; NaN where there are none.

    Attributes
    ----------
    low, high : float
        Quantiles of 5 and 95 %.
    worst : float
        The value farthest from one.
    at : Place
        Where that is.
    """

    low: float = np.nan
    high: float = np.nan
    worst: float = np.nan
    at: Place = NOWHERE


@dataclass(frozen=True)
class OutsideMeasure:
    """Particles whose centre lies in a tool, or that have lost the charge.

    Attributes
    ----------
    count : int
    at : Place
        The one deepest in a tool, else the first that lost the charge.
    """

    count: int = 0
    at: Place = NOWHERE


def place_of(state: ParticleState, row: int) -> Place:
    """Number and position of the particle in a row of the state."""
    x1, x2, x3 = state.position[row].tolist()
    return Place(int(state.original[row]), (x1, x2, x3))


def packing_inside(state: ParticleState, pairs: Pairs, found: Packing, smoothing_length: float) -> PackingMeasure:
    """Quantiles and worst of the packing `found` in the material's interior."""
    rows = np.flatnonzero(inside(pairs, found, smoothing_length))
    if len(rows) == 0:
        return PackingMeasure()
    values = found.value[rows]
    low, high = np.quantile(values, (LOW, HIGH)).tolist()
    worst = int(np.argmax(np.abs(values - 1.0)))
    return PackingMeasure(low, high, float(values[worst]), place_of(state, int(rows[worst])))


def outside(state: ParticleState, walls: Walls, neighbours: NeighbourList, time: float) -> OutsideMeasure:
    """Find particles in tools and without a charge at `time`, s; the list must be in the state's order."""
    rows, _, distance, _ = faces_near(walls.tools.arrays, walls.offsets(time), state.position, 0.0, most=1)
    deep = distance[:, 0] < 0.0
    in_tools, depth = rows[deep], -distance[deep, 0]
    alone = np.flatnonzero(np.diff(neighbours.start) < LEAST_NEIGHBOURS)
    count = len(np.union1d(in_tools, alone))
    if count == 0:
        return OutsideMeasure()
    worst = int(in_tools[np.argmax(depth)]) if len(in_tools) else int(alone[np.argmin(state.original[alone])])
    return OutsideMeasure(count, place_of(state, worst))


def worst_volume_ratio(state: ParticleState) -> tuple[float, float, Place]:
    """Mean and largest |J - 1|, and where the largest is."""
    error = np.abs(state.volume_ratio - 1.0)
    worst = int(np.argmax(error))
    return float(error.mean()), float(error[worst]), place_of(state, worst)
