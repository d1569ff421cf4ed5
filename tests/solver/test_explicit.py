"""Explicit integrator: the same answer as the implicit one where inertia is small, and stable at its own step."""

import numpy as np
import pytest

from ppmc.solver.explicit import ExplicitIntegrator
from ppmc.solver.time_step import fit_to_times

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
    assert force == pytest.approx(reference.press_force, rel=0.08)
    limits = integrator.limits
    assert limits is not None and limits.used < min(limits.viscous, limits.courant)
