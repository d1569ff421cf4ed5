"""The section ``solver``: time, accuracy and output of the flow simulation."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from ppmc.scene.base import Section
from ppmc.scene.units import (
    NonNegativePressure,
    PositiveDensity,
    PositivePressure,
    PositiveStrainRate,
    PositiveTime,
)

MOST_FRAMES = 100_000


class ZeroEnergyControl(Section):
    """Stiffness of modes that averaged gradients do not see, in units of the material's own."""

    isotropic: float = Field(default=1.0, ge=0)
    """Share of the shear viscosity."""
    bond: float = Field(default=2.0, ge=0)
    """Along the line between two particles, in units of (R + 2)^(5/6) eta23."""
    smooth_flow: float = Field(default=40.0, ge=0)
    """More of the same where the flow is smooth over a kernel, in units of eta23: there it can only meet noise."""
    fibre: float = Field(default=0.1, ge=0)
    """Share of the fibre stiffness, along the fibre."""


class SolverSection(Section):
    """How the flow is computed. Only `end_time` must be given."""

    end_time: PositiveTime = Field(examples=["1 s"])
    """Time at which the run ends, s."""
    output_interval: PositiveTime | None = Field(default=None, examples=["0.1 s"])
    """Time between frames, s, hit exactly; a twentieth of `end_time` if left out."""
    output_times: tuple[PositiveTime, ...] | None = Field(default=None, examples=[["0.5 s", "1 s"]])
    """Further times, s, that are hit exactly and written."""
    integrator: Literal["implicit", "explicit"] = "implicit"
    """`implicit` solves for the velocity each step; `explicit` is the papers' route, with mass scaling."""

    operator: Literal["particles", "grid"] = "particles"
    """What finds the velocities: `particles` (averaged gradients, unlike platelets within a kernel tie each other) or
    `grid` (triquadratic cells two spacings wide, in which they slide; implicit and without inertia only)."""

    max_strain_increment: float = Field(default=0.02, gt=0, le=0.2)
    """Largest strain in a step (99th percentile over the particles)."""
    max_displacement: float = Field(default=0.25, gt=0, le=1)
    """Largest displacement relative to the nearest tool or neighbourhood in a step, in particle spacings."""
    max_time_step: PositiveTime | None = Field(default=None, examples=["5 ms"])
    """Upper bound of the step, s."""

    smoothing_ratio: float = Field(default=1.3, ge=1.0, le=2.0)
    """Smoothing length over particle spacing; the support is twice the smoothing length."""
    kernel_shape: Literal["sphere", "affine"] = "affine"
    """`affine` lets the support follow the local lattice, which large stretches need; `sphere` saves a little time."""
    kernel_aspect_limit: float = Field(default=4.0, ge=1)
    """Largest ratio of the axes of an affine support, as long as it reaches its neighbours along the longest."""
    zero_energy: ZeroEnergyControl = Field(default_factory=ZeroEnergyControl)
    """Control of particle-to-particle modes."""

    volume_correction: float = Field(default=20.0, ge=0)
    """Rate, for a unit of strain, at which J follows the packing; 0 turns it off."""

    bulk_modulus: PositivePressure | None = Field(default=None, examples=["1.31 GPa"])
    """K that keeps the volume, Pa; `bulk_ratio` decides if left out."""
    bulk_ratio: float = Field(default=4000.0, gt=0)
    """K over ((R + 10) eta23 x closing strain rate): the pressure in a charge that turns into a flange is a few times
    that stress."""
    reynolds_number: float = Field(default=0.0, ge=0, le=0.1)
    """Reynolds number of scaled inertia, rho v h / ((R + 2) eta23); 0 leaves inertia out (implicit integrator only)."""
    density: PositiveDensity | None = Field(default=None, examples=["16 g/mm^3"])
    """Mass-scaled density, g/mm^3, in place of `reynolds_number`."""
    strain_rate: PositiveStrainRate | None = Field(default=None, examples=["1 1/s"])
    """Closing strain rate used by `bulk_ratio`, 1/s; estimated from the tools and the charge if left out."""

    velocity_tolerance: float = Field(default=5e-4, gt=0, lt=0.1)
    """Estimated relative error of the velocity at which an implicit solve stops."""
    power_tolerance: float = Field(default=1e-2, gt=0)
    """Estimated relative error of the dissipation at which an implicit solve stops: that of the tools' forces."""
    max_iterations: int = Field(default=4000, gt=0)
    """Iterations after which an implicit solve gives up and says so."""
    coarse_level: bool = True
    """Speed up solves with a coarse grid in the preconditioner."""
    contact_passes: int = Field(default=3, ge=1, le=20)
    """Times a step may revise which particles touch which tool."""
    ambient_pressure: NonNegativePressure = Field(default=0.0, examples=["0.1 MPa"])
    """Pull, Pa, at which the charge leaves a tool: the pressure of the air, where none gets in between; 0 in vacuum."""

    transport_normals: bool = True
    """Convect q-hat and write the platelet normal; off saves a little time where only fibres matter."""
    shape_factor: float = Field(default=1.0, gt=0, le=1)
    """Jeffery shape factor xi of the fibres; 1 is the affine motion of long fibres."""
    checkpoint_interval: PositiveTime = Field(default=300.0, examples=["5 min"])
    """Wall-clock time between checkpoints, s."""
    nan_check_interval: int = Field(default=1, ge=1, le=50)
    """Steps between checks for values that are not finite."""

    @model_validator(mode="after")
    def _consistent(self) -> SolverSection:
        if self.output_interval is not None and self.output_interval > self.end_time:
            raise ValueError(f"`output_interval` {self.output_interval:g} s is beyond `end_time` {self.end_time:g} s")
        if self.output_times is not None and max(self.output_times) > self.end_time:
            raise ValueError(
                f"output time {max(self.output_times):g} s cannot be reached: `end_time` is {self.end_time:g} s"
            )
        frames = self.end_time / (self.output_interval or self.end_time)
        if frames > MOST_FRAMES:
            raise ValueError(
                f"`output_interval` of {self.output_interval:.3g} s asks for {frames:.3g} frames up to "
                f"{self.end_time:.3g} s; at most {MOST_FRAMES:,}"
            )
        if self.integrator == "explicit" and self.reynolds_number == 0.0 and self.density is None:
            raise ValueError(
                "the explicit integrator needs inertia: give `reynolds_number` (0.01 or less) or `density`"
            )
        inertial = self.reynolds_number > 0.0 or bool(self.density)
        if self.operator == "grid" and (self.integrator == "explicit" or inertial):
            raise ValueError(
                "the operator `grid` knows no inertia: leave out `integrator: explicit`, `reynolds_number`, `density`"
            )
        return self
