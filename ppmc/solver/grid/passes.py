"""Velocities and touching faces of a step on the grid: direct solves until neither is to change."""

from dataclasses import dataclass

import numpy as np

from ppmc.solver.grid.factor import Factor
from ppmc.solver.grid.stiffness import Stiffness
from ppmc.solver.grid.wall_points import WallPoints
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.step.contact_passes import DEEPEST, NEGLIGIBLE, RELEASE, SPARE_PASSES
from ppmc.solver.step.model import Model, StepReport
from ppmc.solver.walls.contact import FACES, Contacts

HOLD = 100.0  # penalty of a touching face over a spacing, in units of (R + 10) eta23: augmentation does the rest
AUGMENTATIONS = 3  # solves with one factor, each of which takes the reactions of the last for given
# Share of the mean pressing reaction by which a face must pull to be let go: faces that hold the same functions of a
# cell share their load at will, within round-off of the penalty.
DOUBT = 1e-3


@dataclass(frozen=True)
class GridSolution:
    """Result of a step's solves.

    Attributes
    ----------
    nodal : ndarray, shape (nodes, 3)
        mm/s.
    force : ndarray, shape (c, 3)
        Of the faces on the body at each wall point, across them; zero where nothing touches; Pa mm^2.
    drag : ndarray, shape (c, 3)
        Of the faces on it along them.
    """

    nodal: np.ndarray
    force: np.ndarray
    drag: np.ndarray


def solve_with_walls(
    model: Model, stiffness: Stiffness, contacts: Contacts, points: WallPoints, load: np.ndarray, hold: float,
    time_step: float, pairs: Pairs, report: StepReport,
) -> GridSolution:  # fmt: skip
    """Find the velocities of the nodes and the faces that touch.

    Parameters
    ----------
    model : Model
    stiffness : Stiffness
    contacts : Contacts
        Its `active` are where the search begins and, at the end, what touches.
    points : WallPoints
    load : ndarray, shape (nodes, 3)
        Pa mm^2.
    hold : float
        Penalty of touching faces, Pa s/mm.
    time_step : float
        s.
    pairs : Pairs
        For means over neighbourhoods.
    report : StepReport
        Passes and solves are added.
    """
    slip = contacts.slip_length[points.row, points.face]
    across = points.normal[:, :, None] * points.normal[:, None, :]
    along = np.eye(3) - across
    sticks, rubs = slip == 0.0, np.isfinite(slip) & (slip > 0.0)
    tied = across + sticks[:, None, None] * along
    friction = np.where(rubs, points.area / np.where(rubs, slip, 1.0), 0.0)[:, None, None] * along
    last, attempt = model.settings.contact_passes - 1, 0
    while True:
        on = contacts.active[points.row, points.face]
        stiff = (hold * points.area * on)[:, None, None] * tied
        soft = on[:, None, None] * friction
        factor = Factor(stiffness.indices, stiffness.pointers, points.add_stiffness(stiff + soft, stiffness))
        held, nodes = np.zeros((len(on), 3)), len(load)
        for _ in range(AUGMENTATIONS):
            given = held + np.einsum("cab,cb->ca", stiff, points.target) + np.einsum("cab,cb->ca", soft, points.wall)
            nodal = factor.solve(load + points.load(given, nodes))
            velocities = points.velocities(nodal)
            held += np.einsum("cab,cb->ca", stiff, points.target - velocities)
        factor.free()
        report.iterations += AUGMENTATIONS
        report.passes += 1
        force = np.einsum("cab,cb->ca", across, held)
        drag = held - force + np.einsum("cab,cb->ca", soft, points.wall - velocities)
        added, released, deepest = _changes(model, contacts, points, pairs, force, velocities, time_step)
        if attempt >= last:
            released[:] = False
        settled = not (added.any() or released.any())
        enough = attempt >= last and (attempt >= last + SPARE_PASSES or deepest < DEEPEST * model.spacing)
        if settled or enough:
            return GridSolution(nodal, force, drag)
        contacts.active = (contacts.active & ~released) | added
        attempt += 1


def _changes(
    model: Model, contacts: Contacts, points: WallPoints, pairs: Pairs, force: np.ndarray, velocities: np.ndarray,
    time_step: float,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Faces to add and to release, both (m, 3), and the deepest penetration, mm."""
    at = points.row, points.face
    depth, pressing = np.zeros(contacts.tool.shape), np.zeros((len(contacts.rows), FACES))
    np.maximum.at(depth, at, -points.departures(velocities, time_step))
    depth[contacts.active] = 0.0
    np.add.at(pressing, at, np.einsum("cd,cd->c", force, points.normal))
    positive = pressing[pressing > 0.0]
    limit = np.full(pressing.shape, (RELEASE + DOUBT) * float(positive.mean()) if len(positive) else 0.0)
    np.add.at(limit, at, model.settings.ambient_pressure * points.area)
    around = contacts.pressure_around(pressing, pairs, model.smoothing_length)
    return depth > NEGLIGIBLE * model.spacing, contacts.active & (around < -limit), float(depth.max(initial=0.0))
