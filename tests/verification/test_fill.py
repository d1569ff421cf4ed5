"""Fill of pin brackets, an L and a T: volume above the base against the balance, packing, and tightness.

The bar of the balance is 1 %. `bracket_coarse` is held to it, a small bracket with six layers and five particles across
a flange in the mean of readings (R = 1) and at 60 % of the way (R = 1000); before that the same volume is a larger
share of what has passed there. See docs/benchmarks/solver.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import TypeAdapter

from ppmc.charge.stage import run as fill_charge
from ppmc.files import open_series, read_particles
from ppmc.geometry.parts.pin_bracket import PinBracket
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene import parse_scene
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import Tool
from ppmc.solver.particles.kernel_shape import lattice_of
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.run.setup import prepare, run_constants
from ppmc.solver.stage import run as solve
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.step.time_step import fit_to_times, proposed_step
from ppmc.solver.walls.tools import Walls

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


# A leg above the end of the charge makes an L: stiff platelets that turn into it cut the corner across from the inner
# edge, where nothing but the air holds the charge. Above the middle it makes a T, with a stagnation line below.
LEG = """
name: leg
seed: 1
charge:
  domain: {{shape: box, origin: [0, 0, 0], size: [30, 12, 8]}}
  spacing: 1 mm
  layers: 8
  orientation: {{source: platelets, length: 8 mm, width: 4 mm}}
tooling:
  mould:
    shape: extrusion
    profile: {profile}
    axis: [0, 1, 0]
    first_axis: [0, 0, 1]
    length: 12
    inside: true
  ram: {{shape: plane, point: [0, 0, 0], normal: [0, 0, 1], motion: {{velocity: [0, 0, 4.8], travel: 4.8}}}}
material: {{model: transversely_isotropic, shear_viscosity: 1 Pa*s, anisotropy_ratio: {ratio}}}
solver: {{end_time: 1 s, ambient_pressure: {pressure}}}
"""
PROFILES = {
    "ell": (24.0, [[-10, 0], [-10, 30], [32, 30], [32, 24], [8, 24], [8, 0]]),
    "tee": (12.0, [[-10, 0], [-10, 30], [8, 30], [8, 18], [32, 18], [32, 12], [8, 12], [8, 0]]),
}  # where the leg begins, mm, and the cavity along the ram's way and the charge's length
FINE = 0.1  # of a spacing: grid on which the rooms of particles are measured
CONFIG = Path(__file__).parents[2] / "configs" / "bracket_coarse.yaml"
TIMES = [0.45, 0.5, 0.55, 0.6]  # s, of the second that the ram takes


@dataclass
class Frame:
    """The charge at a time.

    Attributes
    ----------
    time : float
        s.
    position : ndarray, shape (n, 3)
        mm.
    shape : ndarray, shape (n, 6)
        Kernel shapes.
    packing : ndarray, shape (n,)
        That of the interior only is looked at.
    distance : float
        Of the nearest particle from the tools, mm.
    """

    time: float
    position: np.ndarray
    shape: np.ndarray
    packing: np.ndarray
    distance: float

    def interior_packing(self) -> np.ndarray:
        """Packing in the interior, 5, 50 and 95 %."""
        return np.quantile(self.packing[self.packing > 0.93], [0.05, 0.5, 0.95])


def frames_of(integrator: ImplicitIntegrator, times: list[float]) -> Iterator[Frame]:
    """Let the charge flow, and stop to look at it."""
    settings = integrator.model.settings
    integrator.initialise(0.0, 1e-3)
    time, step = 0.0, np.inf
    for end in times:
        while time < end - 1e-12:
            gradient = integrator.state.velocity_gradient
            step = proposed_step(gradient, settings.max_strain_increment, settings.max_displacement, np.inf, step)
            step = fit_to_times(time, step, end)
            integrator.step(time, step)
            time += step
        packing = integrator.packing(integrator.weigh(integrator.state.position), end).value
        x = integrator.state.position
        distance = float(integrator.model.walls.tools.distances(x, end)[0].min())
        yield Frame(end, x, integrator.state.kernel_shape, packing, distance)


@pytest.fixture(scope="module", params=[1.0, 1000.0])
def filled(request) -> tuple[float, ParticleState, list[Frame]]:
    """R, the bracket when the ram has gone 60 % of its way, and frames from 45 % on."""
    integrator = bracket(request.param)
    frames = list(frames_of(integrator, TIMES))
    return request.param, integrator.state, frames


@pytest.mark.parametrize("spacings", [(1.0, 1.0, 1.0), (0.5, 1.0, 2.0), (1.25, 1.6, 0.5)])
@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5, 0.8])
def test_share_passed_is_exact_for_lattices(shift, spacings, load_benchmark):
    counts = np.round(np.array([30.0, 16.0, 8.0]) / spacings).astype(int)
    axes = [(np.arange(n) + 0.5) * h for n, h in zip(counts, spacings, strict=True)]
    axes[2] += shift
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    starts = np.array(PART.flange_starts)[:, None]
    flange = np.any((x[:, 0] > starts) & (x[:, 0] < starts + PART.flange_thickness), axis=0)
    x = x[(x[:, 2] < PART.charge_height) | flange]
    top = axes[2][-1] + 0.5 * spacings[2]
    expected = 2 * PART.flange_thickness * PART.width * (top - PART.charge_height) / (len(x) * np.prod(spacings))
    # Next to the mouths' edges the rooms of particles in the base reach a little into the flanges.
    shape = None if max(spacings) == 1.0 else np.tile(lattice_of(spacings), (len(x), 1))
    fine = FINE if shape is None else 2.0 * FINE  # two dozen distances a point take their time
    found = load_benchmark("solver_fill").share_passed(x, shift, PART, 1.0, fine, shape)
    assert found == pytest.approx(expected, abs=0.002)


@pytest.mark.slow
def test_volume_above_the_base(filled, load_benchmark):
    ratio, _, frames = filled
    errors = []
    for frame in frames:
        ram = PART.closing_speed * frame.time
        passed = load_benchmark("solver_fill").share_passed(frame.position, ram, PART, 1.0, FINE)
        errors.append(passed * PART.charge_height / ram - 1.0)
        low, middle, high = frame.interior_packing()
        assert low > 0.93
        assert middle == pytest.approx(1.0, abs=0.02)
        assert high < 1.07
        assert frame.distance > 0.0
        assert np.linalg.norm(frame.position, axis=1).max() < 60.0
    assert np.abs(errors).max() < 0.02
    if ratio == 1.0:
        # A Newtonian charge stays a lattice, whose rows cross the mouths all at once: late readings are good to a per
        # cent only, but for those in the kernels' metric.
        ram, last = PART.closing_speed * frames[-1].time, frames[-1]
        passed = load_benchmark("solver_fill").share_passed(last.position, ram, PART, 1.0, FINE, last.shape)
        assert passed == pytest.approx(ram / PART.charge_height, rel=0.01)
        assert abs(np.mean(errors)) < 0.01
        assert abs(errors[0]) < 0.01
    else:
        assert abs(errors[-1]) < 0.01


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


def fill_leg(directory: Path, script, cavity: str, times: list[float], **values) -> Iterator[tuple[float, Frame]]:
    """Fill an "ell" or a "tee": what has passed into the leg over what the ram has displaced, and the frame."""
    start, profile = PROFILES[cavity]
    scene = parse_scene(LEG.format(profile=profile, **values), directory / "leg.yaml")
    charge = fill_charge(scene, output=directory / "charge.vtkhdf")
    leg = SimpleNamespace(length=30.0, width=12.0, charge_height=8.0, flange_thickness=6.0, flange_starts=(start,))
    integrator = ImplicitIntegrator(*prepare(scene, read_particles(charge, "charge")))
    for frame in frames_of(integrator, times):
        ram = 4.8 * frame.time
        passed = script.share_passed(frame.position, ram, leg, 1.0, FINE, frame.shape)
        yield passed / (ram / 8.0), frame


@pytest.mark.slow
@pytest.mark.parametrize("pressure", [0, 1e5])
def test_air_keeps_the_charge_in_a_dead_corner(tmp_path, load_benchmark, pressure):
    script = load_benchmark("solver_fill")
    for passed, frame in fill_leg(tmp_path, script, "ell", [0.1, 0.2], ratio=1000, pressure=pressure):
        x = frame.position
        to_corner = np.hypot(x[:, 0] - 30.0, x[:, 2] - 4.8 * frame.time).min()
        if pressure:
            assert passed == pytest.approx(1.0, abs=0.02)
            assert to_corner < 1.1
        else:
            assert passed > 1.05
            assert to_corner > 1.3


@pytest.mark.slow
def test_newtonian_charge_turns_into_the_leg_by_the_balance(tmp_path, load_benchmark):
    script = load_benchmark("solver_fill")
    for passed, _ in fill_leg(tmp_path, script, "ell", [0.1, 0.2, 0.3], ratio=1, pressure=0):
        assert passed == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_lattice_drawn_out_above_a_stagnation_line_does_not_fall_together(tmp_path, load_benchmark):
    # Axes of cells reach 20 : 1 there. Where the packing of such lattices was not corrected it came to 1.21, and 4.5 %
    # were missing at 60 %.
    script = load_benchmark("solver_fill")
    for passed, frame in fill_leg(tmp_path, script, "tee", [0.2, 0.4, 0.5, 0.6], ratio=1, pressure=0):
        assert passed == pytest.approx(1.0, abs=0.01 if frame.time > 0.4 else 0.02)
        low, _, high = frame.interior_packing()
        assert low > 0.95
        assert high < 1.05
