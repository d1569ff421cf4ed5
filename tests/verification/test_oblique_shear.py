r"""Plates that slide over a charge of oblique fibres: simple shear, as exact as the walls.

Between infinite plates a distance H apart, with the velocity V along x1 and fibres p, the flow is a simple shear with
:math:`C_t\dot\gamma = \tau`, :math:`\dot\gamma H + 2\tau/\lambda_f = (V, 0)` (Navier friction on both; none without
slip), with :math:`C_t = \eta_{23} I + 4\eta_{23}(R-1)(p\cdot n)^2\,Pp\otimes Pp`. The charge ends freely, so its
middle is compared. Slip walls across x2 hold what lies in the plane of x1 and x3 there: with friction, fibres would
rather draw the charge together along x1 than be stretched.
"""

import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.explicit import ExplicitIntegrator
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.walls.tools import Walls
from ppmc.walls import NavierFriction
from tests.solver.blocks import lattice

RATIO, SPEED, AIR = 1000.0, 6.0, 1e6


def sheared_charge(
    shape: tuple[int, int, int], fibre: tuple[float, float, float], wall: object, sides: bool = True,
    explicit: bool = False, ratio: float = RATIO,
) -> ImplicitIntegrator:  # fmt: skip
    """Block of unit spacing under a plate that slides along x1; eta23 = 1 Pa s; slip walls across x2, if wanted."""
    height = float(shape[2])
    planes = {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1), wall=wall),
        "top": PlaneTool(
            shape="plane", point=(0, 0, height), normal=(0, 0, -1), wall=wall, motion={"velocity": (SPEED, 0, 0)}
        ),
    }
    if sides:
        planes["left"] = PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 1, 0))
        planes["right"] = PlaneTool(shape="plane", point=(0, float(shape[1]), 0), normal=(0, -1, 0))
    walls, positions = Walls(compile_tools(planes), np.ones(3)), lattice(shape)
    inertia = {"integrator": "explicit", "reynolds_number": 1e-3} if explicit else {}
    section = SolverSection(end_time=1.0, ambient_pressure=AIR, **inertia)
    material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=ratio)
    p = np.array(fibre) / np.linalg.norm(fibre)
    q = np.cross(p, [0.31, 0.93, 0.2])
    n = len(positions)
    state = ParticleState.at_rest(
        positions, np.ones(n), np.tile(p, (n, 1)), np.tile(q / np.linalg.norm(q), (n, 1)),
        walls.starting_half_widths(positions),
    )  # fmt: skip
    kind = ExplicitIntegrator if explicit else ImplicitIntegrator
    density = 1e-3 * (ratio + 2.0) / SPEED / height if explicit else 0.0
    return kind(Model(section, material, walls, section.smoothing_ratio, 1000.0 * (ratio + 10.0), density), state)


def exact(fibre: tuple[float, float, float], height: float, slip_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Shear rates (2,), 1/s, and tractions (2,), Pa, along x1 and x2."""
    p = np.array(fibre) / np.linalg.norm(fibre)
    layer = np.eye(2) + 4.0 * (RATIO - 1.0) * p[2] ** 2 * np.outer(p[:2], p[:2])
    rate = np.linalg.solve(height * np.eye(2) + 2.0 * slip_length * layer, [SPEED, 0.0])
    return rate, layer @ rate


def middle(integrator: ImplicitIntegrator, half: float = 3.0) -> np.ndarray:
    """Particles within `half` (mm) of the middle, away from free ends and sides."""
    x = integrator.state.reference_position
    centre = 0.5 * (x.min(axis=0) + x.max(axis=0))
    return (np.abs(x - centre)[:, :2] < half).all(axis=1)


@pytest.mark.parametrize(
    ("fibre", "wall", "slip_length"),
    [
        ((1.0, 0.0, 3**0.5), "no_slip", 0.0),
        ((0.0, 0.0, 1.0), "no_slip", 0.0),
        ((-1.0, 0.0, 2.0), "no_slip", 0.0),
        ((1.0, 0.0, 3**0.5), NavierFriction(friction=300.0), 1.0 / 300.0),
        ((0.0, 0.0, 1.0), NavierFriction(friction=0.5), 2.0),
    ],
)
def test_shear_in_the_fibres_plane(fibre, wall, slip_length):
    integrator = sheared_charge((48, 3, 6), fibre, wall)
    report = integrator.initialise(0.0, 1e-3)
    rate, traction = exact(fibre, 6.0, slip_length)
    inside = middle(integrator)
    found = integrator.state.velocity_gradient[inside, 0, 2].mean()
    assert found == pytest.approx(rate[0], rel=0.05)
    force, area = -report.tool_force[1, 0], 48.0 * 3.0
    # Fibres that end in the free ends carry nothing there: what is missing is a column as wide as they lean.
    ends = abs(fibre[0] / fibre[2]) * 6.0 / 48.0
    assert traction[0] * area * (0.97 - 1.3 * ends) < force < 1.03 * traction[0] * area
    heat = SPEED * force
    assert report.dissipation == pytest.approx(heat, rel=0.03)


@pytest.mark.parametrize("fibre", [(1.0, 0.0, 3**0.5), (0.0, 0.0, 1.0), (1.0, 1.0, 1.4)])
def test_forces_and_moments_of_the_tools_cancel(fibre):
    report = sheared_charge((24, 4, 4), fibre, "no_slip", sides=False).initialise(0.0, 1e-3)
    force = -report.tool_force[1, 0]
    assert force > 24.0 * 4.0  # of the matrix alone
    assert np.abs(report.tool_force.sum(axis=0)).max() < 2e-3 * force
    # At the faces of the tools instead of the centres of wall layers a couple of a quarter of this would be missing.
    assert np.abs(report.tool_moment.sum(axis=0)).max() < 1e-2 * force * 4.0


def test_shear_along_which_fibres_lie_is_that_of_the_matrix():
    integrator = sheared_charge((36, 3, 6), (1.0, 0.0, 0.0), "no_slip")
    report = integrator.initialise(0.0, 1e-3)
    assert integrator.state.velocity_gradient[middle(integrator), 0, 2].mean() == pytest.approx(1.0, rel=0.03)
    assert -report.tool_force[1, 0] == pytest.approx(36.0 * 3.0, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("wall", ["no_slip", NavierFriction(friction=2000.0)])
def test_shear_out_of_the_fibres_plane(wall):
    fibre = (1.0, 1.0, 1.4)
    integrator = sheared_charge((36, 36, 6), fibre, wall, sides=False)
    integrator.initialise(0.0, 1e-3)
    rate, _ = exact(fibre, 6.0, 0.0 if wall == "no_slip" else 1.0 / wall.friction)
    found = integrator.state.velocity_gradient[middle(integrator)].mean(axis=0)
    np.testing.assert_allclose(found[:2, 2], rate, atol=0.05 * abs(rate[0]))


@pytest.mark.slow
def test_explicit_integrator_shears_alike():
    fibre, ratio = (1.0, 0.0, 3**0.5), 30.0
    implicit = sheared_charge((36, 3, 6), fibre, "no_slip", ratio=ratio)
    implicit.initialise(0.0, 1e-3)
    settled = implicit.step(0.0, 0.02)
    explicit = sheared_charge((36, 3, 6), fibre, "no_slip", explicit=True, ratio=ratio)
    explicit.initialise(0.0, 1e-3)
    for k in range(4):
        report = explicit.step(0.005 * k, 0.005)
    inside = middle(explicit)
    assert explicit.state.velocity_gradient[inside, 0, 2].mean() == pytest.approx(1.0, rel=0.05)
    assert report.tool_force[1, 0] == pytest.approx(settled.tool_force[1, 0], rel=0.05)
    assert report.dissipation == pytest.approx(-SPEED * report.tool_force[1, 0], rel=0.05)
