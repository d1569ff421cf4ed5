"""When to make the coarse level, and when to make it anew: it costs as much as some dozens of iterations."""

import numpy as np

from ppmc.solver.coarse import CoarseLevel, SortedLevel, make_coarse_level
from ppmc.solver.state import ParticleState
from ppmc.solver.system import VelocitySystem
from ppmc.solver.tiles import make_tiles

WORTH = 60  # iterations of a solve without coarse level from which one pays
OLDEST = 24  # solves after which it is made anew anyhow
WORSE = 1.5  # growth of the iterations since it was made that makes it due
PARTICLES = 50  # in a tile, at least; finer tiles cost more to factorise than they save in iterations


class CoarseSchedule:
    """Keeps a coarse level over several solves; its state is part of a checkpoint, so that a resumed run repeats it.

    Attributes
    ----------
    most : int
        Most tiles; 0 switches the coarse level off.
    level : CoarseLevel or None
    age, first, last : int
        Solves since the level was made, iterations of the first of them, iterations of the last solve.
    """

    def __init__(self, most: int, stiff: bool) -> None:
        self.most = most
        self.level: CoarseLevel | None = None
        self.age, self.first, self.last = 0, 0, WORTH if stiff else 0

    def level_for(self, system: VelocitySystem, state: ParticleState) -> SortedLevel | None:
        """Return the level to use for a system, made anew if it is due; None while it doesn't pay."""
        if self.most == 0 or (self.level is None and self.last < WORTH):
            return None
        if self.level is None or self.age >= OLDEST or self.last > WORSE * self.first + 8:
            wanted = int(np.clip(len(state) // PARTICLES, 1, self.most))
            tile = make_tiles(system.operator.positions, wanted)
            self.level = make_coarse_level(system, tile, state.original)
            self.age = 0
        return self.level.sorted_as(state.original)

    def note(self, iterations: int) -> None:
        """Take note of a finished solve."""
        self.last = iterations
        if self.age == 0:
            self.first = iterations
        self.age += 1

    def save(self) -> dict[str, np.ndarray]:
        """Return everything as arrays, for a checkpoint."""
        arrays = {"counters": np.array([self.age, self.first, self.last])}
        if self.level is not None:
            arrays |= {"tile": self.level.tile, "arm": self.level.arm, "factor": self.level.factor}
        return arrays

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`save` returned."""
        self.age, self.first, self.last = (int(c) for c in arrays["counters"])
        if "factor" in arrays:
            self.level = CoarseLevel(arrays["tile"], arrays["arm"], np.asfortranarray(arrays["factor"]))
