r"""What a run cannot resolve: unlike platelets within a kernel, and what they do to the press force.

Platelets slide over one another in layers that resist with eta23 alone, and beyond some hundred times eta23 it matters
little how stiff they are. Where a kernel spans unlike platelets, averaged gradients and the control of what these do
not see tie them, and the force goes on growing with R. Against resolved solutions (docs/benchmarks/solver.md) the
particle method's force is

.. math:: F / F_{resolved} \approx 1 + c\,s^b\,R^{0.9}

where s is the share of a kernel's weight that lies on unlike neighbours, by the squared sine of the angle between the
fibres. On a slab of random platelets with one and two particles a layer and on bricks with one to four a ply, from R =
100 to 61,215, it is right to a third. Endless plies, which cannot part at their ends, are tied three to ten times less.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass
from typing import Any

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.particles.neighbours import Pairs

COEFFICIENT, OF_SHARE, OF_RATIO = 0.21, 1.5, 0.9
BOUND = 1.5  # excess from which on a force is called an upper bound


@dataclass(frozen=True)
class ForceEstimate:
    """How far the press force of a run may be above a resolved one.

    Attributes
    ----------
    unlike : float
        Share of a kernel's weight on unlike neighbours, 0 to 1.
    excess : float
        Estimated force over the resolved one.
    """

    unlike: float
    excess: float

    @property
    def is_bound(self) -> bool:
        """Whether the force is no more than an upper bound."""
        return self.excess > BOUND

    def told(self) -> str:
        """Return what to say of it."""
        return (
            f"press force: an upper bound, by estimate {self.excess:.2g} times what platelets that slide would bear:"
            f" {self.unlike:.0%} of a kernel lies on unlike ones"
        )

    def as_facts(self) -> dict[str, Any]:
        """Return the estimate as JSON can hold it."""
        return {"unlike": self.unlike, "excess": self.excess, "told": self.told() if self.is_bound else ""}


def estimate_force(pairs: Pairs, directions: np.ndarray, ratio: float) -> ForceEstimate:
    """Estimate how far the force of the particle method is too high.

    Parameters
    ----------
    pairs : Pairs
    directions : ndarray, shape (n, 3)
        Fibre directions.
    ratio : float
        R.
    """
    each = np.zeros(len(directions))
    _unlike(pairs.start, pairs.count, pairs.index, pairs.weight, directions, each)
    unlike = float(each.mean()) if len(each) else 0.0
    return ForceEstimate(unlike, 1.0 + COEFFICIENT * unlike**OF_SHARE * max(ratio - 1.0, 0.0) ** OF_RATIO)


@njit(cache=True, parallel=True)
def _unlike(start, count, index, weight, p, out):
    for i in prange(out.shape[0]):
        total, mass = 0.0, 0.0
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            cosine = p[i, 0] * p[j, 0] + p[i, 1] * p[j, 1] + p[i, 2] * p[j, 2]
            total += weight[slot] * (1.0 - cosine * cosine)
            mass += weight[slot]
        out[i] = total / mass if mass > 0.0 else 0.0
