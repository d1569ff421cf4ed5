"""How far a press force may be an upper bound: nothing where nothing is unlike, and what references say elsewhere."""

import numpy as np
import pytest

from ppmc.solver.particles.neighbours import build_list, weigh_pairs
from ppmc.solver.run.mixing import ForceEstimate, estimate_force

from .blocks import lattice


def estimate(directions_of_layer, per_layer, ratio, layers=8):
    """Estimate for a block whose layers are `per_layer` particles thick."""
    x = lattice((8, 8, layers))
    pairs = weigh_pairs(build_list(x, 2.7, 0.05, None, 1.0), x, 1.3, None)
    return estimate_force(
        pairs, directions_of_layer[(x[:, 2] / per_layer).astype(int) % len(directions_of_layer)], ratio
    )


PLIES = np.eye(3)[:2]


@pytest.mark.parametrize("ratio", [1.0, 1000.0, 61215.0])
def test_a_collimated_charge_has_its_force(ratio):
    found = estimate(PLIES[:1], 1, ratio)
    assert found.unlike == 0.0
    assert found.excess == 1.0
    assert found.as_facts()["told"] == ""


def test_an_isotropic_charge_has_its_force_however_it_is_mixed():
    assert estimate(PLIES, 1, 1.0).excess == 1.0


def test_the_excess_grows_with_the_ratio_and_falls_with_the_spacing():
    coarse, fine, stiff = estimate(PLIES, 1, 100.0), estimate(PLIES, 4, 100.0), estimate(PLIES, 1, 61215.0)
    assert 0.4 < coarse.unlike < 0.6
    assert fine.unlike < 0.4 * coarse.unlike
    assert 1.0 < fine.excess < coarse.excess < stiff.excess
    assert stiff.is_bound
    assert "an upper bound" in stiff.as_facts()["told"]


def test_what_is_within_the_references_is_no_bound():
    assert not ForceEstimate(0.01, 1.4).is_bound
