"""Balance, packing and holes of a pin bracket's fill, frame by frame.

    python pipelines/benchmarks/solver_fill.py runs/bracket_coarse/flow.vtkhdf --spacing 1 --height 6 --speed 3.55

Above the base: share of the particles whose centres have passed the height of the charge, against the share of its
volume that the ram has displaced. Packing: 5, 50 and 95 % of the particles in the interior. Largest hole: of all points
of the flanges between the particles of a last frame, the farthest from any particle, in spacings.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import h5py
import numpy as np
from scipy.spatial import cKDTree

INTERIOR = 0.93  # packing above which a particle counts as inside
SAMPLES = 200_000


def main() -> None:
    """Print one line a frame."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flow", type=Path)
    parser.add_argument("--spacing", type=float, required=True, help="of the particles, mm")
    parser.add_argument("--height", type=float, required=True, help="of the charge, mm")
    parser.add_argument("--speed", type=float, required=True, help="of the ram, mm/s")
    parser.add_argument("--flange", type=float, nargs=2, default=(15.0, 20.0), help="its extent along x1, mm")
    parser.add_argument("--pin", type=float, nargs=3, default=(17.0, 29.566521509724982, 6.35), help="x2, x3, radius")
    given = parser.parse_args()
    with h5py.File(given.flow) as file:
        group = file["VTKHDF"]
        times = group["Steps/Values"][:]
        points = group["Points"][:].reshape(len(times), -1, 3)
        packing = group["PointData/packing"][:].reshape(len(times), -1)
        ratio = group["PointData/volume_ratio"][:].reshape(len(times), -1)
    print("   time  above  balance   error  packing 5, 50, 95 %   mean J")
    for k, time in enumerate(times):
        above = float(np.mean(points[k, :, 2] > given.height))
        balance = given.speed * time / given.height
        low, middle, high = np.quantile(packing[k][packing[k] > INTERIOR], [0.05, 0.5, 0.95])
        error = 100.0 * (above / balance - 1.0) if balance > 0.0 else 0.0
        print(
            f"{time:7.3f} {above:6.4f}  {balance:7.4f} {error:+6.2f}%  {low:.3f} {middle:.3f} {high:.3f}"
            f"   {ratio[k].mean():.4f}"
        )
    print(f"largest hole in the flange: {largest_hole(points[-1], given):.2f} spacings")


def largest_hole(points: np.ndarray, given: argparse.Namespace) -> float:
    """Distance of the emptiest point of a flange from all particles, in spacings."""
    (first, last), (y, z, radius) = given.flange, given.pin
    here = points[(points[:, 0] > first) & (points[:, 0] < last) & (points[:, 2] > given.height)]
    low, high = here.min(axis=0), here.max(axis=0)
    at = np.random.default_rng(0).uniform(low, high, (SAMPLES, 3))
    outer = 0.5 * (high[1] - low[1])
    round_top = np.hypot(at[:, 1] - y, np.maximum(at[:, 2] - (high[2] - outer), 0.0)) < outer
    at = at[round_top & (np.hypot(at[:, 1] - y, at[:, 2] - z) > radius)]
    return float(cKDTree(points).query(at)[0].max()) / given.spacing


if __name__ == "__main__":
    main()
