"""Balance, packing and holes of a pin bracket's fill, frame by frame.

    python pipelines/benchmarks/solver_fill.py runs/bracket/flow.vtkhdf --spacing 0.5

Passed: share of the charge above the mouths of the flanges, each particle counted by the part of its room that is
there, against the share of its volume that the ram has displaced; the same by centres. Packing: 5, 50 and 95 % of the
particles in the interior. Power: dissipation over the ram's, of the step that ends there (finished runs only). Largest
hole: of all points of the flanges that should be full at the end, the farthest from any particle, in spacings.

The bracket is that of configs/bracket.yaml; `--set` changes it as in `ppmc part pin_bracket`. Growing files can be read
while they are written.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ppmc.files import open_series
from ppmc.geometry.parts.pin_bracket import PinBracket
from ppmc.solver.particles.kernel_shape import full

INTERIOR = 0.93  # packing above which a particle counts as inside
SAMPLES = 200_000
ABOVE = 3.0  # height above the mouths up to which the rooms of particles can reach across them, in spacings
CANDIDATES = 24  # particles about a point, among which the nearest in their own metrics is
CORNER = 1.0  # of a particle from the farthest point of its room: half a diagonal of a cell, and some more


def share_passed(
    points: np.ndarray, ram: float, part: PinBracket, spacing: float, fine: float, shape: np.ndarray | None = None
) -> float:
    """Share of particles of equal volume that has passed into the flanges.

    A row lies across the mouths. Each particle counts by the part of its room that is above them: the points of the
    cavity that are nearest to it.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Particles, mm.
    ram : float
        Height of the ram, mm.
    part : PinBracket
    spacing : float
        Of the particles at their start, mm.
    fine : float
        Grid of points, in spacings.
    shape : ndarray, shape (n, 6), optional
        Kernel shapes, in whose metric it is decided what is nearest: rooms of a lattice that is drawn out are no balls.
    """
    tree, plane = cKDTree(points), part.charge_height
    below, above = np.zeros(len(points)), np.zeros(len(points))
    metric = None if shape is None else np.linalg.inv(full(shape))
    mouths = [(start, start + part.flange_thickness) for start in part.flange_starts]
    for (left, right), low, high, room in [((0.0, part.length), ram, plane, below)] + [
        (mouth, plane, plane + ABOVE * spacing, above) for mouth in mouths
    ]:
        sides = [(left, right), (0.0, part.width), (low, high)]
        counts = [max(1, round((b - a) / (fine * spacing))) for a, b in sides]
        axes = [a + (np.arange(n) + 0.5) * (b - a) / n for n, (a, b) in zip(counts, sides, strict=True)]
        size = np.prod([(b - a) / n for n, (a, b) in zip(counts, sides, strict=True)])
        for x in axes[0]:
            at = np.stack(np.meshgrid([x], *axes[1:], indexing="ij"), axis=-1).reshape(-1, 3)
            distance, nearest = tree.query(at) if metric is None else _nearest(at, points, tree, metric)
            # What is farther from all particles is empty: a gap above an edge.
            room += size * np.bincount(nearest[distance < CORNER * spacing], minlength=len(points))
    seen = below + above > 0.0
    return float(np.where(seen, above / np.where(seen, below + above, 1.0), points[:, 2] > plane).mean())


def _nearest(at: np.ndarray, points: np.ndarray, tree: cKDTree, metric: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to the nearest particle in the particles' own metrics (n, 3, 3), and which it is, for each point."""
    _, candidates = tree.query(at, CANDIDATES)
    away = at[:, None, :] - points[candidates]
    squared = np.einsum("mka,mkab,mkb->mk", away, metric[candidates], away)
    rows, best = np.arange(len(at)), squared.argmin(axis=1)
    return np.sqrt(squared[rows, best]), candidates[rows, best]


def largest_hole(points: np.ndarray, part: PinBracket, spacing: float) -> float:
    """Distance of the emptiest point of the closed flanges from all particles, in spacings."""
    radius, middle = part.hole_diameter / 2.0, part.width / 2.0
    hole = part.charge_height + part.hole_height
    rng, tree, farthest = np.random.default_rng(0), cKDTree(points), 0.0
    edge = 0.5 * spacing  # centres stay half a spacing off the walls
    for start in part.flange_starts:
        low = np.array([start + edge, edge, part.charge_height])
        high = np.array(
            [start + part.flange_thickness - edge, part.width - edge, part.charge_height + part.flange_height - edge]
        )
        at = rng.uniform(low, high, (SAMPLES, 3))
        inside = np.hypot(at[:, 1] - middle, at[:, 2] - hole) > radius + edge
        if part.top == "round":
            inside &= np.hypot(at[:, 1] - middle, np.maximum(at[:, 2] - hole, 0.0)) < middle - edge
        farthest = max(farthest, float(tree.query(at[inside])[0].max()))
    return farthest / spacing


def main() -> None:
    """Print one line a frame."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flow", type=Path)
    parser.add_argument("--spacing", type=float, required=True, help="of the particles, mm")
    parser.add_argument("--set", nargs="*", default=(), metavar="NAME=VALUE", help="dimensions of another bracket, mm")
    parser.add_argument("--fine", type=float, default=0.2, help="of the grid that measures rooms, in spacings")
    given = parser.parse_args()
    part = PinBracket.model_validate(dict(pair.split("=", 1) for pair in given.set))
    print("   time  passed  error  by centres   packing 5, 50, 95 %   mean J  power")
    with open_series(given.flow, "flow") as flow:
        history = flow.history
        for k, time in enumerate(flow.times):
            frame = flow.frame(k, ("packing", "volume_ratio"))
            ram = min(part.closing_speed * float(time), part.stroke)
            if ram == 0.0:
                continue
            balance = ram / part.charge_height
            passed = share_passed(frame["position"], ram, part, given.spacing, given.fine)
            centres = float(np.mean(frame["position"][:, 2] > part.charge_height))
            low, middle, high = np.quantile(frame["packing"][frame["packing"] > INTERIOR], [0.05, 0.5, 0.95])
            power = _power_ratio(history, float(time), part) if history else float("nan")
            errors = 100.0 * (np.array([passed, centres]) / balance - 1.0)
            print(
                f"{time:7.3f} {passed:7.4f} {errors[0]:+6.2f}% {errors[1]:+6.2f}%       "
                f"{low:.3f} {middle:.3f} {high:.3f}       {frame['volume_ratio'].mean():.4f}  {power:.2f}"
            )
        last = flow.frame(-1, ())["position"]
    print(f"largest hole: {largest_hole(last, part, given.spacing):.2f} spacings")


def _power_ratio(history: dict[str, np.ndarray], time: float, part: PinBracket) -> float:
    k = int(np.argmin(np.abs(history["time"] - time)))
    force = -float(history["force_ram_z"][k])
    return float(history["dissipation"][k]) / (force * part.closing_speed) if force > 0.0 else float("nan")


if __name__ == "__main__":
    main()
