"""The solver's view of the tools: faces near particles, half-widths, wall velocities over a step."""

from dataclasses import dataclass, field

import numpy as np

from ppmc.geometry.tools.contacts import find_contacts
from ppmc.geometry.tools.packed import ToolArrays
from ppmc.geometry.tools.toolset import ToolSet
from ppmc.solver.particles.kernel_shape import full, lattice_of, six
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.walls.contact import FACES, SAME_FACE, Contacts, half_widths, kept_half_widths, starting_half_widths
from ppmc.solver.walls.forced_tools import ForcedTools
from ppmc.walls import WallLaw

# Share of the newest velocity gradient in the running means that predict half-widths: with all of it, few layers in a
# closing gap make the rate alternate from step to step; with a tenth, the lag costs an order of accuracy.
RATE_MEMORY = 0.3
AT_ONCE = 4096  # particles whose faces are sought at once: all that may be found is then little to hold
TREND = RATE_MEMORY / (1.0 - RATE_MEMORY)  # one step ahead of a linear trend, from a mean and the mean of means


@dataclass
class Walls:
    """Tools with the displacements that a force-controlled tool cannot know beforehand.

    Attributes
    ----------
    tools : ToolSet
    spacing : ndarray, shape (3,)
        Particle spacing along x1, x2, x3, mm.
    forced : ForcedTools
        Speeds and displacements of the tools driven by a force.
    """

    tools: ToolSet
    spacing: np.ndarray
    forced: ForcedTools = field(init=False)

    def __post_init__(self) -> None:
        self.forced = ForcedTools(self.tools)

    @property
    def laws(self) -> tuple[WallLaw, ...]:
        """The wall law of each tool."""
        return tuple(tool.wall for tool in self.tools.tools)

    @property
    def rub(self) -> bool:
        """Whether any tool resists sliding."""
        return any(law.rubs for law in self.laws)

    @property
    def bend(self) -> bool:
        """Whether the traction of any tool is not in proportion to the sliding."""
        return any(law.slip_length is None for law in self.laws)

    def offsets(self, time: float) -> np.ndarray:
        """Displacement of every tool at a time, shape (tools, 3), mm."""
        return self.tools.offsets(time) + self.forced.displacement

    def starting_half_widths(self, positions: np.ndarray) -> np.ndarray:
        """Reference half-widths, shape (n, tools), mm."""
        phi, normals = self.tools.distances(positions)
        out = np.empty((len(positions), len(self.tools)))
        for k in range(len(self.tools)):
            size = np.linalg.norm(normals[k] * self.spacing, axis=1)
            mean = float(np.median(size)) if len(size) else 1.0
            out[:, k] = starting_half_widths(phi[k], mean)
        return out

    def contacts(
        self,
        state: ParticleState,
        time: float,
        time_step: float,
        reach: float,
        ahead: float = 0.0,
        flows: bool = True,
    ) -> Contacts:
        """Faces within `reach` (mm) of particles, with the gaps to be kept at the end of the step.

        Parameters
        ----------
        state : ParticleState
        time, time_step : float
            Beginning and length of the step, s.
        reach : float
            Largest distance of a face that can matter in the step, mm.
        ahead : float
            Time after the beginning at which faces are sought, where particles and tools will then be, s. On a curved
            face chords have the normal of their middle: in the half of a step, what slides along it keeps its distance.
        flows : bool
            Whether the flow of the last steps may go on. Without inertia it does not where all tools rest: half-widths
            that are told to flatten on would drag the charge to faces that bear nothing.
        """
        before, after = self.offsets(time), self.offsets(time + time_step)
        wall = (after - before) / time_step
        wall = wall + self.forced.velocities(time_step)
        there = before + ahead * wall
        rows, tool, phi, normal = faces_near(self.tools.arrays, there, state.position + ahead * state.velocity, reach)
        near = np.maximum(tool, 0)
        phi -= ahead * np.einsum("nkc,nkc->nk", normal, state.velocity[rows][:, None] - wall[near])
        rates = (2.0 + TREND) * state.smooth_gradient[rows] - (1.0 + TREND) * state.twice_smooth_gradient[rows]
        rates *= flows
        increment = np.eye(3) + time_step * rates
        lattice = six(increment @ full(state.lattice_shape[rows]) @ np.swapaxes(increment, -1, -2))
        start = lattice_of(self.spacing)
        width = np.zeros(phi.shape)
        for k in range(FACES):
            on = tool[:, k] >= 0
            reference = state.half_width[rows[on], near[on, k]] * np.cbrt(state.volume_ratio[rows[on]])
            width[on, k] = half_widths(reference, lattice[on], start, normal[on, k])
        last = _same_face(tool, normal, state.contact_tool[rows], state.contact_normal[rows])
        touched = last >= 0
        slip = np.where(touched, np.take_along_axis(state.contact_slip[rows], np.maximum(last, 0), axis=1), np.inf)
        growth = np.linalg.norm(np.einsum("nab,nka->nkb", increment, normal), axis=2)
        rate = 0.5 * (rates + np.swapaxes(rates, -1, -2))
        strain = time_step * np.sqrt(np.einsum("nab,nab->n", rate, rate))
        keeps = (tool >= 0) & (touched | (phi < width))
        width = np.where(keeps, kept_half_widths(width, phi, growth, strain), width)
        return Contacts(
            rows=rows,
            tool=tool,
            normal=normal,
            half_width=width,
            gap=np.where(tool >= 0, phi - width, np.inf),
            wall_velocity=np.ascontiguousarray(wall[near]),
            active=touched,
            slip_length=self.slip_lengths(tool, slip),
        )

    def slip_lengths(self, tool: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Speed over traction of faces, shape (m, 3), mm/(Pa s): zero without slip, infinite where nothing rubs.

        `tool`, shape (m, 3), are their tools, -1 for none; `last`, of the same shape, what was found where that depends
        on the sliding.
        """
        constant = [np.nan if law.slip_length is None else law.slip_length for law in self.laws]
        out = np.where(tool >= 0, np.array(constant)[np.maximum(tool, 0)], np.inf)
        return np.where(np.isnan(out), last, out)

    def bending(self, tool: np.ndarray) -> np.ndarray:
        """Whether the slip length of faces with given tools (m, 3) depends on the sliding, shape (m, 3)."""
        bends = np.array([law.slip_length is None for law in self.laws])
        return (tool >= 0) & bends[np.maximum(tool, 0)]

    def nearest_normals(self, positions: np.ndarray, time: float) -> np.ndarray:
        """Normal of the nearest tool at each particle, shape (n, 3)."""
        phi, normals = self.tools.distances(positions, time)
        return normals[np.argmin(phi, axis=0), np.arange(len(positions))]


def faces_near(
    tools: ToolArrays, offsets: np.ndarray, positions: np.ndarray, reach: float, most: int = FACES
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Particles with a tool's face within reach, and these faces, the nearest first.

    Parameters
    ----------
    tools, offsets, reach
        As in :func:`ppmc.geometry.tools.contacts.find_contacts`.
    positions : ndarray, shape (n, 3)
        mm.
    most : int
        Faces kept for a particle, k, six at most.

    Returns
    -------
    rows : ndarray, shape (m,), int64
        Numbers of the particles, ascending.
    tool : ndarray, shape (m, k), int32
        -1 for none.
    distance : ndarray, shape (m, k)
        mm, infinite for none.
    normal : ndarray, shape (m, k, 3)
        Into the material.
    """
    found = []
    for begin in range(0, max(len(positions), 1), AT_ONCE):
        _, tool, distance, normal = find_contacts(tools, offsets, positions[begin : begin + AT_ONCE], reach)
        on = np.flatnonzero(tool[:, 0] >= 0)
        found.append((begin + on, tool[on, :most].astype(np.int32), distance[on, :most], normal[on, :most]))
    rows, tool, distance, normal = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return rows, tool, distance, normal


def _same_face(tool: np.ndarray, normal: np.ndarray, last_tool: np.ndarray, last_normal: np.ndarray) -> np.ndarray:
    """Which of the faces last touched each is, shape (m, 3), -1 if none: same tool, nearly the same normal."""
    same_tool = (tool[:, :, None] == last_tool[:, None, :]) & (tool[:, :, None] >= 0)
    cosine = np.einsum("nkc,nmc->nkm", normal, last_normal)
    same = same_tool & (cosine > SAME_FACE)
    return np.where(same.any(axis=2), np.argmax(same, axis=2), -1)
