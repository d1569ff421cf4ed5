"""Speed and memory of the solver's operator: particle-steps a second and core, threads, order, bytes a particle.

    python pipelines/benchmarks/solver_speed.py [--shape 30x30x22] [--repeats 9]

One fibre direction a particle, 30 % longer list than support (skin 10 %), double precision. "reuse" is what a step
with a valid neighbour list pays once: weights, moments and one product; "rebuild" adds sorting and listing. Times are
medians of CPU time, but for the ratio of two threads to one, which needs the clock: run that on a quiet machine.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import fields

import numba
import numpy as np

from ppmc.solver.neighbours import build_list, cell_order, weigh_pairs
from ppmc.solver.operator import Operator, assemble
from ppmc.solver.state import ParticleState

CUTOFF, SMOOTHING = 2.86, 1.3


def median(work: Callable[[], object], repeats: int, clock: Callable[[], float] = time.process_time) -> float:
    """Median seconds of one call, after one to warm up."""
    work()
    spent = []
    for _ in range(repeats):
        began = clock()
        work()
        spent.append(clock() - began)
    return float(np.median(spent))


def make(positions: np.ndarray, directions: np.ndarray) -> Operator:
    """Operator at given positions, list included."""
    n, one = len(positions), np.ones(len(positions))
    pairs = weigh_pairs(build_list(positions, CUTOFF, 0.13), positions, SMOOTHING)
    return assemble(pairs, positions, one, one, 1e4 * one, np.full((n, 1), 4e3), directions)


def size_of(*holders: object) -> int:
    """Bytes of all arrays that are attributes of the holders, or in lists that are."""
    total = 0
    for holder in holders:
        for field in fields(holder):  # type: ignore[arg-type]
            value = getattr(holder, field.name)
            arrays = value if isinstance(value, list) else [value]
            total += sum(a.nbytes for a in arrays if isinstance(a, np.ndarray))
    return total


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", default="30x30x22")
    parser.add_argument("--repeats", type=int, default=9)
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    axes = [np.arange(int(k)) + 0.5 for k in given.shape.split("x")]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points += 0.1 * rng.uniform(-1.0, 1.0, points.shape)
    n, repeats = len(points), given.repeats
    numba.set_num_threads(1)

    positions = points[cell_order(points, CUTOFF)]
    directions = rng.normal(size=(n, 1, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    operator, neighbours = make(positions, directions), build_list(positions, CUTOFF, 0.13)
    velocities, one = rng.normal(size=(n, 3)), np.ones(n)

    def reuse() -> None:
        pairs = weigh_pairs(neighbours, positions, SMOOTHING)
        made = assemble(pairs, positions, one, one, operator.bulk, operator.fibre, directions)
        made.apply(velocities)

    def rebuild(start: np.ndarray) -> None:
        here = start[cell_order(start, CUTOFF)]
        make(here, directions).apply(velocities)

    product = median(lambda: operator.apply(velocities), repeats)
    again, anew = median(reuse, repeats), median(lambda: rebuild(positions), repeats)
    shuffled = points[rng.permutation(n)]
    mixed = median(lambda: rebuild(shuffled), repeats)
    pairs = int(operator.pairs.count.sum())
    print(f"{n} particles, {pairs / n:.1f} neighbours, one core")
    print(f"product alone       {n / product / 1e3:8.0f} k particle-steps/s, {product / pairs * 1e9:.1f} ns a pair")
    print(f"reusing neighbours  {n / again / 1e3:8.0f} k particle-steps/s")
    print(f"rebuilding          {n / anew / 1e3:8.0f} k particle-steps/s")
    print(f"shuffled input      {100.0 * (mixed / anew - 1.0):+8.0f} % of a rebuild")
    state = ParticleState.at_rest(positions, one, directions[:, 0], directions[:, 0], np.zeros((n, 2)))
    print(f"memory              {size_of(state, neighbours, operator.pairs, operator) / n:8.0f} bytes a particle")
    if numba.config.NUMBA_NUM_THREADS > 1:
        single = median(lambda: operator.apply(velocities), repeats, time.perf_counter)
        numba.set_num_threads(2)
        double = median(lambda: operator.apply(velocities), repeats, time.perf_counter)
        print(f"two threads         {single / double:8.2f} times one (by the clock)")


if __name__ == "__main__":
    main()
