"""What a run is made of, and what each of its steps reports."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ppmc.materials import Material
from ppmc.solver.walls.tools import Walls


@dataclass(frozen=True)
class Place:
    """A particle and where it is: number in the charge, -1 for none, and x1, x2, x3, mm."""

    particle: int = -1
    position: tuple[float, float, float] = (float("nan"), float("nan"), float("nan"))


NOWHERE = Place()


@dataclass(frozen=True)
class Touched:
    """Faces that touch at the end of a solve.

    Attributes
    ----------
    tool : ndarray, shape (m,), int32
    normal : ndarray, shape (m, 3)
        Unit normals out of the tools.
    area : ndarray, shape (m,)
        Area of the charge that lies at each, mm^2.
    """

    tool: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    normal: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    area: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass
class StepReport:
    """What one step did; every number but `parts` goes into the history, of `touched` what covers each tool."""

    time_step: float = 0.0
    iterations: int = 0
    passes: int = 0
    estimated_error: float = 0.0
    unconverged: int = 0
    contacts: int = 0
    penetration: float = 0.0
    deepest: Place = NOWHERE
    dissipation: float = 0.0
    zero_energy_share: float = 0.0
    driven_share: float = 1.0  # of the dissipation; what is left comes from the correction of packing
    tool_force: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    tool_moment: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    touched: Touched = field(default_factory=Touched)
    parts: int = 1  # into which the step is to be divided, with nothing advanced, if more than one

    def add_work_of(self, other: "StepReport") -> None:
        """Count in what another solve took: parts of a step are reported as one."""
        self.iterations += other.iterations
        self.passes += other.passes
        self.unconverged += other.unconverged
        if other.penetration > self.penetration:
            self.penetration, self.deepest = other.penetration, other.deepest


@dataclass
class Model:
    """Constants of a run.

    Attributes
    ----------
    settings : section `solver` of the scene
    material : Material
        The section `material` of the scene, or one's own.
    walls : Walls
    smoothing_length : float
        h, mm.
    bulk_modulus : float
        K, Pa.
    density : float
        Scaled density, g/mm^3; zero leaves inertia out.
    """

    settings: Any
    material: Material
    walls: Walls
    smoothing_length: float
    bulk_modulus: float
    density: float

    @property
    def spacing(self) -> float:
        """Mean particle spacing, mm."""
        return float(np.cbrt(np.prod(self.walls.spacing)))
