r"""Which tools close on the charge, and whether it still covers them.

Contact pushes and does not pull, so a charge may leave a tool: a stubby stack of stiff sheets between slip plates leans
and tips over like a pack of cards (docs/theory.md, "Charges that lean"). Nothing in a single solve is wrong then, but
what the tools do afterwards is no moulding any more. A tool that closes on a charge that it has touched must stay
covered; a tool that parts from it, rests, or is merely passed by need not.

A tool presses in the direction of the force that it bore when it was covered most; its cover is the area of the
charge that touches it on faces that look there, so that the flow may well leave the sides of a pin. Two tools oppose
each other if they press against each other, and close at the speed with which they approach along that direction. With
the cover :math:`a_k` of tool k over the most that it has been,

.. math:: c_k = a_k / \max_{t' \le t} a_k(t'), \qquad
          s_k = \max_{m:\,d_m\cdot d_k < -1/2} (v_k - v_m)\cdot d_k

tool k is judged while :math:`s_k > 0` and it moves itself or bears a fair part of what the tools bear. Area, not
particles: a charge that spreads over a plate and beyond takes its particles along, not its cover.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.model import Touched

OPPOSED = 0.5  # cosine, 60 degrees: less, and a wall is passed by or carries friction only, as side walls with draft do
BEARING = 0.25  # of the largest force on a tool: pins and ledges that bear less may be left behind in their wake
# Coverage below which a tool has lost the charge. A plate that a block tips over on keeps an edge or two: half a row on
# each of two edges of a block four particles wide is an eighth.
LET_GO = 0.15
# Way, in spacings, that a tool must close uncovered before the charge counts as lost: the largest displacement that a
# step may bring by default. A charge that a tool strikes and that bounces off for an instant has not been lost.
LOST_WAY = 0.25
# Force, in units of K times a spacing squared, below which a tool has not pressed: round-off of a charge that is pushed
# along. K is some thousands of times the stress of a squeeze, so that this is a millionth of what a particle bears.
LEAST_FORCE = 1e-9


@dataclass
class Coverage:
    """Running record of what has covered each tool; :meth:`add` takes one step after the other.

    Attributes
    ----------
    tools : int
        How many there are.
    least_force : float
        Below it a tool has not pressed, Pa mm^2; see :func:`least_force`.
    most : ndarray, shape (tools,)
        Most area that covered each tool, mm^2.
    direction : ndarray, shape (tools, 3)
        Unit vector in which it pressed then; zero if it never did.
    bearing : ndarray, shape (tools,)
        Its force then over the largest force on a tool.
    way : ndarray, shape (tools,)
        Way that it has closed since it lost the charge, mm.
    since : ndarray, shape (tools,)
        Time at which that began, s.
    """

    tools: int
    least_force: float
    most: np.ndarray = field(init=False)
    direction: np.ndarray = field(init=False)
    bearing: np.ndarray = field(init=False)
    way: np.ndarray = field(init=False)
    since: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.most = np.zeros(self.tools)
        self.direction = np.zeros((self.tools, 3))
        self.bearing = np.zeros(self.tools)
        self.way = np.zeros(self.tools)
        self.since = np.full(self.tools, np.nan)

    def closing(self, velocities: np.ndarray) -> np.ndarray:
        """Speed with which each tool closes on the charge, shape (tools,), mm/s; zero where it is not judged.

        `velocities`, shape (tools, 3), are the tools', mm/s.
        """
        facing = self.direction @ self.direction.T < -OPPOSED
        approach = np.einsum("kmc,kc->km", velocities[:, None] - velocities[None], self.direction)
        speed = np.max(approach, axis=1, initial=0.0, where=facing)
        # A tool that nothing opposes presses the charge against its own stiffness, inertia or friction.
        own = np.einsum("kc,kc->k", velocities, self.direction)
        moves = own > OPPOSED * np.linalg.norm(velocities, axis=1)
        speed = np.where(moves & ~facing.any(axis=1), own, speed)
        return np.where(moves | (self.bearing >= BEARING), speed, 0.0)

    def cover(self, touched: Touched, force: np.ndarray) -> np.ndarray:
        """Area of the charge that covers each tool where it presses, shape (tools,), mm^2.

        A tool that has not pressed before presses in the direction of its `force`, shape (tools, 3), Pa mm^2.
        """
        pressed = np.linalg.norm(self.direction, axis=1) > 0.0
        direction = np.where(pressed[:, None], self.direction, _unit(-force))
        along = np.einsum("mc,mc->m", touched.normal, direction[touched.tool])
        facing = np.flatnonzero(along > OPPOSED)
        return np.bincount(touched.tool[facing], touched.area[facing], minlength=self.tools)

    def add(self, time: float, cover: np.ndarray, force: np.ndarray, closing: np.ndarray, dt: float) -> None:
        """Count in a step of length `dt` that ended at `time`, s.

        Parameters
        ----------
        time, dt : float
            s.
        cover : ndarray, shape (tools,)
            See :meth:`cover`, mm^2.
        force : ndarray, shape (tools, 3)
            Force of the charge on each tool, Pa mm^2.
        closing : ndarray, shape (tools,)
            See :meth:`closing`, mm/s.
        """
        lost = (closing > 0.0) & (cover < LET_GO * self.most)
        self.since = np.where(lost & (self.way == 0.0), time, self.since)
        self.way = np.where(lost, self.way + closing * dt, 0.0)
        size = np.linalg.norm(force, axis=1)
        # A tool that parts leaves the charge by its own motion: its way back through the air is no loss.
        self.most = np.where((closing == 0.0) & (cover < LET_GO * self.most), 0.0, self.most)
        # A force that has turned round is noise of a stiff charge, or a pull: neither tells where the tool presses.
        turned = np.einsum("kc,kc->k", self.direction, -force) < 0.0
        fuller = (cover >= self.most) & (cover > 0.0) & (size > self.least_force) & ~turned
        self.direction[fuller] = _unit(-force[fuller])
        self.bearing[fuller] = size[fuller] / size.max(initial=1e-300)
        self.most[fuller] = cover[fuller]

    def share(self, cover: np.ndarray, closing: np.ndarray) -> np.ndarray:
        """Share of its most cover that each tool has, shape (tools,); NaN where it is not judged."""
        return np.where((closing > 0.0) & (self.most > 0.0), cover / np.maximum(self.most, 1e-300), np.nan)

    def lost(self, spacing: float) -> np.ndarray:
        """Numbers of the tools that have lost the charge, of particles `spacing` mm apart."""
        return np.flatnonzero(self.way > LOST_WAY * spacing)


def least_force(bulk_modulus: float, spacing: float) -> float:
    """Force, Pa mm^2, below which a tool has not pressed on particles `spacing` mm apart, with K in Pa."""
    return LEAST_FORCE * bulk_modulus * spacing**2


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (k, 3) at unit length, zero ones as they are."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])


def touching(state: ParticleState, directions: np.ndarray) -> np.ndarray:
    """Particles that touch each tool where it presses, shape (tools, n), bool, by their numbers in the charge.

    Of a tool that presses in one of the `directions`, shape (tools, 3), only faces that look there count: the flow may
    well leave the sides of a pin. Of one that has not pressed yet, zero, all count.
    """
    out = np.zeros((len(directions), len(state)), dtype=bool)
    rows, faces = np.nonzero(state.contact_tool >= 0)
    tools = state.contact_tool[rows, faces]
    along = np.einsum("mc,mc->m", state.contact_normal[rows, faces].astype(np.float64), directions[tools])
    counts = (along > OPPOSED) | (np.linalg.norm(directions[tools], axis=1) == 0.0)
    out[tools[counts], state.original[rows[counts]]] = True
    return out
