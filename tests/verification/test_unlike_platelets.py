"""Unlike platelets slide: force and velocities of mixed charges against resolved references, on the grid."""

import importlib
import sys

import pytest

from ppmc.solver.run.mixing import estimate_force

from .conftest import BENCHMARKS

# R, most force over that of the reference, most error of the velocities.
SLAB = [(10, 1.1, 0.08), (116, 1.25, 0.15), (1000, 1.5, 0.2), (61215, 2.0, 0.25)]


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        yield importlib.import_module("unlike_platelets")
    finally:
        sys.path.remove(str(BENCHMARKS))


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "force", "velocity"), SLAB)
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_slab_of_random_platelets_with_one_particle_a_layer(benchmark, ratio, force, velocity, jitter):
    result = benchmark.slab(ratio, "grid", jitter)
    assert 0.85 < result.force < force
    assert result.velocity < velocity


def test_a_platelet_that_ends_inside(benchmark):
    reference = benchmark.resolved(benchmark.PATTERNS["ending"], benchmark.LENGTH, benchmark.HEIGHT, 61215.0, 4)
    result = benchmark.plane("ending", 61215.0, 2, "grid", reference)
    assert result.force == pytest.approx(1.0, abs=0.1)
    assert result.velocity < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [100.0, 61215.0])
@pytest.mark.parametrize("pattern", ["plies", "bricks"])
def test_plies_and_bricks_with_four_particles_a_ply(benchmark, pattern, ratio):
    reference = benchmark.resolved(benchmark.PATTERNS[pattern], benchmark.LENGTH, benchmark.HEIGHT, ratio)
    result = benchmark.plane(pattern, ratio, 4, "grid", reference)
    assert result.force == pytest.approx(1.0, abs=0.15)
    assert result.velocity < 0.12


def test_homogeneous_reference_is_exact(benchmark):
    def across(x, z):
        return benchmark._unit(90.0 + 0.0 * x)

    # Plane strain across the fibres: 4 eta23.
    assert benchmark.resolved(across, 8.0, 4.0, 1000.0, per_ply=2).force == pytest.approx(4.0, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "force"), [(116, 3.8), (61215, 839.0)])
def test_the_estimate_tells_what_particles_make_of_the_slab(benchmark, ratio, force):
    measured = benchmark.slab(ratio, "particles").force
    assert measured == pytest.approx(force, rel=0.1)
    with benchmark.np.load(benchmark.SLAB) as data:
        x, p = data["position"].astype(float), data["fibre_direction"].astype(float)
    made = sys.modules["first_instant"].make_integrator(
        x, p, benchmark.SLAB_SPACING, benchmark.SLAB_SIZE, float(ratio), "particles"
    )
    made.refresh_neighbours(force=True)
    found = estimate_force(made.weigh(made.state.position), made.state.fibre_direction, float(ratio))
    assert 2.0 / 3.0 < found.excess / measured < 1.5
