"""What nothing resists moves nothing; what tools impose is followed; turns are exact."""

import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import CylinderTool, PlaneTool
from ppmc.solver.linear.rigid_modes import Pieces, free_rigid_modes
from ppmc.solver.particles.neighbours import build_list, weigh_pairs
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.gradient import moments_and_gradient
from ppmc.solver.sph.operator import Operator
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.step.turning import chords
from ppmc.solver.walls.tools import Walls

from .blocks import lattice, make_operator, unit_vectors
from .scenes import make_squeeze, run_to_end, squeeze
from .test_squeeze import collimated_stretch

APART, FIRST = np.array([20.0, 3.0, 0.0]), np.array([1.0, 2.0, 3.0])  # mm, mm/s


def two_blocks() -> np.ndarray:
    return np.concatenate([lattice((5, 4, 3), 0.2), lattice((4, 4, 3), 0.2, seed=1) + APART])


def pieces_of(operator: Operator, mass: np.ndarray | None = None) -> Pieces:
    return Pieces.of(operator.pairs, operator.positions, operator.volumes if mass is None else mass)


def rigid(positions: np.ndarray, spin: np.ndarray, velocity: np.ndarray, about: np.ndarray) -> np.ndarray:
    return velocity + np.cross(spin, positions - about)


def about_x3(positions: np.ndarray, vectors: np.ndarray) -> float:
    return float(np.sum(positions[:, 0] * vectors[:, 1] - positions[:, 1] * vectors[:, 0]))


def test_each_piece_is_found():
    positions = np.concatenate([two_blocks(), [[100.0, 0.0, 0.0]]])
    pieces = pieces_of(make_operator(positions, unit_vectors(len(positions))))
    np.testing.assert_array_equal(pieces.piece, np.repeat([0, 1, 2], [60, 48, 1]))
    # A single particle can glide, but it has no turn of its own.
    nobody = np.empty(0, dtype=np.int64), np.empty((0, 3, 3)), np.empty((0, 3, 3))
    modes = free_rigid_modes(pieces, 0.0, *nobody, 1.0)
    assert [m.shape[1] for m in modes.motions] == [6, 6, 3]


def test_free_motions_of_each_piece_keep_no_momentum_and_change_nothing_else():
    positions = two_blocks()
    n, rng = len(positions), np.random.default_rng(3)
    operator, mass = make_operator(positions, unit_vectors(n)), rng.uniform(0.5, 2.0, n)
    pieces = pieces_of(operator, mass)
    rows = np.flatnonzero((positions[:, 2] < 1.0) | (positions[:, 2] > 2.0))
    free, drag = np.tile(np.diag([1.0, 1.0, 0.0]), (len(rows), 1, 1)), np.zeros((len(rows), 3, 3))
    modes = free_rigid_modes(pieces, 0.0, rows, free, drag, 1.0)
    assert [m.shape[1] for m in modes.motions] == [3, 3]
    before = rng.normal(size=positions.shape)
    after = modes.rest(before.copy())
    for on in (slice(0, 60), slice(60, None)):
        x, momentum = positions[on], mass[on, None] * after[on]
        np.testing.assert_allclose(momentum[:, :2].sum(axis=0), 0.0, atol=1e-12)
        assert about_x3(x, momentum) == pytest.approx(0.0, abs=1e-11)
        least, any_other = np.sum(momentum * after[on]), after[on] + rigid(x, np.array([0, 0, 0.01]), 0.0, APART)
        assert np.sum(mass[on, None] * any_other**2) > least
    np.testing.assert_allclose(after[:, 2], before[:, 2], atol=1e-14)
    opposed = operator.apply(before)
    np.testing.assert_allclose(operator.apply(after), opposed, atol=1e-11 * np.abs(opposed).max())


@pytest.mark.parametrize("angle", [0.01, 0.5, 2.0])
def test_turns_keep_distances_and_volume(angle):
    """Two pieces turn at a constant spin each, one of them fast; the middle of the step was predicted from rest."""
    positions = two_blocks()
    operator = make_operator(positions, unit_vectors(len(positions)))
    pieces = pieces_of(operator)
    axis, dt, first = np.array([2.0, -1.0, 2.0]) / 3.0, 0.25, pieces.piece == 0
    rate = 2.0 * np.tan(0.5 * angle) / dt  # of the chords of a turn by that angle
    velocities = np.where(
        first[:, None],
        rigid(positions, rate * axis, FIRST, pieces.centre[0]),
        rigid(positions, -0.3 * rate * axis, np.zeros(3), pieces.centre[1]),
    )
    moved = positions + dt * chords(pieces, velocities, positions, dt)
    for on in (first, ~first):
        apart = [np.linalg.norm(x[on][:, None] - x[on], axis=2) for x in (positions, moved)]
        np.testing.assert_allclose(apart[1], apart[0], rtol=1e-12)
    np.testing.assert_allclose(moved[first].mean(axis=0), positions[first].mean(axis=0) + dt * FIRST)
    arm = positions[0] - positions[first].mean(axis=0)
    across = arm - (arm @ axis) * axis
    turned = moved[0] - moved[first].mean(axis=0)
    assert turned @ across / (across @ across) == pytest.approx(np.cos(angle), abs=1e-12)
    gradient = moments_and_gradient(operator.pairs, positions, operator.volumes, (moved - positions) / dt)
    np.testing.assert_allclose(np.linalg.det(np.eye(3) + dt * gradient), 1.0, rtol=1e-12)


def test_chords_are_the_velocities_where_the_middle_was_predicted():
    start, rng, dt = two_blocks(), np.random.default_rng(5), 0.1
    velocities = rng.normal(size=start.shape) + rigid(start, np.array([0.0, 3.0, 1.0]), 0.0, APART)
    middle = start + 0.5 * dt * velocities
    pieces = pieces_of(make_operator(middle, unit_vectors(len(middle))))
    np.testing.assert_allclose(chords(pieces, velocities, start, dt), velocities, atol=1e-12)


def integrator_of(positions: np.ndarray, tools: dict, directions: np.ndarray, ratio: float) -> ImplicitIntegrator:
    walls, n = Walls(compile_tools(tools), np.ones(3)), len(positions)
    section = SolverSection(end_time=1.0, max_strain_increment=0.1, velocity_tolerance=1e-5)
    across = np.cross([0.0, 0.0, 1.0], directions)
    state = ParticleState.at_rest(positions, np.ones(n), directions, across, walls.starting_half_widths(positions))
    material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=ratio)
    return ImplicitIntegrator(Model(section, material, walls, 1.3, 4000.0 * (ratio + 10.0), 0.0), state)


def plates(height: float, speed: float = 0.0) -> dict:
    motion = {"velocity": (0, 0, -speed)}
    return {
        "lower": PlaneTool(shape="plane", point=(0, 0, 0), normal=(0, 0, 1)),
        "ram": PlaneTool(shape="plane", point=(0, 0, height), normal=(0, 0, -1), motion=motion),
    }


def mixed(n: int, seed: int = 0) -> np.ndarray:
    angle = np.random.default_rng(seed).uniform(0.0, np.pi, n)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)


def spin_of(positions: np.ndarray, velocities: np.ndarray) -> float:
    about = positions[:, :2] - positions[:, :2].mean(axis=0)
    return about_x3(about, velocities) / float(np.sum(about**2))


@pytest.mark.parametrize("ratio", [1.0, 300.0])
def test_charge_in_a_round_cavity_forgets_a_spin(ratio):
    """A ring that touches a round mould and its pin, all slip: squeezed, it neither starts nor goes on spinning."""
    x = lattice((15, 15, 4)) - [7.5, 7.5, 0.0]
    r = np.hypot(x[:, 0], x[:, 1])
    x = x[(r > 3.2) & (r < 6.8)]
    tools = plates(4.0, speed=1.0) | {
        "mould": CylinderTool(shape="cylinder", center=(0, 0, 0), axis=(0, 0, 1), radius=7.0, inside=True),
        "pin": CylinderTool(shape="cylinder", center=(0, 0, 0), axis=(0, 0, 1), radius=3.0),
    }
    integrator = integrator_of(x, tools, mixed(len(x)), ratio)
    state = integrator.state
    integrator.initialise(0.0, 1e-3)
    dt = 0.01
    for k in range(2):
        state.velocity += np.cross([0.0, 0.0, 8.0], state.position)  # the prediction only: nothing moves with it
        integrator.step(k * dt, dt)
        assert abs(spin_of(state.position, state.velocity)) < 0.02
    np.testing.assert_allclose(state.volume_ratio, 1.0, atol=0.02)
    assert np.hypot(*state.position[:, :2].T).max() < 7.0


def test_sliding_along_a_round_wall_is_free_in_the_middle_of_a_step():
    """Faces sought half a step ahead leave a spin free to round-off, and what follows their chords its distance."""
    angle, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False), [-0.5, 0.5])
    x = np.stack([6.5 * np.cos(angle), 6.5 * np.sin(angle), height], axis=-1).reshape(-1, 3)
    mould = {"mould": CylinderTool(shape="cylinder", center=(0, 0, 0), axis=(0, 0, 1), radius=7.0, inside=True)}
    state = integrator_of(x, mould, mixed(len(x)), 1.0).state
    walls, dt = Walls(compile_tools(mould), np.ones(3)), 0.2
    state.contact_tool[:, 0], state.contact_normal[:, 0] = 0, x * [-1 / 6.5, -1 / 6.5, 0.0]
    for _ in range(20):
        # The middle that is predicted is not quite the middle.
        state.velocity = np.cross([0.0, 0.0, 1.0], x) + 0.05 * x * [1.0, 1.0, 0.0]
        contacts = walls.contacts(state, 0.0, dt, 3.0, 0.5 * dt)
        contacts.active = contacts.tool >= 0
        middle = x + 0.5 * dt * state.velocity
        pieces = Pieces.of(weigh_pairs(build_list(middle, 2.7, 0.1), middle, 1.3), middle, np.ones(len(x)))
        free, held = contacts.constrain(dt)
        modes = free_rigid_modes(pieces, 0.0, contacts.rows, free, np.zeros((len(x), 3, 3)), 1.0)
        assert modes.count == 2  # it can rise and spin
        spin = np.einsum("nab,nb->na", free, np.cross([0.0, 0.0, 1.0], middle))
        x = x + dt * chords(pieces, spin + held, x, dt)
        state.position, state.contact_normal = x, contacts.normal
    np.testing.assert_allclose(np.hypot(x[:, 0], x[:, 1]), 6.5, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 33.0])
def test_a_wall_with_nothing_opposite_changes_no_strain(angle):
    """It bears no force: the charge is strained as without it, and turned only as far as its face lies on the wall."""
    options = {"shape": (8, 6, 4), "ratio": 100.0, "angle": angle, "reduction": 0.7, "max_strain_increment": 0.05}
    result = squeeze(walls=(((0, 0, 0), (1, 0, 0)),), **options)
    stretch = collimated_stretch(100.0, 1.0 / 0.7, angle)
    np.testing.assert_allclose(result.stretch.mean(axis=0), stretch, atol=0.01)
    assert abs(result.reports[-1].tool_force[2, 0]) < 0.01 * result.press_force
    u, _, v = np.linalg.svd(result.state.deformation_gradient.mean(axis=0))
    turn = np.degrees(np.arctan2((u @ v)[1, 0], (u @ v)[0, 0]))
    face = stretch[:, 1]
    assert turn == pytest.approx(np.degrees(np.arctan2(face[0], face[1])), abs=0.02 if angle == 0.0 else 0.5)


def test_what_a_tool_pushes_follows_it_and_nothing_else_moves():
    """Between plates at rest a wall pushes one of two blocks; both could glide and turn."""
    block = lattice((4, 5, 3))
    x = np.concatenate([block, block + APART])
    motion = {"velocity": (2.0, 0, 0)}
    tools = plates(3.0) | {"wall": PlaneTool(shape="plane", point=(0, 0, 0), normal=(1, 0, 0), motion=motion)}
    integrator = integrator_of(x, tools, mixed(len(x)), 1000.0)
    integrator.initialise(0.0, 1e-3)
    for k in range(4):
        integrator.step(0.25 * k, 0.25)
    moved = integrator.state.in_original_order(integrator.state.position) - x
    np.testing.assert_allclose(moved[:60], np.tile([2.0, 0.0, 0.0], (60, 1)), atol=1e-4)
    np.testing.assert_allclose(moved[60:], 0.0, atol=1e-9)
    np.testing.assert_allclose(integrator.state.volume_ratio, 1.0, atol=1e-4)


def test_a_squeezed_block_stays_where_it_is():
    """Its centre and its heading: velocities that a solve begins with leave nothing behind."""
    integrator = make_squeeze(shape=(6, 5, 3), ratio=100.0, angle=33.0, reduction=0.8, max_strain_increment=0.1)
    centre = integrator.state.position.mean(axis=0)[:2]
    integrator.initialise(0.0, 1e-3)
    integrator.state.velocity += [3.0, -2.0, 0.0]
    state = run_to_end(integrator).state
    np.testing.assert_allclose(state.position.mean(axis=0)[:2], centre, atol=1e-2)
    assert spin_of(state.position, state.velocity) == pytest.approx(0.0, abs=1e-2)
