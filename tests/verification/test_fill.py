"""Fill of a small pin bracket: volume above the base against the balance, packing, and tightness.

The bar of the balance is 1 %. Of the six layers and five particles across a flange it is asked for with the ram at 60 %
of its way; before that the same volume is a larger share of what has passed. See docs/benchmarks/solver.md.
"""

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy.spatial import cKDTree

from ppmc.geometry.parts.pin_bracket import PinBracket
from ppmc.geometry.toolset import compile_tools
from ppmc.scene.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.solver import SolverSection
from ppmc.scene.tooling import Tool
from ppmc.solver.implicit import ImplicitIntegrator
from ppmc.solver.model import Model
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
    bulk = section.bulk_ratio * (ratio + 2.0) * PART.closing_speed / PART.charge_height
    return ImplicitIntegrator(Model(section, material, walls, section.smoothing_ratio, bulk, 0.0), state)


HALFWAY, END = 0.45, 0.6  # s, of the second that the ram takes


@pytest.fixture(scope="module", params=[1.0, 1000.0])
def filled(request) -> tuple[ParticleState, dict[float, tuple[np.ndarray, ...]]]:
    """The bracket when the ram has gone 60 % of its way; positions, packing and distances to tools at 45 and 60 %."""
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
    return integrator.state, frames


def share_above(x: np.ndarray, ram: float, fine: float = 0.1) -> float:
    """Share of particles (n, 3) of equal volume above the mouths of the flanges, with the ram at a height, mm.

    A row lies across the mouths. Each particle counts by the part of its room that is above them: the points of the
    cavity that are nearest to it, on a fine grid.
    """
    tree, plane, below, above = cKDTree(x), PART.charge_height, np.zeros(len(x)), np.zeros(len(x))
    starts = [(a, a + PART.flange_thickness) for a in PART.flange_starts]
    for (left, right), low, high, room in [((0.0, PART.length), ram, plane, below)] + [
        (mouth, plane, plane + 1.5, above) for mouth in starts
    ]:
        sides = [(left, right), (0.0, PART.width), (low, high)]
        counts = [max(1, round((b - a) / fine)) for a, b in sides]
        axes = [a + (np.arange(n) + 0.5) * (b - a) / n for n, (a, b) in zip(counts, sides, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        size = np.prod([(b - a) / n for n, (a, b) in zip(counts, sides, strict=True)])
        # What is farther from all particles than half a diagonal of a cell is empty: a gap above an edge.
        distance, nearest = tree.query(points)
        room += size * np.bincount(nearest[distance < 1.0], minlength=len(x))
    return float(np.where(below + above > 0.0, above / np.maximum(below + above, 1e-300), x[:, 2] > plane).mean())


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5, 0.8])
def test_share_above_is_exact_for_lattices(shift):
    axes = [np.arange(30) + 0.5, np.arange(16) + 0.5, np.arange(8) + 0.5 + shift]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    starts = np.array(PART.flange_starts)[:, None]
    flange = np.any((x[:, 0] > starts) & (x[:, 0] < starts + PART.flange_thickness), axis=0)
    x = x[(x[:, 2] < PART.charge_height) | flange]
    expected = 2 * PART.flange_thickness * PART.width * (axes[2][-1] + 0.5 - PART.charge_height) / len(x)
    # Next to the mouths' edges the rooms of particles in the base reach a little into the flanges.
    assert share_above(x, ram=shift) == pytest.approx(expected, abs=0.002)


@pytest.mark.slow
def test_volume_above_the_base(filled):
    _, frames = filled
    for time, error in ((HALFWAY, 0.02), (END, 0.01)):
        x, packing, distances = frames[time]
        ram = PART.closing_speed * time
        assert share_above(x, ram) == pytest.approx(ram / PART.charge_height, rel=error)
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
    state, _ = filled
    assert state.volume_ratio.mean() == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(np.linalg.det(state.deformation_gradient), state.volume_ratio, rtol=1e-9)
