"""What `ppmc check` says about a flow simulation before it runs: tools, stiffness, inertia, cost, the exact answer."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ppmc.errors import SceneError
from ppmc.geometry.tools.checks import SAMPLES_ALONG, check_tools_apart, idle_tools
from ppmc.geometry.tools.toolset import ToolSet, compile_tools
from ppmc.materials import Material
from ppmc.materials.relations import axial_viscosity
from ppmc.scene.sections.charge import UniformOrientation
from ppmc.solver.forecast.estimates import (
    FULL,
    Charge,
    NarrowPlace,
    Plan,
    describe_charge,
    explicit_steps,
    implicit_work,
    make_plan,
    narrow_places,
)
from ppmc.solver.forecast.homogeneous import Squeeze, homogeneous_squeeze
from ppmc.solver.forecast.machine_speed import relative_speed
from ppmc.solver.step.spread import ENOUGH_LAYERS

if TYPE_CHECKING:
    from ppmc.scene import Scene

# Measured (docs/benchmarks/solver.md): most bytes a particle held at once, particle-steps a core-second of an explicit
# step and of one iteration of the implicit solve, all else of a step included.
BYTES_PER_PARTICLE = {"explicit": 1900, "implicit": 2400}
EXPLICIT_STEPS_PER_SECOND = 0.45e6
ITERATIONS_PER_SECOND = 0.66e6
LEAST_BULK_RATIO = 33.0  # K over eta11 x rate for 1 % of volume error (docs/theory.md, from A5)
MOST_REYNOLDS = 0.01  # J, section III.B
UNSCALED_DENSITY = 1.6e-3  # g/mm^3; J10 counts powers of ten from 1.6
FEW_SPACINGS = 3.0
# What a no-slip squeeze of a Newtonian disk lacks in force with so many layers (docs/theory.md), in per cent.
STICKING_ERROR = {2: 23, 3: 17, 4: 11}


def findings(scene: Scene) -> list[str]:
    """Return lines on the sections ``tooling``, ``material`` and ``solver``; nothing is run or written.

    Raises
    ------
    SceneError
        If a section is missing, tools pass through each other, or the charge is a single layer of particles.
    InputFileError
        If a tool's file is no closed surface.
    """
    settings, material = scene.require("solver"), scene.require("material")
    tools = compile_tools(scene.require("tooling"), scene.directory)
    if scene.charge is None:
        return ["no section charge: stiffness, steps and cost depend on the charge's size and are not known"]
    charge = describe_charge(scene.charge, scene, tools)
    check_tools_apart(tools, charge.low, charge.high, settings.end_time)
    closing, fixed, share = narrow_places(tools, charge, settings.end_time)
    plan = make_plan(settings, material, tools, charge, closing)
    exact = homogeneous_squeeze(scene, tools)
    few = _few_layers(plan, charge, tools)
    axes = [np.linspace(a, b, SAMPLES_ALONG) for a, b in zip(charge.low, charge.high, strict=True)]
    box = np.array(np.meshgrid(*axes, indexing="ij")).reshape(3, -1).T
    idle = idle_tools(tools, box, float(np.max(charge.spacing)), settings.end_time)
    lines = [*idle, _closure(plan, idle), *few, _stiffness(plan, material)]
    if plan.density > 0.0:
        lines.append(_inertia(plan, material))
    unlike = material.ratio > 1.0 and not isinstance(scene.charge.orientation, UniformOrientation)
    # What closes evenly, as between plates and side walls, meets no mouth.
    fills = (share or 0.0) > FULL and not (exact is not None and exact.even)
    lines += _cost(settings, material, plan, charge, unlike, fills)
    if fixed is not None:
        lines.append(_narrow(fixed, charge))
    return lines + (_exact(exact) if exact is not None else [])


def _closure(plan: Plan, idle: list[str]) -> str:
    """Return how fast the tools close, unless some do not, and how many layers of particles are between them."""
    if plan.speed == 0.0:
        return "no tool moves: nothing drives the flow"
    if idle:
        return f"tools move at {plan.speed:.4g} mm/s, not all to press on the charge; {plan.layers} layers of particles"
    return (
        f"tools close at {plan.speed:.4g} mm/s on {plan.thickness:.4g} mm of charge, {plan.rate:.3g} 1/s at the start; "
        f"{plan.layers} layers of particles"
    )


def _few_layers(plan: Plan, charge: Charge, tools: ToolSet) -> list[str]:
    """Return what is not right with so few layers of particles.

    Raises
    ------
    SceneError
        If the charge is a single layer or row.
    """
    through = [charge.sheet] if charge.sheet else []
    sides = charge.high - charge.low
    through += [(float(side), round(float(side / step))) for side, step in zip(sides, charge.spacing, strict=True)]
    thickness, layers = min(through, key=lambda side: side[1])
    if layers < 2:
        raise SceneError(
            f"charge.spacing: {thickness:.4g} mm of charge are a single layer of particles, across which no strain can"
            f" be seen; take at least {ENOUGH_LAYERS} layers, a spacing of {thickness / ENOUGH_LAYERS:.3g} mm there"
        )
    if plan.layers in STICKING_ERROR and any(tool.wall.rubs for tool in tools.tools):
        return [
            f"{plan.layers} layers of particles do not resolve a flow that sticks to its walls: its force is up to"
            f" {STICKING_ERROR[plan.layers]} % too small; take a finer charge.spacing or charge.layers: 8"
        ]
    if plan.layers == 2:
        return ["2 layers of particles carry no profile: only an even squeeze or shear is right, to 3 %"]
    return []


def _stiffness(plan: Plan, material: Material) -> str:
    """Return K, and what it means for the volume (A5)."""
    reference = material.reference(plan.final_rate)
    axial = axial_viscosity(reference.ratio, reference.shear)
    ratio = plan.bulk_modulus / (axial * plan.final_rate)
    told = (
        f"bulk modulus K = {plan.bulk_modulus:.4g} Pa, {ratio:.3g} x eta11 x closing rate of {plan.final_rate:.3g} 1/s "
        f"at the end: volume errors of about {100.0 / (3.0 * ratio):.2g} %"
    )
    if ratio < LEAST_BULK_RATIO:
        fix = "raise solver.bulk_modulus or give solver.strain_rate"
        return f"{told}; too soft, 1 % needs {LEAST_BULK_RATIO:.0f}: {fix}"
    return told


def _inertia(plan: Plan, material: Material) -> str:
    """Return the scaled density and the Reynolds number (J10, J12)."""
    speed = max(plan.speed, plan.rate * plan.thickness)
    reynolds = plan.density * speed * plan.thickness / material.reference(plan.rate).squeeze
    told = (
        f"density {plan.density:.4g} g/mm^3, {plan.density / UNSCALED_DENSITY:.3g} x unscaled "
        f"(1.6e{math.log10(plan.density / 1.6):+.2f}): Reynolds number {reynolds:.3g}"
    )
    if reynolds > MOST_REYNOLDS * (1.0 + 1e-9):
        return f"{told}; above {MOST_REYNOLDS:g} inertia shows: lower solver.reynolds_number or solver.density"
    return told


def _cost(settings: Any, material: Material, plan: Plan, charge: Charge, unlike: bool, fills: bool) -> list[str]:
    """Return steps, memory and a rough CPU time."""
    if settings.integrator == "explicit":
        viscous, acoustic, used = explicit_steps(
            material, settings.zero_energy, plan, float(np.cbrt(np.prod(charge.spacing)))
        )
        steps = math.ceil(settings.end_time / used)
        told = (
            f"explicit: stable steps {viscous:.3g} s (viscous), {acoustic:.3g} s (acoustic, Courant), "
            f"together {used:.3g} s: about {steps:,} steps"
        )
        work = steps * charge.count / EXPLICIT_STEPS_PER_SECOND
    else:
        steps, iterations = implicit_work(settings, material, plan, charge, unlike, fills)
        told = f"implicit: about {_two_digits(steps):,} steps, {_two_digits(iterations):,} iterations"
        work = iterations * charge.count / ITERATIONS_PER_SECOND
    speed = relative_speed()
    memory = charge.count * BYTES_PER_PARTICLE[settings.integrator] / 2**20
    return [
        f"{told}; roughly {_duration(work / speed / 3600.0)} on one core (within a factor of 3; this one is measured "
        f"to be {speed:.2g} times as fast as that of the benchmarks)",
        f"about {memory:,.0f} MiB beside the program",
    ]


def _two_digits(count: int) -> int:
    """Return a count rounded to the digits that an estimate has."""
    return int(float(f"{count:.2g}"))


def _narrow(place: NarrowPlace, charge: Charge) -> str:
    """Return how many particles fit between two tools that do not close."""
    spacings = place.width / float(np.cbrt(np.prod(charge.spacing)))
    told = f"'{place.first}' and '{place.second}' leave {place.width:.4g} mm, {spacings:.2g} particle spacings"
    return f"{told}: too few for a profile, take a finer charge.spacing" if spacings < FEW_SPACINGS else told


def _duration(hours: float) -> str:
    """Return a time in words."""
    if hours < 1 / 60:
        return f"{3600.0 * hours:.2g} s"
    return f"{60.0 * hours:.2g} min" if hours < 1.0 else f"{hours:.2g} h"


def _exact(exact: Squeeze) -> list[str]:
    """Return the closed-form answer."""
    (begin, first), (end, last) = exact.forces
    stretches = ", ".join(f"{value:.5g} ({name})" for name, value in exact.stretches.items())
    lines = [
        f"homogeneous squeeze of a {exact.kind}: exact stretches at the end {stretches}",
        f"exact press force {first / 1e6:.4g} N at {begin:.4g} s, {last / 1e6:.4g} N at {end:.4g} s",
    ]
    if exact.orientation is not None:
        lines.append("exact A at the end: diagonal " + ", ".join(f"{value:.4g}" for value in exact.orientation))
    return lines
