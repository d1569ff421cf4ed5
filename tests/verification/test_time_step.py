"""Convergence in the time step: the mean stretch changes by less than 1e-3 at the default strain increment.

The velocity is second order in the step, contact half-widths and the bulk pressure are first order: the observed order
is just below one.
"""

from itertools import pairwise

import numpy as np

from tests.solver.scenes import Squeeze, make_squeeze


def stretch_after(steps: int) -> np.ndarray:
    integrator = make_squeeze(
        (5, 5, 5), ratio=20.0, angle=33.0, reduction=0.6, velocity_tolerance=1e-7, max_strain_increment=0.2
    )
    integrator.initialise(0.0, 1e-9)
    for k in range(steps):
        integrator.step(k / steps, 1.0 / steps)
    return Squeeze(integrator.state, integrator, []).stretch.mean(axis=0)


def test_order():
    # Against the next finer run.
    runs = [stretch_after(steps) for steps in (10, 20, 40, 80)]
    differences = [np.abs(a - b).max() for a, b in pairwise(runs)]
    orders = np.log2(np.array(differences[:-1]) / np.array(differences[1:]))
    assert np.all(orders > 0.65), (differences, orders)
    assert differences[-1] < 1e-3
