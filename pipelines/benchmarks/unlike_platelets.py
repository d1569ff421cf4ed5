"""Unlike platelets: press force and velocities of the first instant against resolved references, by either operator.

    python pipelines/benchmarks/unlike_platelets.py --cases slab --ratios 10 116 1000 61215
    python pipelines/benchmarks/unlike_platelets.py --cases plies bricks --per-ply 1 2 4 --jitter 0 0.2

slab: 12 x 12 x 6 mm, twelve layers of random platelets of 12.7 x 6.35 x 0.5 mm between slip plates, one particle a
layer, against velocities of a finite-element solution in three dimensions (data/slab_of_platelets.npz). The others are
plane strain, 32 x 8 mm in plies of a millimetre: 0 and 90 degrees in turn (plies) or at random, 8 mm long (bricks);
the bricks leaning by 8 degrees (tilted); one stiff platelet that ends inside (ending).
Error of the velocities: root mean square over that of the reference, in the plane and without rigid motion on the slab.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from first_instant import first_instant, without_rigid
from plane_strain import Reference, resolved

LENGTH, HEIGHT, BRICK = 32, 8, 8  # mm
SLAB = Path(__file__).parent / "data" / "slab_of_platelets.npz"
SLAB_SIZE, SLAB_SPACING, SLAB_SPEED = (12.0, 12.0, 6.0), 0.5, 6.0  # mm, mm, mm/s of its ram


@dataclass(frozen=True)
class Result:
    """Force over that of the reference, error of the velocities, and what the solve took."""

    force: float
    velocity: float
    seconds: float
    iterations: int


def _unit(angle: np.ndarray, lean: np.ndarray | float = 0.0) -> np.ndarray:
    """Directions (..., 3) at an angle to x1 in the plates' plane, and to that plane, in degrees."""
    a, t = np.radians(angle), np.radians(np.broadcast_to(lean, np.shape(angle)))
    return np.stack([np.cos(a) * np.cos(t), np.sin(a) * np.cos(t), np.sin(t)], axis=-1)


def _ply(z: np.ndarray) -> np.ndarray:
    return np.clip(np.floor(z + 1e-9).astype(int), 0, HEIGHT - 1)


def _bricks(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    rng, ply = np.random.default_rng(7), _ply(z)
    offset, across = rng.integers(0, BRICK, HEIGHT), rng.integers(0, 2, (HEIGHT, LENGTH // BRICK + 2))
    return across[ply, (np.floor(x + 1e-9).astype(int) + offset[ply]) // BRICK]


def plies(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return directions of plies along and across, in turn."""
    return _unit(90.0 * (_ply(z) % 2) + 0.0 * x)


def bricks(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return directions of platelets along or across at random."""
    return _unit(90.0 * _bricks(x, z))


def tilted(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return directions of the bricks, those along leaning by 8 degrees up or down, ply by ply."""
    across = _bricks(x, z)
    return _unit(90.0 * across, np.where(across == 0, 8.0 * (2 * (_ply(z) % 2) - 1), 0.0))


def ending(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return directions of one platelet along, 12 mm long, in a block of fibres across."""
    return _unit(np.where((_ply(z) == 3) & (x > 8.0) & (x < 20.0), 0.0, 90.0))


PATTERNS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "plies": plies, "bricks": bricks, "tilted": tilted, "ending": ending,
}  # fmt: skip


def plane(
    pattern: str, ratio: float, per_ply: int, operator: str, reference: Reference, jitter: float = 0.0
) -> Result:  # fmt: skip
    """Run a plane case with `per_ply` particles through a ply, scattered by `jitter` of a spacing."""
    spacing = 1.0 / per_ply
    size = (float(LENGTH), 4.0 * spacing, float(HEIGHT))
    axes = [(np.arange(round(side / spacing)) + 0.5) * spacing for side in size]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    p = PATTERNS[pattern](x[:, 0], x[:, 2])
    x += jitter * spacing * np.random.default_rng(1).uniform(-1.0, 1.0, x.shape)
    got = first_instant(x, p, spacing, size, ratio, operator, held_across=True)
    inside = np.clip(x[:, [0, 2]], 0.0, [LENGTH, HEIGHT])
    exact, found = reference.velocity(inside), got.velocity[:, [0, 2]]
    middle = np.array([0.0, -0.5 * HEIGHT])
    scale = exact - [exact[:, 0].mean(), 0.0] - middle
    off = found - exact - [(found - exact)[:, 0].mean(), 0.0]
    error = np.sqrt((off**2).sum() / (scale**2).sum())
    return Result(got.force / reference.force, float(error), got.seconds, got.iterations)


def slab(ratio: int, operator: str, jitter: float = 0.0) -> Result:
    """Run the slab with one particle a layer, scattered by `jitter` of a spacing."""
    with np.load(SLAB) as data:
        lattice, p = data["position"].astype(float), data["fibre_direction"].astype(float)
        exact = data[f"velocity_q2p1_R{ratio}"].astype(float) * SLAB_SIZE[2] / SLAB_SPEED
        force = float(data[f"force_q2p1_R{ratio}"])
    x = lattice.copy()
    if jitter > 0.0:
        # The platelets stay where they are: particles carry the direction of the place they are put to.
        x += jitter * SLAB_SPACING * np.random.default_rng(5).uniform(-1.0, 1.0, x.shape)
        x = np.clip(x, 0.1 * SLAB_SPACING, np.array(SLAB_SIZE) - 0.1 * SLAB_SPACING)
        cell = {tuple(i): d for i, d in zip((lattice / SLAB_SPACING).astype(int), p, strict=True)}
        p = np.array([cell[tuple(i)] for i in (x / SLAB_SPACING).astype(int)])
    got = first_instant(x, p, SLAB_SPACING, SLAB_SIZE, float(ratio), operator)
    u, r = without_rigid(got.velocity, x), without_rigid(exact, lattice)
    error = np.sqrt(((u - r) ** 2).sum() / (r**2).sum())
    return Result(got.force / force, float(error), got.seconds, got.iterations)


def main() -> None:
    """Print one line a case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--operator", nargs="*", default=["particles", "grid"], choices=["particles", "grid"])
    parser.add_argument("--cases", nargs="*", default=["slab", "plies", "bricks"], choices=["slab", *PATTERNS])
    parser.add_argument("--ratios", nargs="*", type=int, default=[100, 1000, 61215])
    parser.add_argument("--per-ply", nargs="*", type=int, default=[2], help="particles through a ply, not of the slab")
    parser.add_argument("--jitter", nargs="*", type=float, default=[0.0], help="in spacings")
    given = parser.parse_args()
    print("case        R  per ply  jitter  operator   force  velocity  CPU s  iterations")
    for case in given.cases:
        for ratio in given.ratios:
            reference = None if case == "slab" else resolved(PATTERNS[case], LENGTH, HEIGHT, float(ratio))
            for per_ply in [1] if reference is None else given.per_ply:
                for jitter in given.jitter:
                    for operator in given.operator:
                        r = (
                            slab(ratio, operator, jitter)
                            if reference is None
                            else plane(case, float(ratio), per_ply, operator, reference, jitter)
                        )
                        print(
                            f"{case:8s} {ratio:6d} {per_ply:7d} {jitter:8.2f}  {operator:9s} {r.force:7.3f} "
                            f"{r.velocity:8.3f} {r.seconds:7.1f} {r.iterations:8d}",
                            flush=True,
                        )


if __name__ == "__main__":
    main()
