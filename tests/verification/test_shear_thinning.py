r"""Shear thinning against closed forms.

* Even squeezes between slip plates. With the dissipation :math:`f\eta_{23}\dot\varepsilon^2` the effective rate is
  :math:`\sqrt f\dot\varepsilon` everywhere, so that :math:`-\sigma_{33} = f\,\eta_{23}(\sqrt f\dot\varepsilon)\,
  \dot\varepsilon` and stretches are those without thinning: f = 3 for a fluid (power law: :math:`3^{(n+1)/2} m
  \dot\varepsilon^n`), 4 - 1/R for collimated fibres.
* Plane channel without slip, power law, mean speed U: :math:`u = U\frac{2n+1}{n+1}[1 - |2z/H|^{1+1/n}]`.
* Disk between plates without slip (Scott): :math:`F = \frac{2\pi m}{n+3}\big[\frac{(2n+1)V}{n}\big]^n
  \frac{R^{n+3}}{h^{2n+1}}`.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.by_region import ByRegion
from ppmc.materials.carreau_yasuda import CarreauYasuda
from ppmc.materials.newtonian import Newtonian
from ppmc.materials.power_law import PowerLaw
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.explicit import ExplicitIntegrator
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.walls.tools import Walls
from ppmc.walls import NoSlip
from tests.solver.blocks import lattice
from tests.solver.scenes import make_squeeze, run_to_end, squeeze
from tests.verification.test_newtonian_disk import SPEED, squeezed_disk
from tests.verification.test_oblique_shear import SPEED as SLIDING
from tests.verification.test_oblique_shear import middle, sheared_charge


def power_law(exponent: float, ratio: float = 1.0) -> PowerLaw:
    """With the consistency 1 Pa s^n."""
    return PowerLaw(shear_viscosity=1.0, anisotropy_ratio=ratio, reference_rate=1.0, exponent=exponent)


@pytest.mark.parametrize("exponent", [0.3, 0.6])
def test_disk_between_slip_plates(exponent):
    integrator = make_squeeze((10, 10, 6), material=power_law(exponent))
    state = integrator.state
    state.reorder(np.flatnonzero(np.hypot(state.position[:, 0] - 5.0, state.position[:, 1] - 5.0) < 5.0))
    state.original = np.arange(len(state))
    area = len(state) / 6.0
    result = run_to_end(integrator)
    assert not any(report.unconverged for report in result.reports)
    np.testing.assert_allclose(result.stretch[:, 2, 2].mean(), 0.5, rtol=0.01)
    np.testing.assert_allclose(np.linalg.eigvalsh(result.stretch).mean(axis=0)[1:], 2**0.5, rtol=0.01)
    stress = 3.0 ** (0.5 * (exponent + 1.0)) * result.closing_rate**exponent
    assert result.press_force == pytest.approx(stress * area * result.compression, rel=0.02)


@pytest.mark.parametrize("ratio", [1.0, 100.0])
def test_collimated_squeeze(ratio):
    material = CarreauYasuda(
        shear_viscosity=3.0, infinite_viscosity=0.2, anisotropy_ratio=ratio, relaxation_time=2.0, exponent=0.4,
        transition=1.5,
    )  # fmt: skip
    result = squeeze(shape=(8, 8, 6), ratio=ratio, material=material, angle=0.0)
    factor = 4.0 - 1.0 / ratio
    along, across, _ = np.diagonal(result.stretch.mean(axis=0))
    assert along == pytest.approx(2.0 ** (0.5 / ratio), rel=0.01)
    assert across == pytest.approx(2.0 ** (1.0 - 0.5 / ratio), rel=0.01)
    rate = factor**0.5 * result.closing_rate
    viscosity = 0.2 + 2.8 * (1.0 + (2.0 * rate) ** 1.5) ** (-0.6 / 1.5)
    stress = factor * viscosity * result.closing_rate
    assert result.press_force == pytest.approx(stress * 64.0 * result.compression, rel=0.02)


def channel(material, height: int = 8, length: int = 24) -> ImplicitIntegrator:
    """Charge of unit spacing, pushed at 1 mm/s along x1 between plates without slip."""
    width = 3
    planes = {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1), wall="no_slip"),
        "upper": PlaneTool(shape="plane", point=(0, 0, height), normal=(0, 0, -1), wall="no_slip"),
        "left": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 1, 0)),
        "right": PlaneTool(shape="plane", point=(0, width, 0), normal=(0, -1, 0)),
        "piston": PlaneTool(shape="plane", point=(0, 0, 0), normal=(1, 0, 0), motion={"velocity": (1, 0, 0)}),
    }
    walls, positions = Walls(compile_tools(planes), np.ones(3)), lattice((length, width, height))
    section = SolverSection(end_time=1.0)
    n = len(positions)
    along, across = np.tile([1.0, 0.0, 0.0], (n, 1)), np.tile([0.0, 1.0, 0.0], (n, 1))
    state = ParticleState.at_rest(positions, np.ones(n), along, across, walls.starting_half_widths(positions))
    return ImplicitIntegrator(Model(section, material, walls, section.smoothing_ratio, 1e6, 0.0), state)


def profile(exponent: float, height: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Velocities of the layers in the middle of a channel, found and exact."""
    integrator = channel(power_law(exponent), height, length)
    report = integrator.initialise(0.0, 1e-2)
    assert report.unconverged == 0
    state = integrator.state
    inside = np.abs(state.position[:, 0] - 0.5 * length) < 2.0
    layer = np.floor(state.position[inside, 2]).astype(int)
    found = np.bincount(layer, state.velocity[inside, 0]) / np.bincount(layer)
    z = (2.0 * np.arange(height) + 1.0) / height - 1.0
    return found, (2 * exponent + 1) / (exponent + 1) * (1.0 - np.abs(z) ** (1.0 + 1.0 / exponent))


def test_channel_profile():
    exponent = 0.5
    errors = [np.abs(np.subtract(*profile(exponent, height, length))).max() for height, length in ((8, 24), (16, 40))]
    assert errors[1] < 0.05
    assert errors[1] < 0.5 * errors[0]
    # A Newtonian fluid would go half as fast again as the mean, this one by a third.
    assert profile(exponent, 16, 40)[0].max() == pytest.approx(4.0 / 3.0, rel=0.02)


@pytest.mark.slow
def test_scott_disk():
    n = 0.5
    force, radius, height = squeezed_disk(NoSlip(), material=power_law(n))
    exact = 2.0 * np.pi / (n + 3.0) * ((2.0 * n + 1.0) * SPEED / n) ** n * radius ** (n + 3.0)
    # Lubrication leaves out the stretching, which a disk only four times as wide as high feels.
    assert force == pytest.approx(exact / height ** (2.0 * n + 1.0), rel=0.12)


SOFT = Newtonian(shear_viscosity=1.0)
PARTS = [Newtonian(shear_viscosity=4.0), power_law(0.5)]


def two_materials(shape: tuple[int, int, int], axis: int, material) -> ImplicitIntegrator:
    """Block with another material in the upper half along an axis, under a plate that slides along x1 without slip."""
    low = [-1.0, -1.0, -1.0]
    low[axis] = 0.5 * shape[axis]
    region = {"low": low, "high": [100.0, 100.0, 100.0], "material": material}
    integrator = sheared_charge(shape, (1.0, 0.0, 0.0), "no_slip")
    integrator.model.material = ByRegion(regions=[region], elsewhere=SOFT)
    return integrator


@pytest.mark.parametrize("material", PARTS)
@pytest.mark.parametrize(("height", "length"), [(12, 36), pytest.param(24, 72, marks=pytest.mark.slow)])
def test_two_layers_in_series(material, height, length):
    integrator = two_materials((length, 3, height), 2, material)
    report = integrator.initialise(0.0, 1e-3)
    # One traction through both, eta(g) g = tau, and what the halves shear adds up: (tau + g) H/2 = V.
    rate = brentq(lambda g: (material.shear_at(g) * g + g) * 0.5 * height - SLIDING, 0.0, SLIDING)
    traction = material.shear_at(rate) * rate
    state, inside = integrator.state, middle(integrator)
    z = state.reference_position[:, 2] / height
    found = [state.velocity_gradient[inside & half, 0, 2].mean() for half in (z < 1.0 / 3.0, z > 2.0 / 3.0)]
    assert found[0] == pytest.approx(traction, rel=0.05)
    # Within a kernel of the interface the two are as stiff as their mean: the rest shears more, in proportion to 1/H.
    assert found[1] == pytest.approx(rate, rel=1.8 / height)
    # The free ends, a sixth of the length, carry less.
    assert 0.92 < -report.tool_force[1, 0] / (length * 3.0 * traction) < 1.05


@pytest.mark.parametrize("material", PARTS)
def test_two_materials_side_by_side(material):
    integrator = two_materials((36, 8, 6), 1, material)
    report = integrator.initialise(0.0, 1e-3)
    assert integrator.state.velocity_gradient[middle(integrator), 0, 2].mean() == pytest.approx(1.0, rel=0.03)
    traction = 0.5 * (1.0 + material.shear_at(1.0))
    assert -report.tool_force[1, 0] == pytest.approx(36.0 * 8.0 * traction, rel=0.06)


def test_exponent_one_is_newtonian():
    found = [
        squeeze(shape=(4, 4, 4), material=material).press_force
        for material in (power_law(1.0), Newtonian(shear_viscosity=1.0))
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-3)


def test_explicit_integrator_thins_alike():
    material = power_law(0.5, ratio=10.0)
    implicit = make_squeeze(shape=(6, 6, 4), material=material, ratio=10.0, angle=20.0)
    implicit.initialise(0.0, 1e-2)
    for k in range(4):
        settled = implicit.step(0.01 * k, 0.01)
    model = implicit.model
    section = SolverSection(end_time=1.0, integrator="explicit", reynolds_number=1e-3)
    density = 1e-3 * 12.0 / (2.0 * 4.0)
    start = make_squeeze(shape=(6, 6, 4), angle=20.0).state
    explicit = ExplicitIntegrator(
        Model(section, material, Walls(model.walls.tools, model.walls.spacing), 1.3, model.bulk_modulus, density), start
    )
    explicit.initialise(0.0, 1e-2)
    for k in range(8):
        report = explicit.step(0.005 * k, 0.005)
    assert report.tool_force[1, 2] == pytest.approx(settled.tool_force[1, 2], rel=0.03)


def test_laws_are_followed_to_the_tolerance():
    def first(tolerance: float) -> tuple[float, np.ndarray]:
        integrator = make_squeeze(
            shape=(8, 8, 6), material=power_law(0.3), wall="no_slip", velocity_tolerance=tolerance,
            power_tolerance=20.0 * tolerance,
        )  # fmt: skip
        report = integrator.initialise(0.0, 1e-2)
        assert report.unconverged == 0
        return report.tool_force[1, 2], integrator.state.velocity

    force, velocities = first(5e-4)
    exact_force, exact = first(1e-7)
    assert np.linalg.norm(velocities - exact) < 5e-4 * np.linalg.norm(exact)
    assert force == pytest.approx(exact_force, rel=5e-3)
