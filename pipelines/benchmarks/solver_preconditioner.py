"""Conjugate-gradient iterations to 1 % true velocity error, mixed platelets between slip plates, inertia-free.

    python pipelines/benchmarks/solver_preconditioner.py [--ratios 1e3 1e4 6e4] [--sizes 16x12x6 24x24x10] [--plain]

Each layer is tiled with platelets of about 8 x 4 x 1 particles turned at random (5 degrees out of plane), 10 % jitter,
bulk stiffness 6 R eta as in a step of 2 % strain; the upper plate moves with unit speed and the solve starts from rest.
The true error is measured against a solve to 1e-11 and leaves out the rigid motions that slip plates don't hold.
Iterations don't depend on the machine; CPU seconds are of one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ppmc.solver.linear.block_jacobi import restricted_inverse
from ppmc.solver.linear.coarse_grid import CELL, make_grid
from ppmc.solver.linear.conjugate_gradient import conjugate_gradient
from ppmc.solver.linear.rigid_modes import Pieces, free_rigid_modes
from ppmc.solver.linear.system import VelocitySystem
from ppmc.solver.particles.cells import sort_into_cells
from ppmc.solver.particles.neighbours import build_list, weigh_pairs
from ppmc.solver.sph.operator import Operator, assemble

Array = NDArray[np.float64]
TILE = (8.0, 4.0)


def platelets(shape: tuple[int, int, int], rng: np.random.Generator) -> tuple[Array, Array]:
    """Return jittered positions and fibre directions."""
    axes = [np.arange(k) + 0.5 for k in shape]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    directions = np.empty_like(points)
    for layer in range(shape[2]):
        on = np.flatnonzero(points[:, 2].astype(int) == layer)
        count = max(1, round(len(on) / (TILE[0] * TILE[1])))
        centre, angle = rng.uniform((0, 0), shape[:2], (count, 2)), rng.uniform(0.0, np.pi, count)
        tilt = np.deg2rad(5.0) * rng.normal(size=count)
        away = points[on, None, :2] - centre
        along = abs(away[..., 0] * np.cos(angle) + away[..., 1] * np.sin(angle)) / TILE[0]
        across = abs(away[..., 1] * np.cos(angle) - away[..., 0] * np.sin(angle)) / TILE[1]
        fibre = np.stack([np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)], axis=1)
        directions[on] = fibre[np.argmin(np.maximum(along, across), axis=1)]
    points += 0.1 * rng.uniform(-1.0, 1.0, points.shape)
    order = sort_into_cells(points, 2.86).order
    return points[order], directions[order]


def mixed(shape: tuple[int, int, int], ratio: float, seed: int = 0) -> tuple[VelocitySystem, Array]:
    """Return the system with plates below and above, and its starting velocities."""
    positions, directions = platelets(shape, np.random.default_rng(seed))
    n = len(positions)
    pairs = weigh_pairs(build_list(positions, 2.86, 0.13), positions, 1.3)
    fibre = np.full((n, 1), 4.0 * (ratio - 1.0))
    bulk = np.full(n, 6.0 * (ratio + 2.0))
    operator = assemble(pairs, positions, np.ones(n), np.ones(n), bulk, fibre, directions[:, None].copy())
    upper, start = positions[:, 2] > shape[2] - 1.0, np.zeros((n, 3))
    start[upper, 2] = -1.0
    rows, blocks, none = np.flatnonzero(upper | (positions[:, 2] < 1.0)), operator.diagonal(), np.zeros(n)
    drag, free = np.zeros((len(rows), 3, 3)), np.tile(np.diag([1.0, 1.0, 0.0]), (len(rows), 1, 1))
    system = VelocitySystem(operator, none, rows, drag, free, restricted_inverse(blocks, rows, drag, free))
    pieces = Pieces.of(pairs, positions, operator.volumes)
    system.rigid = free_rigid_modes(pieces, 0.0, rows, free, drag, float(blocks[:, :3].mean()))
    return system, start


def add_grid(system: VelocitySystem, cell: float) -> int:
    """Give the system its coarse grid and return the grid's number of unknowns."""
    operator: Operator = system.operator
    grid = make_grid(operator.positions, cell)
    own = operator.diagonal()[system.rows, :3].mean(axis=1)
    hold = own[:, None, None] * (np.eye(3) - system.free)
    grid.stiffen(operator, system.inertia, system.rows, hold)
    system.coarse = grid
    return 3 * len(grid.corners)


def without_rigid(positions: Array) -> Callable[[Array], Array]:
    """Return the projection off the motions that the plates leave free."""
    x, y = (positions - positions.mean(axis=0))[:, :2].T
    zero, one = np.zeros_like(x), np.ones_like(x)
    modes = np.stack(
        [np.stack(m, axis=1).ravel() for m in ((one, zero, zero), (zero, one, zero), (-y, x, zero))], axis=1
    )
    basis = np.linalg.qr(modes)[0]
    return lambda v: v.ravel() - basis @ (basis.T @ v.ravel())


def measure(system: VelocitySystem, start: Array, reference: Array, most: int) -> tuple[int, float, float]:
    """Return iterations to 1 % true error, CPU seconds, and the estimate at that point."""
    clean = without_rigid(system.operator.positions)
    size = float(np.linalg.norm(clean(reference)))
    began = time.process_time()
    solution = conjugate_gradient(
        system.apply, system.project, system.precondition, np.zeros_like(start), start, tolerance=0.0,
        max_iterations=most, window=1, watch=lambda v: bool(np.linalg.norm(clean(v - reference)) < 0.01 * size),
    )  # fmt: skip
    return solution.iterations, time.process_time() - began, solution.estimated_error


def main() -> None:
    """Print one row for each size and ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ratios", type=float, nargs="+", default=[1e3, 1e4, 6e4])
    parser.add_argument("--sizes", nargs="+", default=["16x12x6", "24x24x10"])
    parser.add_argument("--plain", action="store_true", help="also without the grid (slow)")
    given = parser.parse_args()
    print("      n        R  grid unknowns  iterations  CPU s  without grid")
    for size in given.sizes:
        shape = tuple(int(k) for k in size.split("x"))
        for ratio in given.ratios:
            system, start = mixed(shape, ratio)
            unknowns = add_grid(system, CELL)
            reference = conjugate_gradient(
                system.apply, system.project, system.precondition, np.zeros_like(start), start, tolerance=1e-9,
                max_iterations=3000,
            ).velocities  # fmt: skip
            iterations, seconds, _ = measure(system, start, reference, 3000)
            plain = ""
            if given.plain:
                system.coarse = None
                plain = str(measure(system, start, reference, 6000)[0])
            print(f"{len(start):7d} {ratio:8.0f} {unknowns:14d} {iterations:11d} {seconds:6.1f}  {plain}", flush=True)


if __name__ == "__main__":
    main()
