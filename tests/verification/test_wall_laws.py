r"""Walls whose traction is not in proportion to the sliding, against closed forms.

* A block that a plate drags over another one: Coulomb :math:`T = \mu N`, or sticking where that is more than it takes;
  power law :math:`T = k V^n A`, for a charge too stiff to shear.
* Disk of radius R between plates, closing at V, in plug flow (:math:`v = rV/2h`); with the pressure on the plates q(r),
  :math:`dq/dr = -2\tau/h` and :math:`q(R) = 3\eta V/h`: Coulomb :math:`q = \frac{3\eta V}{h} e^{2\mu(R-r)/h}`, so that
  :math:`F = \frac{3\eta V}{h}\,\frac{\pi h^2}{2\mu^2}\,(e^a - 1 - a)` with :math:`a = 2\mu R/h`; power law
  :math:`F = 3\pi\eta R^2 V/h + \frac{2\pi k}{(n+3)h}\big(\frac{V}{2h}\big)^n R^{n+3}`.
"""

import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.newtonian import Newtonian
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.explicit import ExplicitIntegrator
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.walls.sliding import slip_lengths
from ppmc.solver.walls.tools import Walls
from ppmc.walls import LAWS
from ppmc.walls.coulomb import CoulombFriction
from ppmc.walls.navier import NavierFriction
from ppmc.walls.power_friction import PowerFriction
from tests.solver.blocks import lattice
from tests.verification.test_newtonian_disk import SPEED, slip_force, squeezed_disk


def dragged(wall, closing: float, viscosity: float = 1.0, along: float = 6.0, explicit: bool = False):
    """Block of 10 x 6 x 4 mm that sticks to a plate, which drags it along x1 over another and closes on it, mm/s."""
    shape = (10, 6, 4)
    planes = {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1), wall=wall),
        "top": PlaneTool(
            shape="plane", point=(0, 0, 4), normal=(0, 0, -1), wall="no_slip",
            motion={"velocity": (along, 0, -closing)},
        ),
    }  # fmt: skip
    walls, positions = Walls(compile_tools(planes), np.ones(3)), lattice(shape)
    inertia = {"integrator": "explicit", "reynolds_number": 1e-3} if explicit else {}
    section = SolverSection(end_time=1.0, ambient_pressure=1e7, **inertia)
    n = len(positions)
    p, q = np.tile([1.0, 0.0, 0.0], (n, 1)), np.tile([0.0, 1.0, 0.0], (n, 1))
    state = ParticleState.at_rest(positions, np.ones(n), p, q, walls.starting_half_widths(positions))
    kind = ExplicitIntegrator if explicit else ImplicitIntegrator
    density = 1e-3 * viscosity / along if explicit else 0.0
    model = Model(
        section, Newtonian(shear_viscosity=viscosity), walls, section.smoothing_ratio, 1e4 * viscosity, density
    )
    return kind(model, state)


def run(integrator, steps: int, time_step: float):
    report = integrator.initialise(0.0, time_step)
    for k in range(steps):
        report = integrator.step(k * time_step, time_step)
        assert report.unconverged == 0
    return report


@pytest.mark.parametrize("coefficient", [0.1, 0.3])
def test_block_slides_with_coulomb_friction(coefficient):
    report = run(dragged(CoulombFriction(coefficient=coefficient), closing=0.3), 6, 5e-3)
    tangential, normal = report.tool_force[0, 0], -report.tool_force[0, 2]
    assert tangential == pytest.approx(coefficient * normal, rel=0.005)


def test_block_sticks_below_the_limit():
    stuck = run(dragged("no_slip", closing=0.3, along=0.05), 4, 5e-3)
    report = run(dragged(CoulombFriction(coefficient=10.0), closing=0.3, along=0.05), 4, 5e-3)
    np.testing.assert_allclose(report.tool_force, stuck.tool_force, atol=0.02 * np.abs(stuck.tool_force).max())


@pytest.mark.parametrize("exponent", [0.4, 1.0, 1.5])
def test_stiff_block_on_a_thinning_film(exponent):
    wall = PowerFriction(reference_traction=2.0, reference_speed=3.0, exponent=exponent)
    report = run(dragged(wall, closing=0.0, viscosity=1e4), 1, 1e-3)
    assert report.tool_force[0, 0] == pytest.approx(2.0 * 2.0**exponent * 60.0, rel=0.005)


def test_power_law_with_exponent_one_is_navier():
    found = [
        run(dragged(wall, closing=0.3), 2, 5e-3).tool_force
        for wall in (
            NavierFriction(friction=0.5), PowerFriction(reference_traction=1.5, reference_speed=3.0, exponent=1.0)
        )
    ]  # fmt: skip
    np.testing.assert_allclose(*found, atol=1e-3 * np.abs(found).max())


FILM = PowerFriction(reference_traction=2.0, reference_speed=3.0, exponent=0.4)


@pytest.mark.parametrize("wall", [CoulombFriction(coefficient=0.3), pytest.param(FILM, marks=pytest.mark.slow)])
def test_explicit_integrator_finds_the_same_friction(wall):
    implicit = run(dragged(wall, closing=0.3), 4, 2e-3)
    explicit = run(dragged(wall, closing=0.3, explicit=True), 4, 2e-3)
    np.testing.assert_allclose(explicit.tool_force, implicit.tool_force, atol=0.05 * np.abs(implicit.tool_force).max())


@pytest.mark.parametrize("coefficient", [pytest.param(0.05, marks=pytest.mark.slow), 0.15])
def test_disk_with_coulomb_friction(coefficient):
    force, radius, height = squeezed_disk(CoulombFriction(coefficient=coefficient), layers=4)
    a = 2.0 * coefficient * radius / height
    exact = slip_force(radius, height) * 2.0 * (np.exp(a) - 1.0 - a) / a**2
    assert force == pytest.approx(exact, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [0.3, 0.7])
def test_disk_with_power_law_friction(exponent):
    k = 0.02
    wall = PowerFriction(reference_traction=k, reference_speed=1.0, exponent=exponent)
    force, radius, height = squeezed_disk(wall, layers=4)
    plug = SPEED / (2.0 * height)
    added = 2.0 * np.pi * k / ((exponent + 3.0) * height) * plug**exponent * radius ** (exponent + 3.0)
    assert force == pytest.approx(slip_force(radius, height) + added, rel=0.03)


@pytest.mark.parametrize("law", sorted(set(LAWS) - {"slip", "no_slip"}))
def test_half_cell_and_law_agree(law):
    """The one slip length at which a half-cell of any stiffness passes on what the law allows."""
    wall = {
        "navier": LAWS["navier"](friction=0.7), "coulomb": CoulombFriction(coefficient=0.3),
        "power_law": PowerFriction(reference_traction=2.0, reference_speed=0.5, exponent=0.4),
    }[law]  # fmt: skip
    rng = np.random.default_rng(0)
    m = 300
    stiffness = np.column_stack([np.zeros(m), 10.0 ** rng.uniform(-2.0, 3.0, (m, 2))])
    slide, pressure = rng.normal(size=(m, 3)), 10.0 ** rng.uniform(-2.0, 2.0, m)
    slip = slip_lengths(wall, stiffness, slide, pressure)
    held = np.linalg.norm(stiffness * slide, axis=1)
    stuck = slip == 0.0
    assert (held[stuck] <= wall.traction(np.zeros(m), pressure)[stuck]).all()
    assert stuck.any() == (law == "coulomb") and not stuck.all()
    traction = np.linalg.norm(stiffness * slide / (1.0 + slip[:, None] * stiffness), axis=1)
    np.testing.assert_allclose(traction[~stuck], wall.traction(slip * traction, pressure)[~stuck], rtol=1e-9)
