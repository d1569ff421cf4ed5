"""Convergence with the spacing (no locking): pipelines/benchmarks/solver_convergence.py on a smaller block."""

import pytest

SIZE = (4.0, 4.0, 4.0)  # mm


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1e2, 1e4, 6e4])
def test_force_on_two_unlike_plies_converges_with_the_spacing(load_benchmark, ratio):
    script = load_benchmark("solver_convergence")
    forces = []
    for spacing in (1.0, 0.5, 0.25):
        force, report = script.relative_force(spacing, ratio, SIZE)
        assert report.unconverged == 0
        forces.append(force)
    # From above, for a kernel ties unlike plies together; plies that slid on each other's fibres would leave of the
    # order of 1/R, plies that were locked (R + 2) eta23 rate, that is one.
    assert 1.0 > forces[0] > forces[1] > forces[2] > 0.0
    assert script.order(forces) > 0.9
