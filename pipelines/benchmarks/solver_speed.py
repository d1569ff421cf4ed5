"""Speed and memory of the solver's kernels: particle-steps a second and core, threads, order, bytes a particle.

    python pipelines/benchmarks/solver_speed.py [--shape 30x30x22] [--repeats 9]

A jittered block, one fibre direction a particle, double precision, lists 10 % longer than the support. Kernels are
spheres, as they are at the start, or stretched by 2 %, as they soon are: the metric makes weights and lists dearer;
and each along axes of its own, up to the ratio given, as they are late in a run.

An "explicit pass" is all that one explicit step costs where no tool is near: weights, moments and velocity gradient,
deformation, volume and directions brought up to date, viscosity, pressure and stress with zero-energy control, forces,
velocities and positions; the same calls that the integrator makes. "Rebuilt" sorts the whole state into cells and
lists neighbours anew in every pass. "Between two plates" is the integrator's whole step: with contact, the search for
faces in every tenth step and the estimate of the stable step in every 200th. What is held is traced, temporaries
included, from an empty start through a few steps; in the implicit case with platelets of 8 x 4 x 2 particles.

Times are medians of CPU time over rounds in which all cases take turns.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace

import numba
import numpy as np

from ppmc.geometry.tools.toolset import compile_tools
from ppmc.materials.transversely_isotropic import TransverselyIsotropic
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import PlaneTool
from ppmc.solver.particles.kernel_shape import six
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.operator import Operator
from ppmc.solver.step.explicit import ExplicitIntegrator, Loads
from ppmc.solver.step.implicit import ImplicitIntegrator
from ppmc.solver.step.model import Model
from ppmc.solver.walls.tools import Walls

BRIEF = 1e-9  # s; so short a step leaves particles where they are
FAR = 100.0  # mm, from the block to plates that it shall not touch
STEPS = 200  # between two plates
EXPLICIT_STEP, IMPLICIT_STEP = 2e-5, 5e-3  # s, reported: ten stable ones; a strain of a quarter per cent
PLATELET = (8.0, 4.0, 2.0)  # mm


def make_model(shape: list[int], gap: float = 0.0) -> tuple[Model, ParticleState]:
    """Explicit model of a block of unit spacing between two plates at a distance, the upper one coming down."""
    rng = np.random.default_rng(0)
    points = np.stack(np.meshgrid(*[np.arange(k) + 0.5 for k in shape], indexing="ij"), axis=-1).reshape(-1, 3)
    points += 0.1 * rng.uniform(-1.0, 1.0, points.shape)
    n, height = len(points), float(shape[2])
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.cross(directions, np.roll(directions, 1, axis=1))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    descent = {"velocity": (0.0, 0.0, -0.5 * height)}
    lower = PlaneTool(shape="plane", point=(0, 0, -gap), normal=(0, 0, 1))
    ram = PlaneTool(shape="plane", point=(0, 0, height + gap), normal=(0, 0, -1), motion=descent)
    walls = Walls(compile_tools({"lower": lower, "ram": ram}), np.ones(3))
    settings = SolverSection(end_time=1.0, integrator="explicit", reynolds_number=1e-3)
    material = TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=1000.0)
    state = ParticleState.at_rest(points, np.ones(n), directions, across, walls.starting_half_widths(points))
    density = 1e-3 * (material.ratio + 2.0) * material.shear / (0.5 * height * height)
    return Model(settings, material, walls, 1.3, 3e5, density), state


def make_integrator(shape: list[int], gap: float = 0.0) -> ExplicitIntegrator:
    """Explicit integrator of such a block."""
    return ExplicitIntegrator(*make_model(shape, gap))


def make_implicit(shape: list[int]) -> ImplicitIntegrator:
    """Implicit integrator of such a block without inertia, of platelets turned at random in their plane."""
    model, state = make_model(shape)
    _, platelet = np.unique(np.floor(state.position / PLATELET).astype(int), axis=0, return_inverse=True)
    angle = np.random.default_rng(2).uniform(0.0, np.pi, int(platelet.max()) + 1)[platelet.ravel()]
    state.fibre_direction = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    state.in_plane_direction = np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=1)
    settings = SolverSection(end_time=1.0)
    return ImplicitIntegrator(replace(model, settings=settings, density=0.0), state)


class Passes:
    """Explicit passes of one block."""

    def __init__(self, shape: list[int]) -> None:
        self.integrator = make_integrator(shape, FAR)
        self.n = len(self.integrator.state)
        self.integrator.refresh_neighbours(force=True)
        state = self.integrator.state
        state.velocity = 0.1 * np.sin(np.arange(3.0 * self.n)).reshape(-1, 3)
        self.integrator._assemble(self.integrator.weigh(state.position), 0.0)
        self.nobody = self.integrator._near_tools(0.0, BRIEF)
        self.loads = Loads.on(2)
        self.rng = np.random.default_rng(1)

    @property
    def operator(self) -> Operator:
        """The operator where the particles are."""
        assert self.integrator.present is not None
        return self.integrator.present

    def product(self) -> None:
        """Take the product alone, the bulk of an iteration of the implicit step."""
        self.operator.apply(self.integrator.state.velocity)

    def reuse(self) -> None:
        """Pass on a valid list."""
        self.advance(refresh=False)

    def rebuild(self) -> None:
        """Pass that sorts and lists anew."""
        assert self.integrator.neighbours is not None
        self.integrator.neighbours.slack = 0.0
        self.swap_ends()
        self.advance(refresh=True)

    def swap_ends(self) -> None:
        """Let the first particle and the last change places in the order, so that there is something to sort."""
        for values in self.integrator.state.arrays().values():
            values[[0, -1]] = values[[-1, 0]]

    def advance(self, refresh: bool) -> None:
        """Make a pass as the integrator does."""
        self.integrator._move(0.0, BRIEF, refresh)
        self.integrator._push(self.nobody, BRIEF, self.loads)

    def stretch(self) -> None:
        """Give all particles kernels that are no spheres."""
        self.shape(np.tile([1.02**2, 1.02**-2, 1.0, 0.0, 0.0, 0.0], (self.n, 1)))

    def stretch_anyhow(self, aspect: float) -> None:
        """Give each particle a kernel with axes of its own, the longest `aspect` times the shortest."""
        axes = np.linalg.qr(self.rng.normal(size=(self.n, 3, 3)))[0]
        lengths = aspect ** np.column_stack([np.zeros(self.n), self.rng.uniform(0.0, 1.0, self.n), np.ones(self.n)])
        lengths /= np.cbrt(lengths.prod(axis=1))[:, None]
        self.shape(six(np.einsum("nak,nk,nbk->nab", axes, lengths**2, axes)))

    def shape(self, kernel_shape: np.ndarray) -> None:
        """Give kernels the shapes (n, 6)."""
        self.integrator.state.kernel_shape = kernel_shape
        self.integrator.refresh_neighbours()
        self.advance(refresh=False)

    def shuffle(self) -> None:
        """Put the particles into random order."""
        self.integrator.state.reorder(self.rng.permutation(self.n))


def in_turn(
    works: list[Callable[[], object]], repeats: int, clock: Callable[[], float], before: dict | None = None
) -> np.ndarray:
    """Seconds of each call, shape (works, repeats), taking turns; what is done `before` a work isn't counted."""
    spent = np.empty((len(works), repeats + 1))
    for turn in range(repeats + 1):
        for k, work in enumerate(works):
            if before and k in before:
                before[k]()
            began = clock()
            work()
            spent[k, turn] = clock() - began
    return spent[:, 1:]


def size_of(*holders: object) -> int:
    """Bytes of all arrays in the holders and in what they hold, each counted once."""
    arrays: dict[int, int] = {}

    def visit(value: object) -> None:
        if isinstance(value, np.ndarray):
            arrays[id(value)] = value.nbytes
        elif isinstance(value, (list, tuple)):
            for item in value:
                visit(item)
        elif is_dataclass(value):
            for field in fields(value):
                visit(getattr(value, field.name))

    visit(list(holders))
    return sum(arrays.values())


def whole_step(shape: list[int]) -> float:
    """CPU seconds of an explicit step between plates."""
    plates = make_integrator(shape)
    plates.initialise(0.0, 1e-3)
    assert plates.limits is not None
    step = plates.limits.used
    plates.step(0.0, 10.5 * step)
    began = time.process_time()
    steps = plates.step(0.0, (STEPS - 0.5) * step).iterations
    return (time.process_time() - began) / steps


def most_held(make: Callable[[list[int]], ImplicitIntegrator], shape: list[int], step: float) -> float:
    """Most bytes held at once while a run starts and takes two reported steps, s."""
    for traced, cells in ((False, [8, 8, 6]), (True, shape)):  # first a small one, so that no kernel is loaded later
        if traced:
            tracemalloc.start()
        plates = make(cells)
        plates.initialise(0.0, step)
        for k in range(2):
            plates.step(k * step, step)
    most = float(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    return most


def two_threads(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Speed-up of two threads over one: by the clock, from the fastest of many rounds, and by the longer thread.

    The second does not depend on other work on the machine: a thread that waits sleeps, so that the CPU time of the
    thread that has more to do is what the work takes where both have a core to themselves.
    """
    spent = np.empty((5 * repeats, 2, 2))
    for turn in range(-1, len(spent)):
        for threads in (1, 2):
            numba.set_num_threads(threads)
            began = time.perf_counter(), time.process_time(), time.thread_time()
            work()
            main = time.thread_time() - began[2]
            other = time.process_time() - began[1] - main
            spent[turn, threads - 1] = time.perf_counter() - began[0], max(main, other)
    numba.set_num_threads(1)
    clock, path = spent[..., 0].min(axis=0), np.median(spent[..., 1], axis=0)
    return float(clock[0] / clock[1]), float(path[0] / path[1])


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", default="30x30x22")
    parser.add_argument("--repeats", type=int, default=9)
    given = parser.parse_args()
    shape = [int(k) for k in given.shape.split("x")]
    numba.set_num_threads(1)

    passes = Passes(shape)
    n, pairs = passes.n, int(passes.operator.pairs.count.sum())
    print(f"{n} particles, {pairs / n:.1f} neighbours, one core; thousand particle-steps a second, or as it says")
    held = size_of(passes.integrator.state, passes.integrator.neighbours, passes.operator)
    works = [passes.product, passes.reuse, passes.rebuild, passes.rebuild]
    spent = in_turn(works, given.repeats, time.process_time, {3: passes.shuffle})
    product, reuse, rebuild, mixed = np.median(spent, axis=1)
    print(f"product alone                  {n / product / 1e3:8.0f}, {product / pairs * 1e9:.1f} ns a pair")
    print(f"explicit pass, list reused     {n / reuse / 1e3:8.0f}")
    print(f"explicit pass, list rebuilt    {n / rebuild / 1e3:8.0f}")
    print(f"the same from shuffled ones    {100.0 * (mixed / rebuild - 1.0):+8.1f} %")
    passes.stretch()
    reuse, rebuild = np.median(in_turn([passes.reuse, passes.rebuild], given.repeats, time.process_time), axis=1)
    print(f"stretched kernels, list reused {n / reuse / 1e3:8.0f}")
    print(f"stretched, list rebuilt        {n / rebuild / 1e3:8.0f}")
    for aspect in (1.5, 2.0):
        passes.stretch_anyhow(aspect)
        rebuild = np.median(in_turn([passes.rebuild], given.repeats, time.process_time))
        print(f"axes anyhow, {aspect:.1f} : 1, rebuilt  {n / rebuild / 1e3:8.0f}")
    passes.stretch()
    print(f"whole step between two plates  {n / whole_step(shape) / 1e3:8.0f}")
    print(f"state, list and operator       {held / n:8.0f} bytes a particle")
    explicit = most_held(make_integrator, shape, EXPLICIT_STEP)
    implicit = most_held(make_implicit, shape, IMPLICIT_STEP)
    print(f"most held in an explicit run   {explicit / n:8.0f} bytes a particle")
    print(f"most held in an implicit run   {implicit / n:8.0f} bytes a particle")

    if numba.config.NUMBA_NUM_THREADS > 1:
        for name, work in {"product": passes.product, "reused": passes.reuse, "rebuilt": passes.rebuild}.items():
            by_clock, by_path = two_threads(work, given.repeats)
            print(f"two threads over one, {name:8s} {by_clock:8.2f} by the clock, {by_path:.2f} by CPU time")


if __name__ == "__main__":
    main()
