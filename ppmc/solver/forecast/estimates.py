"""What can be said of a run before its charge is made: its size, the constants it would use, steps, narrow places."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import SceneError
from ppmc.geometry.cavity.cavity import cavity_volume
from ppmc.geometry.charge_bounds import charge_bounds
from ppmc.geometry.domain import closed_domain
from ppmc.geometry.tools.checks import ALONG
from ppmc.geometry.tools.toolset import ToolSet
from ppmc.materials import Material
from ppmc.materials.relations import axial_viscosity
from ppmc.scene.sections.charge import BoxDomain, ChargeSection, DrapedDomain
from ppmc.solver.run.setup import closing_motion, run_constants
from ppmc.solver.step.explicit import SAFETY
from ppmc.solver.step.time_step import event_times

if TYPE_CHECKING:
    from ppmc.scene import Scene

Array = NDArray[np.float64]

# Strain rate (root of D:D) of a squeeze over its closing rate: 1.22 where it flows both ways, 1.41 where one way.
STRAIN_PER_CLOSURE = 1.3
# The largest eigenvalue of viscous operator over mass is 4 hypot(SHEAR eta23 + AXIAL eta11, BOND x the zero-energy
# control's stiffness along bonds) / (rho h^2) within 15 %, measured on lattices of R = 1 to 61,215.
SHEAR_SHARE, AXIAL_SHARE, BOND_SHARE = 0.37, 0.26, 0.23
# An even flow takes steps by its closure alone. Unlike platelets part from one another, the more the stiffer; a charge
# that fills a closed cavity speeds up as room runs out and turns through its mouths; a formed sheet is pressed place by
# place. Iterations of a step alike. Fitted to whole runs, which they meet within a factor of two
# (docs/benchmarks/solver.md, "What a run takes").
UNLIKE_POWER = 0.2  # of the anisotropy ratio
FILLING, FULL = 2.0, 0.95  # factor, and share of the cavity from which a charge fills it
SHEET = 6.0
ITERATIONS_EVEN, ITERATIONS_UNLIKE, ITERATIONS_SHEET = 50.0, 115.0, 300.0
SAMPLES = 25
OPPOSED = -0.9  # cosine between the normals of tools that face each other


@dataclass(frozen=True)
class Charge:
    """What is known of the charge before it is made.

    Attributes
    ----------
    count : float
        Number of particles.
    spacing : ndarray, shape (3,)
        Particle spacing, mm.
    low, high : ndarray, shape (3,)
        Bounds, mm; of a draped sheet estimated.
    sheet : (float, int) or None
        Thickness, mm, and layers of a draped sheet; None for all others.
    """

    count: float
    spacing: Array
    low: Array
    high: Array
    sheet: tuple[float, int] | None = None

    @property
    def corners(self) -> Array:
        """Centres of the outermost particles, shape (8, 3), mm."""
        ends = np.array([self.low + 0.5 * self.spacing, self.high - 0.5 * self.spacing])
        ends = np.sort(ends, axis=0)
        return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


@dataclass(frozen=True)
class Plan:
    """Constants that a run of the scene would use.

    Attributes
    ----------
    speed : float
        Largest speed of a tool, mm/s.
    thickness : float
        Extent of the charge along that motion, mm.
    layers : int
        Layers of particles in that extent, or of a draped sheet.
    compression : float
        Thickness over the narrowest gap that the tools leave at the end.
    rate, final_rate : float
        Closing rates at the start and where tools have come closest, 1/s.
    bulk_modulus, density : float
        K, Pa, and scaled density, g/mm^3.
    """

    speed: float
    thickness: float
    layers: int
    compression: float
    rate: float
    final_rate: float
    bulk_modulus: float
    density: float


@dataclass(frozen=True)
class NarrowPlace:
    """The least distance between two tools that face each other in the cavity.

    Attributes
    ----------
    first, second : str
        Their names.
    width : float
        Their distance, mm.
    """

    first: str
    second: str
    width: float


def describe_charge(section: ChargeSection, scene: Scene, tools: ToolSet) -> Charge:
    """Return what the scene says of its charge.

    Raises
    ------
    SceneError
        If a draped sheet misses its tool.
    """
    domain = section.domain
    if isinstance(domain, BoxDomain | DrapedDomain):
        low, high = charge_bounds(domain, tools, scene.directory)
        volume = float(np.prod(domain.size))
    else:
        solid = closed_domain(domain, scene.directory)
        (low, high), volume = solid.bounds, solid.volume
    box = np.array(domain.size) if isinstance(domain, DrapedDomain) else high - low
    cells = np.maximum(np.floor(box / np.array(section.spacing) + 0.5 + 1e-9), 1.0)
    cells[2] = section.layers or cells[2]
    spacing = box / cells
    sheet = (float(box[2]), int(cells[2])) if isinstance(domain, DrapedDomain) else None
    return Charge(volume / float(np.prod(spacing)), spacing, low, high, sheet)


def make_plan(settings: Any, material: Material, tools: ToolSet, charge: Charge, closest: NarrowPlace | None) -> Plan:
    """Return the constants of a run, as :func:`ppmc.solver.run.setup.prepare` chooses them.

    `closest` is the narrowest place between tools that move against each other, at the end.
    """
    speed, direction = closing_motion(tools, settings.end_time)
    step = float(np.linalg.norm(charge.spacing * direction))
    thickness = charge.sheet[0] if charge.sheet else float(np.ptp(charge.corners @ direction)) + step
    rate, bulk, density = run_constants(settings, material, speed, thickness)
    final_rate = rate if closest is None else max(rate, speed / closest.width)
    squeezed, layers = charge.sheet or (thickness, round(thickness / step))
    compression = 1.0 if closest is None else max(1.0, squeezed / closest.width)
    return Plan(speed, thickness, layers, compression, rate, final_rate, bulk, density)


def explicit_steps(material: Material, control: Any, plan: Plan, spacing: float) -> tuple[float, float, float]:
    """Return the stable steps, s, of the explicit integrator: viscous, acoustic, and the one that it would take."""
    found = material.reference(plan.rate)
    own = SHEAR_SHARE * found.shear + AXIAL_SHARE * axial_viscosity(found.ratio, found.shear)
    bonds = (control.bond * (found.ratio + 2.0) ** (5.0 / 6.0) + control.smooth_flow) * found.shear
    mixed = math.hypot(own, BOND_SHARE * bonds)
    viscous = plan.density * spacing**2 / (2.0 * mixed)
    acoustic = spacing * math.sqrt(plan.density / plan.bulk_modulus)
    return viscous, acoustic, SAFETY / (1.0 / viscous + 1.0 / acoustic)


def implicit_steps(settings: Any, plan: Plan) -> int:
    """Return about how many implicit steps an even flow takes."""
    outputs = event_times(
        settings.end_time, settings.output_interval or settings.end_time / 20.0, settings.output_times or ()
    )
    strain = STRAIN_PER_CLOSURE * math.log(plan.compression)
    per_step = min(settings.max_strain_increment, 4.0 * settings.max_displacement)
    longest = settings.max_time_step or math.inf
    return max(len(outputs), math.ceil(strain / per_step), math.ceil(settings.end_time / longest))


def implicit_work(
    settings: Any, material: Material, plan: Plan, charge: Charge, unlike: bool, fills: bool
) -> tuple[int, int]:
    """Return about how many implicit steps, and iterations in all, a run takes.

    Parameters
    ----------
    settings : section `solver` of the scene
    material : Material
    plan : Plan
    charge : Charge
    unlike : bool
        Whether neighbours have fibres of different directions.
    fills : bool
        Whether the charge fills a closed cavity and does more than close evenly.
    """
    even = implicit_steps(settings, plan)
    factor, iterations = 1.0, ITERATIONS_EVEN
    if unlike:
        factor, iterations = max(material.ratio, 1.0) ** UNLIKE_POWER, ITERATIONS_UNLIKE
    if fills:
        factor *= FILLING
    if charge.sheet is not None:
        factor, iterations = factor * SHEET, ITERATIONS_SHEET
    steps = round(even * factor)
    return steps, round(steps * iterations)


def narrow_places(
    tools: ToolSet, charge: Charge, end: float
) -> tuple[NarrowPlace | None, NarrowPlace | None, float | None]:
    """Return the narrowest places at the end: between tools that move against each other, and between those at rest.

    Each is None where there is none, or no space is left free. Widths are met to about 1/25 of the cavity. The third
    is the share of the closed cavity that the charge takes, None where it is open.
    """
    at = [np.linspace(a, b, 9) for a, b in zip(charge.low, charge.high, strict=True)]
    seeds = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 3)
    try:
        # Two spacings will do for where to look, at an eighth of the cells.
        cavity = cavity_volume(tools, seeds, end, spacing=2.0 * float(np.cbrt(np.prod(charge.spacing))))
    except SceneError:
        return None, None, None
    share = charge.count * float(np.prod(charge.spacing)) / cavity.volume if cavity.closed else None
    low, high = cavity.bounds if cavity.closed else (charge.low, charge.high)
    at = [np.linspace(a, b, SAMPLES) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 3)
    phi, normals = tools.distances(points, end)
    free = np.flatnonzero(phi.min(axis=0) > 0.0)
    if len(free) == 0:
        return None, None, share
    phi, normals = phi[:, free], normals[:, free]
    nearest, k = np.argmin(phi, axis=0), np.arange(len(free))
    opposed = np.einsum("tnc,nc->tn", normals, normals[nearest, k]) < OPPOSED
    moved = tools.offsets(end)
    way = moved[:, None] - moved[nearest][None]
    size = np.linalg.norm(way, axis=2)
    against = size > 1e-9
    # A clearance along which tools slide does not close, and the charge does not enter one below a spacing.
    closing = against & (np.abs(np.einsum("tnc,tnc->tn", way, normals)) > ALONG * size)
    widths = phi + phi[nearest, k]
    entered = widths > 1.05 * float(np.cbrt(np.prod(charge.spacing)))
    found = []
    for chosen in (opposed & closing, opposed & ~against & entered):
        width = np.where(chosen, widths, math.inf)
        tool, where = np.unravel_index(int(np.argmin(width)), width.shape)
        names = tools.names[int(nearest[where])], tools.names[int(tool)]
        least = float(width[tool, where])
        found.append(NarrowPlace(*names, least) if math.isfinite(least) else None)
    return found[0], found[1], share
