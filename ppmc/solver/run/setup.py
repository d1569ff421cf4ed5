"""From scene and charge to a model and an undeformed state, with the checks that catch impossible inputs."""

import math
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ppmc.errors import SceneError
from ppmc.files import ParticleFile
from ppmc.geometry.cavity.charge_balance import charge_balance
from ppmc.geometry.tools.checks import check_tools_apart
from ppmc.geometry.tools.toolset import ToolSet, compile_tools
from ppmc.materials import Material
from ppmc.notices import tell
from ppmc.scene import Scene
from ppmc.solver.particles.kernel_shape import lattice_of
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.model import Model
from ppmc.solver.walls.tools import Walls

# Radius of the columns in which the height of the charge is taken, in spacings: between the distances of lattices, so
# that no rounding decides what is in; and how many are looked at.
COLUMN, COLUMNS = 0.8, 4096
# The pressure that turns a charge into a flange is three to four times (R + TURNING) eta23 x closing rate from R = 1 to
# 1000. With R + 2, as in a squeeze, it is eleven times that at R = 1 and shrinks the charge by a quarter of a per cent.
TURNING = 10.0
INSIDE_LIMIT = 0.25  # of a spacing: how deep a particle may start inside a tool before the scene is taken for wrong


def prepare(scene: Scene, charge: ParticleFile) -> tuple[Model, ParticleState]:
    """Make the model and the particles at time zero.

    Parameters
    ----------
    scene : Scene
        With sections `tooling`, `material` and `solver`.
    charge : ParticleFile
        Particles with frames and volumes; `extra` may hold the lattice spacing.

    Raises
    ------
    SceneError
        If a section is missing, or the charge lies inside a tool.
    """
    tools = compile_tools(scene.require("tooling"), scene.directory)
    settings, material = scene.require("solver"), scene.require("material")
    spacing = spacing_of(charge)
    walls = Walls(tools, spacing)
    _check_outside(charge.positions, tools, float(spacing.min()))
    state = ParticleState.at_rest(
        charge.positions, charge.fields["volume"], charge.fields["fibre_direction"],
        charge.fields["in_plane_direction"], walls.starting_half_widths(charge.positions), charge.fields["platelet_id"],
        lattice_of(spacing),
    )  # fmt: skip
    margin = 0.5 * spacing
    check_tools_apart(
        tools, charge.positions.min(axis=0) - margin, charge.positions.max(axis=0) + margin, settings.end_time
    )
    speed, direction = closing_motion(tools, settings.end_time)
    thickness = column_height(charge.positions, direction, spacing)
    _, bulk, density = run_constants(settings, material, speed, thickness)
    length = settings.smoothing_ratio * float(np.cbrt(np.prod(spacing)))
    return Model(settings, material, walls, length, bulk, density), state


def check_room(model: Model, charge: ParticleFile, source: str) -> None:
    """Compare the charge, which came from `source`, with the cavity at the end, and say so if they differ.

    Raises
    ------
    SceneError
        If the charge is far too large and the scene gives no bulk modulus: no tool can press that away; or if tools
        overlap at the edge of the cavity.
    """
    settings = model.settings
    volume = float(charge.fields["volume"].sum())
    spacing = float(np.cbrt(np.prod(model.walls.spacing)))
    balance = charge_balance(model.walls.tools, charge.positions, settings.end_time, volume, spacing)
    balance.check_room(settings.bulk_modulus, source)
    if balance.off:
        tell(balance.told)


def run_constants(settings: Any, material: Material, speed: float, thickness: float) -> tuple[float, float, float]:
    """Closing strain rate (1/s), bulk modulus (Pa) and scaled density (g/mm^3) that a run takes.

    Parameters
    ----------
    settings : section `solver` of the scene
    material : Material
    speed, thickness : float
        Of the fastest tool, mm/s, and of the charge along it, mm.
    """
    rate = settings.strain_rate or (speed / thickness if speed > 0.0 else 1.0)
    reference = material.reference(rate)
    turning_viscosity = (reference.ratio + TURNING) * reference.shear
    bulk = settings.bulk_modulus or settings.bulk_ratio * turning_viscosity * rate
    density = settings.density or 0.0
    if settings.density is None and settings.reynolds_number > 0.0:
        density = settings.reynolds_number * reference.squeeze / (max(speed, rate * thickness) * thickness)
    return rate, bulk, density


def closing_motion(tools: ToolSet, end: float) -> tuple[float, np.ndarray]:
    """Largest speed of a tool, mm/s, and its direction, shape (3,)."""
    speed, direction, time = 0.0, np.array([0.0, 0.0, 1.0]), 0.0
    while time < end:
        for velocity in tools.velocities(time):
            if np.linalg.norm(velocity) > speed:
                speed = float(np.linalg.norm(velocity))
                direction = velocity / speed
        time = tools.next_break(time)
    for forced in tools.motions.forced:
        if forced.max_speed > speed:
            speed, direction = forced.max_speed, forced.direction
    return speed, direction


def column_height(positions: np.ndarray, direction: np.ndarray, spacing: np.ndarray) -> float:
    """Typical height of the charge, mm: the median over round columns along `direction` (3,) about its particles.

    The extent of a sheet draped over a tool is that of the tool; its columns are as high as the sheet is thick.
    """
    step = float(np.linalg.norm(direction * spacing))
    along = positions @ direction
    across = positions @ np.linalg.svd(direction[None])[2][1:].T  # along two directions normal to it
    middles = across[:: math.ceil(len(across) / COLUMNS)]
    columns = cKDTree(across).query_ball_point(middles, COLUMN * float(spacing.max()))
    return float(np.median([np.ptp(along[column]) for column in columns]) + step)


def spacing_of(charge: ParticleFile) -> np.ndarray:
    """Spacing of a charge's lattice, mm, shape (3,)."""
    given = charge.extra.get("spacing")
    if given is not None:
        return np.broadcast_to(np.asarray(given, dtype=np.float64), (3,)).copy()
    # A charge from elsewhere: cubes of the mean volume.
    return np.full(3, float(np.cbrt(charge.fields["volume"].mean())))


def _check_outside(positions: np.ndarray, tools: ToolSet, spacing: float) -> None:
    phi, _ = tools.distances(positions)
    deepest = phi.min(axis=1)
    for k in np.flatnonzero(deepest < -INSIDE_LIMIT * spacing):
        count = int(np.sum(phi[k] < -INSIDE_LIMIT * spacing))
        worst: Any = positions[int(np.argmin(phi[k]))].round(3).tolist()
        raise SceneError(
            f"tooling.{tools.names[k]}: {count} particles of the charge start inside this tool, the worst at {worst}"
            f" mm, {-deepest[k]:.3g} mm deep; move the tool or the charge"
        )
