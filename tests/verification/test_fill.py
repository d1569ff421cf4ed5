"""Fill of pin brackets and an L: volume above the base against the balance, packing, and tightness.

The bar of the balance is 1 %. `bracket_coarse` and Newtonian charges are held to it, a small bracket of R = 1000 with
six layers and five particles across a flange at 60 % of the ram's way; before that the same volume is a larger share of
what has passed there. See docs/benchmarks/solver.md.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import TypeAdapter

from ppmc.charge.stage import run as fill_charge
from ppmc.files import open_series
from ppmc.geometry.parts.pin_bracket import PinBracket
from ppmc.geometry.toolset import compile_tools
from ppmc.scene import parse_scene
from ppmc.scene.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.solver import SolverSection
from ppmc.scene.tooling import Tool
from ppmc.solver.implicit import ImplicitIntegrator
from ppmc.solver.model import Model
from ppmc.solver.setup import run_constants
from ppmc.solver.stage import run as solve
from ppmc.solver.state import ParticleState
from ppmc.solver.time_step import fit_to_times, proposed_step
from ppmc.solver.tools import Walls

PART = PinBracket(length=30.0, width=16.0, flange_thickness=5.0, hole_diameter=6.0, inset=5.0)


def bracket(ratio: float) -> ImplicitIntegrator:
    """Charge of platelets with random directions, 6 layers of 1 mm."""
    counts = [int(PART.length), int(PART.width), int(PART.charge_height)]
    axes = [np.arange(n) + 0.5 for n in counts]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    tools = compile_tools({name: TypeAdapter(Tool).validate_python(tool) for name, tool in PART.tooling().items()})
    walls = Walls(tools, np.ones(3))
    rng, p = np.random.default_rng(1), np.zeros_like(x)
    for layer in range(counts[2]):
        centres, angles = rng.uniform(0.0, counts[:2], (27, 2)), rng.uniform(0.0, np.pi, 27)
        on = np.flatnonzero(x[:, 2].astype(int) == layer)
        nearest = np.argmin(((x[on, None, :2] - centres) ** 2).sum(axis=-1), axis=1)
        p[on] = np.stack([np.cos(angles[nearest]), np.sin(angles[nearest]), np.zeros(len(on))], axis=1)
    section = SolverSection(end_time=1.0)
    material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=ratio)
    state = ParticleState.at_rest(
        x, np.ones(len(x)), p, np.cross([0.0, 0.0, 1.0], p), walls.starting_half_widths(x)
    )  # fmt: skip
    _, bulk, _ = run_constants(section, material, PART.closing_speed, PART.charge_height)
    return ImplicitIntegrator(Model(section, material, walls, section.smoothing_ratio, bulk, 0.0), state)


# An L: stiff platelets that turn into its leg cut the corner across from the inner edge, where nothing but the air
# holds the charge.
ELL = """
name: ell
seed: 1
charge:
  domain: {{shape: box, origin: [0, 0, 0], size: [30, 12, 8]}}
  spacing: 1 mm
  layers: 8
  orientation: {{source: platelets, length: 8 mm, width: 4 mm}}
tooling:
  mould:
    shape: extrusion
    profile: [[-10, 0], [-10, 30], [32, 30], [32, 24], [8, 24], [8, 0]]
    axis: [0, 1, 0]
    first_axis: [0, 0, 1]
    length: 12
    inside: true
  ram: {{shape: plane, point: [0, 0, 0], normal: [0, 0, 1], motion: {{velocity: [0, 0, 4.8], travel: 4.8}}}}
material: {{model: transversely_isotropic, shear_viscosity: 1 Pa*s, anisotropy_ratio: {ratio}}}
solver: {{end_time: {end}, output_interval: 0.1 s, ambient_pressure: {pressure}}}
"""
FINE = 0.1  # of a spacing: grid on which the rooms of particles are measured
CONFIG = Path(__file__).parents[2] / "configs" / "bracket_coarse.yaml"
HALFWAY, END = 0.45, 0.6  # s, of the second that the ram takes


@pytest.fixture(scope="module", params=[1.0, 1000.0])
def filled(request) -> tuple[float, ParticleState, dict[float, tuple[np.ndarray, ...]]]:
    """R, the bracket when the ram has gone 60 % of its way; positions, packing, distances to tools at 45 and 60 %."""
    integrator, frames = bracket(request.param), {}
    settings = integrator.model.settings
    integrator.initialise(0.0, 1e-3)
    time, step = 0.0, np.inf
    for end in (HALFWAY, END):
        while time < end - 1e-12:
            gradient = integrator.state.velocity_gradient
            step = proposed_step(gradient, settings.max_strain_increment, settings.max_displacement, np.inf, step)
            step = fit_to_times(time, step, end)
            integrator.step(time, step)
            time += step
        x = integrator.state.position
        frames[end] = (
            x,
            integrator.packing(integrator.weigh(x), end).value,
            integrator.model.walls.tools.distances(x, end)[0],
        )
    return request.param, integrator.state, frames


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5, 0.8])
def test_share_passed_is_exact_for_lattices(shift, load_benchmark):
    axes = [np.arange(30) + 0.5, np.arange(16) + 0.5, np.arange(8) + 0.5 + shift]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    starts = np.array(PART.flange_starts)[:, None]
    flange = np.any((x[:, 0] > starts) & (x[:, 0] < starts + PART.flange_thickness), axis=0)
    x = x[(x[:, 2] < PART.charge_height) | flange]
    expected = 2 * PART.flange_thickness * PART.width * (axes[2][-1] + 0.5 - PART.charge_height) / len(x)
    # Next to the mouths' edges the rooms of particles in the base reach a little into the flanges.
    assert load_benchmark("solver_fill").share_passed(x, shift, PART, 1.0, FINE) == pytest.approx(expected, abs=0.002)


@pytest.mark.slow
def test_volume_above_the_base(filled, load_benchmark):
    ratio, _, frames = filled
    for time, error in ((HALFWAY, 0.01 if ratio == 1.0 else 0.02), (END, 0.01)):
        x, packing, distances = frames[time]
        ram = PART.closing_speed * time
        assert load_benchmark("solver_fill").share_passed(x, ram, PART, 1.0, FINE) == pytest.approx(
            ram / PART.charge_height, rel=error
        )
        assert np.median(packing[packing > 0.93]) == pytest.approx(1.0, abs=0.02)
        assert distances.min() > 0.0
        assert np.linalg.norm(x, axis=1).max() < 60.0
    # Later the base is three layers thick, and particles of R = 1 crowd at its walls (1.12 at 60 %).
    packing = frames[HALFWAY][1]
    low, high = np.quantile(packing[packing > 0.93], [0.05, 0.95])
    assert low > 0.93
    assert high < 1.07


@pytest.mark.slow
def test_deformation_keeps_the_volume(filled):
    _, state, _ = filled
    assert state.volume_ratio.mean() == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(np.linalg.det(state.deformation_gradient), state.volume_ratio, rtol=1e-9)


@pytest.mark.slow
def test_bracket_of_mixed_platelets_follows_the_balance(tmp_path, load_benchmark):
    # configs/bracket_coarse.yaml, 19,176 particles at R = 61,215, to 40 % of the ram's way; about five minutes.
    text = CONFIG.read_text().replace("end_time: 1 s", "end_time: 0.4 s")
    scene = parse_scene(text, CONFIG)
    charge = fill_charge(scene, output=tmp_path / "charge.vtkhdf")
    part, script = PinBracket(), load_benchmark("solver_fill")
    with open_series(solve(scene, input=charge, output=tmp_path / "flow.vtkhdf"), "flow") as flow:
        np.testing.assert_allclose(flow.times, [0.0, 0.1, 0.2, 0.3, 0.4])
        for k, time in enumerate(flow.times[1:], start=1):
            frame = flow.frame(k, ("packing",))
            ram = part.closing_speed * float(time)
            passed = script.share_passed(frame["position"], ram, part, spacing=1.0, fine=0.15)
            assert passed == pytest.approx(ram / part.charge_height, rel=0.01)
            low, high = np.quantile(frame["packing"][frame["packing"] > 0.93], [0.05, 0.95])
            assert low > 0.95
            assert high < 1.05
        assert flow.history["unconverged"].sum() == 0


def fill_ell(directory: Path, script, **values) -> list[tuple[float, float]]:
    """Fill the L. For each tenth of the ram's way: what has passed into the leg over what the ram has displaced, and
    the distance of the charge from the corner below the leg, mm.
    """
    scene = parse_scene(ELL.format(**values), directory / "ell.yaml")
    charge = fill_charge(scene, output=directory / "charge.vtkhdf")
    leg = SimpleNamespace(length=30.0, width=12.0, charge_height=8.0, flange_thickness=6.0, flange_starts=(24.0,))
    found = []
    with open_series(solve(scene, input=charge, output=directory / "flow.vtkhdf"), "flow") as flow:
        for k, time in enumerate(flow.times[1:], start=1):
            x, ram = flow.frame(k, ())["position"], 4.8 * float(time)
            passed = script.share_passed(x, ram, leg, spacing=1.0, fine=FINE)
            found.append((passed / (ram / 8.0), float(np.hypot(x[:, 0] - 30.0, x[:, 2] - ram).min())))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("pressure", [0, 1e5])
def test_air_keeps_the_charge_in_a_dead_corner(tmp_path, load_benchmark, pressure):
    for passed, to_corner in fill_ell(
        tmp_path, load_benchmark("solver_fill"), ratio=1000, end=0.2, pressure=pressure
    ):  # fmt: skip
        if pressure:
            assert passed == pytest.approx(1.0, abs=0.02)
            assert to_corner < 1.1
        else:
            assert passed > 1.05
            assert to_corner > 1.3


@pytest.mark.slow
def test_newtonian_charge_turns_into_the_leg_by_the_balance(tmp_path, load_benchmark):
    for passed, _ in fill_ell(tmp_path, load_benchmark("solver_fill"), ratio=1, end=0.3, pressure=0):
        assert passed == pytest.approx(1.0, abs=0.01)
