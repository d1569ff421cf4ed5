"""Explicit integrator: the same answer as the implicit one where inertia is small, and stable at its own step."""

import copy

import numba
import numpy as np
import pytest

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.step.explicit import ExplicitIntegrator, _opposing_force
from ppmc.solver.step.time_step import fit_to_times
from ppmc.solver.step.tool_loads import wall_drag
from ppmc.solver.walls.wall_layer import brake

from .blocks import lattice, make_operator, unit_vectors
from .scenes import make_squeeze, squeeze


def explicit_squeeze(reynolds: float, **options: object) -> tuple[ExplicitIntegrator, float]:
    """Squeeze with the explicit integrator; returns it and the mean press force of the last tenth."""
    implicit = make_squeeze(integrator="explicit", reynolds_number=reynolds, **options)
    model = implicit.model
    height = 2.0 * implicit.state.position[:, 2].mean()
    ram = model.walls.tools.velocities(0.0)[1, 2]
    model.density = reynolds * (model.material.ratio + 2.0) / (abs(ram) * height)
    integrator = ExplicitIntegrator(model, implicit.state)
    integrator.initialise(0.0, 1e-3)
    time, forces = 0.0, []
    while time < 1.0 - 1e-12:
        step = fit_to_times(time, min(integrator.longest_step(), 0.05), 1.0)
        report = integrator.step(time, step)
        time += step
        if time > 0.9:
            forces.append(report.tool_force[1, 2])
    return integrator, float(np.mean(forces))


def test_explicit_and_implicit_agree():
    options = {"shape": (5, 5, 4), "ratio": 5.0, "reduction": 0.8, "bulk_ratio": 30.0}
    integrator, force = explicit_squeeze(2e-3, **options)
    reference = squeeze(**options)
    mine = integrator.state.in_original_order(integrator.state.deformation_gradient).mean(axis=0)
    f = reference.state.in_original_order(reference.state.deformation_gradient).mean(axis=0)
    np.testing.assert_allclose(mine, f, atol=0.01)
    assert force == pytest.approx(reference.press_force, rel=0.03)  # a mean over a time in which it grows by 4 %
    limits = integrator.limits
    assert limits is not None and limits.used < min(limits.viscous, limits.courant)


def test_affine_motion_is_followed_exactly():
    implicit = make_squeeze(shape=(5, 4, 4), jitter=0.2, integrator="explicit", reynolds_number=1e-3)
    integrator = ExplicitIntegrator(implicit.model, implicit.state)
    integrator.refresh_neighbours(force=True)
    state = integrator.state
    start, fibres = state.position.copy(), state.fibre_direction.copy()
    gradient = np.array([[0.3, -0.7, 0.2], [0.1, 0.2, -0.4], [0.5, 0.3, -0.6]])
    integrator._assemble(integrator.weigh(state.position), 0.0)
    for _ in range(20):
        state.velocity = state.position @ gradient.T
        integrator._move(0.0, 0.01)
    whole = np.linalg.matrix_power(np.eye(3) + 0.01 * gradient, 20)
    np.testing.assert_allclose(state.position, start @ whole.T, rtol=1e-12)
    np.testing.assert_allclose(state.deformation_gradient, np.broadcast_to(whole, (len(state), 3, 3)), atol=1e-11)
    np.testing.assert_allclose(state.volume_ratio, np.linalg.det(whole), rtol=1e-11)
    turned = fibres @ whole.T
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    np.testing.assert_allclose(state.fibre_direction, turned, atol=1e-11)
    np.testing.assert_allclose(state.velocity_gradient, np.broadcast_to(gradient, (len(state), 3, 3)), atol=1e-10)


def test_deformation_yet_to_be_followed_is_sorted_with_the_particles():
    implicit = make_squeeze(shape=(5, 4, 4), jitter=0.2, integrator="explicit", reynolds_number=1e-3)
    integrator = ExplicitIntegrator(implicit.model, implicit.state)
    integrator.refresh_neighbours(force=True)
    state = integrator.state
    state.velocity = 0.1 * np.sin(state.position[:, [1, 2, 0]])
    integrator._assemble(integrator.weigh(state.position), 0.0)
    integrator._move(0.0, 0.01)
    assert integrator.passed is not None
    pending, order = state.in_original_order(integrator.passed), state.original.copy()
    state.position = -state.position
    integrator.refresh_neighbours(force=True)
    assert not np.array_equal(state.original, order)
    np.testing.assert_array_equal(state.in_original_order(integrator.passed), pending)


@pytest.mark.parametrize("directions", [0, 1, 2])
def test_given_stress_acts_beside_the_viscous_one(directions):
    x = lattice((6, 5, 4), jitter=0.2)
    operator = make_operator(x, np.repeat(unit_vectors(len(x)), 2, axis=1)[:, :directions])
    rng = np.random.default_rng(3)
    velocities, stress = rng.normal(size=x.shape), rng.normal(size=len(x))
    given = operator.stress_force((operator.volumes * stress)[:, None, None] * np.eye(3))
    expected = operator.apply(velocities) + given
    found = _opposing_force(operator, velocities, stress)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_drag_of_a_navier_wall_is_that_of_the_implicit_step():
    implicit = make_squeeze(shape=(5, 4, 4))
    rough = PlaneTool(shape="plane", point=(0, 0, 0), normal=(0.6, 0, 0.8), wall={"friction": 3.0})
    walls = type(implicit.model.walls)(compile_tools({"rough": rough}), np.ones(3))
    implicit.model.walls = walls
    state = implicit.state
    state.half_width = walls.starting_half_widths(state.position)
    contacts = walls.contacts(state, 0.0, 1e-3, 2.0)
    contacts.active = contacts.tool >= 0
    contacts.wall_velocity += np.array([0.3, -0.2, 0.1])
    assert contacts.active.any()
    velocities = np.random.default_rng(2).normal(size=state.position.shape)
    implicit.initialise(0.0, 1e-3)
    state.wall_layers[:] = 0
    blocks = wall_drag(implicit.model, state, contacts, implicit.operator(0.0, 0.0, 1e-3))
    velocities, short = velocities[contacts.rows], np.full(len(contacts.rows), 1e-9)
    expected = -np.einsum("nkab,nkb->nka", blocks, velocities[:, None] - contacts.wall_velocity)
    slowed = velocities.copy()
    found = brake(blocks, contacts.active, contacts.wall_velocity, short, slowed)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(slowed - velocities, 1e-9 * found.sum(axis=1), atol=1e-15)
    # A wall's drag in a long step takes the particle along; explicitly, it would throw it back.
    brake(blocks, contacts.active, contacts.wall_velocity, 1e9 * short, slowed)
    moved = np.einsum("nkab,nkb->nka", blocks, slowed[:, None] - contacts.wall_velocity)
    assert np.abs(moved).max() < 0.5 * np.abs(expected).max()


def short_run(threads: int, resumed: bool = False) -> ExplicitIntegrator:
    """Two reported steps of a jittered block; the second after a restart from the state and the list's positions."""
    implicit = make_squeeze(shape=(12, 10, 9), jitter=0.2, ratio=50.0, integrator="explicit", reynolds_number=1e-3)
    implicit.model.density = 1e-2
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        integrator = ExplicitIntegrator(implicit.model, implicit.state)
        integrator.initialise(0.0, 1e-3)
        integrator.step(0.0, 25.0 * integrator.limits.used)
        if resumed:
            listed, shape = integrator.neighbours.positions, integrator.list_shape
            integrator = ExplicitIntegrator(implicit.model, copy.deepcopy(integrator.state))
            integrator.list_shape = shape
            integrator.rebuild_list(listed)
        integrator.step(0.01, 0.01)
    finally:
        numba.set_num_threads(before)
    return integrator


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
def test_threads_and_restarts_change_no_bit():
    plain, threaded, resumed = short_run(1), short_run(2), short_run(1, resumed=True)
    for name, values in plain.state.arrays().items():
        np.testing.assert_array_equal(threaded.state.arrays()[name], values)
        np.testing.assert_array_equal(resumed.state.arrays()[name], values)
