r"""Materials and walls whose laws depend on the flow: viscosities from rates, and velocities from viscosities.

With the velocities u at which laws are taken and the v that a solve with them finds, v = u is wanted. The plain
iteration (Picard, secant viscosities) keeps the system symmetric and positive definite, and converges where tractions
rise with the rate: of a power law with exponent n what is left of an error lies between none and 1 - n, direction by
direction. The last few pairs of u and v say in which directions that is, and what to take next (D. G. Anderson, J. ACM
12 (1965), doi:10.1145/321296.321305).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ppmc.solver.particles.reductions import dot
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.gradient import velocity_gradient
from ppmc.solver.sph.operator import Operator
from ppmc.solver.step.model import Model
from ppmc.solver.step.rheology import Rheology
from ppmc.solver.step.tool_loads import in_half_cells, power_balance, slide_on, wall_drag
from ppmc.solver.walls.contact import Contacts

# Share of the velocity tolerance that a last pass may change velocities by: what is left of an error e after it is at
# most (1 - n)/n of that change, 2.3 times it for n = 0.3.
LAST_CHANGE = 0.3
MOST_LAW_PASSES = 60  # in a step, after which the solve counts as unconverged
REMEMBERED = 4  # pairs of u and v besides the newest
RIDGE = 1e-10  # of their differences' squares: below lies what solves leave undone
LARGE = 0.1  # change of velocities that is worth a new coarse level of the preconditioner


@dataclass
class Mixing:
    """Velocities at which to take the laws next, from what came of those before."""

    changes: list[np.ndarray] = field(default_factory=list)
    answers: list[np.ndarray] = field(default_factory=list)

    def next(self, taken: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Velocities (n, 3) to take the laws at, after those `taken` gave those `found`, both (n, 3)."""
        self.changes, self.answers = self.changes[-REMEMBERED:], self.answers[-REMEMBERED:]
        change = found - taken
        differences = [change - before for before in self.changes]
        out = found.copy()
        if differences:
            products = np.array([[dot(a, b) for b in differences] for a in differences])
            products += RIDGE * np.trace(products) * np.eye(len(products))
            shares = np.linalg.solve(products, [dot(a, change) for a in differences])
            for share, answer in zip(shares.tolist(), self.answers, strict=True):
                out -= share * (found - answer)
        self.changes.append(change)
        self.answers.append(found.copy())
        return out

    def forget(self) -> None:
        """Start anew: other faces touch, and velocities answer otherwise."""
        self.changes, self.answers = [], []


class FlowLaws:
    """Laws of a run's material and walls in one step, as far as they depend on its flow.

    Attributes
    ----------
    operator : Operator
        With the viscosities at the velocities last taken.
    taken : ndarray, shape (n, 3)
        These velocities, mm/s.
    """

    def __init__(
        self, model: Model, state: ParticleState, rheology: Rheology, contacts: Contacts, operator: Operator,
        time_step: float,
    ) -> None:  # fmt: skip
        self.time_step = time_step
        self.model, self.state, self.rheology, self.contacts = model, state, rheology, contacts
        self.operator = operator
        self.taken = state.velocity
        self.mixing = Mixing()
        self._see_half_cells()

    @property
    def depend(self) -> bool:
        """Whether anything depends on the flow."""
        return self.model.material.rate_dependent or self.model.walls.bend

    def error(self, velocities: np.ndarray, negligible: float) -> float:
        """Change from the velocities taken to those found (n, 3), in parts of these or of a `negligible` speed."""
        if not self.depend:
            return 0.0
        size = max(dot(velocities, velocities), len(velocities) * negligible**2, 1e-300)
        change = velocities - self.taken
        return float(np.sqrt(dot(change, change) / size))

    def follow(self, velocities: np.ndarray, residual: np.ndarray, same_faces: bool) -> None:
        """Take the laws at velocities that answer to those found (n, 3), mm/s.

        `residual`, shape (n, 3), Pa mm^2, is that of the solve, which says how walls are pressed. `same_faces` says
        whether the next solve is to have the faces of this one, those that the contacts hold still.
        """
        if not self.depend:
            return
        self.taken = self.mixing.next(self.taken, velocities)
        if not same_faces:
            self.mixing.forget()
        operator, contacts = self.operator, self.contacts
        if self.model.walls.bend:
            pressing, _ = contacts.reactions(-residual[contacts.rows])
            balance = power_balance(self.model, self.state, operator, contacts, velocities, residual, self.time_step)
            pressing *= balance.scale
        if self.model.material.rate_dependent:
            moments = operator.pairs, operator.positions, operator.volumes, operator.inverse
            self.operator = self.rheology.operator(
                operator.pairs, operator.bulk, velocity_gradient(*moments, self.taken)
            )  # fmt: skip
            self._see_half_cells()
        if self.model.walls.bend:
            here = self.taken[contacts.rows]
            contacts.slip_length = slide_on(self.model, self.state, contacts, self.operator, pressing, here)

    def _see_half_cells(self) -> None:
        operator = self.operator
        if not half_cells_differ(self.model):
            return
        moments = operator.pairs, operator.positions, operator.volumes, operator.inverse
        gradient = velocity_gradient(*moments, self.taken)
        see_half_cells(self.model, self.state, self.rheology, self.contacts, operator, self.taken, gradient)


def half_cells_differ(model: Model) -> bool:
    """Whether the half-cells at walls, which shear otherwise than their particles, have another viscosity."""
    return model.material.rate_dependent and model.walls.rub


def see_half_cells(
    model: Model, state: ParticleState, rheology: Rheology, contacts: Contacts, operator: Operator,
    velocities: np.ndarray, gradient: np.ndarray,
) -> None:  # fmt: skip
    """Take the viscosities of the half-cells at walls that rub, from velocities (n, 3) and gradients (n, 3, 3)."""
    rows = contacts.rows
    slide = velocities[rows, None, :] - contacts.wall_velocity
    drag = wall_drag(model, state, contacts, operator)
    behind, _ = in_half_cells(model, state, contacts, drag, slide, gradient[rows])
    contacts.half_cells = rheology.viscosities(behind, rows)
