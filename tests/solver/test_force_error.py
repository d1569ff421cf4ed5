"""What a residual says about reactions: it bounds their error, and shrinks with it."""

import numpy as np
import pytest

from ppmc.solver.linear.force_error import force_error
from ppmc.solver.step import contact_passes

from .blocks import lattice, make_operator, unit_vectors
from .scenes import make_squeeze


def test_root_mean_square_against_its_definition():
    positions = lattice((5, 4, 4), 0.2)
    operator = make_operator(positions, unit_vectors(len(positions)))
    force, rows = np.random.default_rng(3).normal(size=positions.shape), np.array([0, 7, 42])
    found = force_error(force, rows, operator.pairs, 1.3)
    squares, pairs = np.sum(force**2, axis=1), operator.pairs
    for i, value in zip(rows, found, strict=True):
        near = slice(pairs.start[i], pairs.start[i] + pairs.count[i])
        weights = np.append(pairs.weight[near], 105.0 / (16.0 * np.pi * 1.3**5))
        expected = np.average(np.append(squares[pairs.index[near]], squares[i]), weights=weights)
        assert value == pytest.approx(np.sqrt(expected), rel=1e-6)


@pytest.mark.parametrize("ratio", [1e3, 6e4])
def test_residual_bounds_the_error_of_reactions(ratio, monkeypatch):
    """Fibres in any direction of the plane, particle by particle: reactions that scatter, and are slow to be found."""
    shape, seen = (10, 8, 6), []
    angle = np.random.default_rng(1).uniform(0.0, np.pi, int(np.prod(shape)))
    directions = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    look = contact_passes._changes

    def note(model, state, contacts, system, solution, *others):
        pressing, _ = contacts.reactions(-solution.residual[contacts.rows])
        pairs, on = system.operator.pairs, contacts.active
        error = force_error(system.project(solution.residual), contacts.rows, pairs, model.smoothing_length)
        around = contacts.pressure_around(pressing, pairs, model.smoothing_length)
        seen.append((around[on], np.broadcast_to(error[:, None], on.shape)[on]))
        return look(model, state, contacts, system, solution, *others)

    monkeypatch.setattr(contact_passes, "_changes", note)
    for tolerance in (1e-9, 1e-2, 1e-3, 1e-4):
        integrator = make_squeeze(
            shape, ratio, directions=directions, jitter=0.1, bulk_ratio=1e4, contact_passes=1,
            velocity_tolerance=tolerance, power_tolerance=1e3 * tolerance,
        )  # fmt: skip
        integrator.refresh_neighbours(force=True)
        integrator._solve(0.0, 1e-3, update=False)
    exact, _ = seen[0]
    assert len(exact) == 2 * shape[0] * shape[1]
    for around, error in seen[1:]:
        off = np.abs(around - exact)
        assert np.mean(off < 2.0 * error) > 0.98
        assert np.sqrt(np.mean(off**2)) > 0.1 * np.sqrt(np.mean(error**2))  # it says not much more than is true
