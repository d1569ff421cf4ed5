"""CPU time of ppmc's structure tensor and of structure-tensor on the same volume, run by turns, warm.

    python pipelines/benchmarks/ct_speed.py [--voxels 192] [--rounds 5]

Both give p, r and three eigenvalues at every voxel with sigma 1 and one round window of 2 voxels, on one thread; then
ppmc at stride 2 and 4, with its default two-scale windows, and on two threads. Medians over the rounds and the ratio
of medians; CPU seconds (time.process_time), so that other work on the machine counts little. The first call of each
is not timed. ppmc hands its results on tile by tile; structure-tensor returns whole arrays.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ppmc.ct.orientations import Job, grey_reference, orientations
from ppmc.ct.settings import settings
from ppmc.ct.source import Volume
from ppmc.ct.tiles import tiling
from ppmc.scene.sections.ct import CtSection


def ppmc_run(grey: np.ndarray, stride: int, threads: int, *, two_scales: bool) -> Callable[[], None]:
    volume = Volume(Path("memory"), grey.shape, grey.dtype, lambda box: grey[box])
    spacing = (1.0, 1.0, 1.0)
    if two_scales:
        chosen = settings(CtSection(stride=stride), spacing, grey.shape, 8.0)
    else:
        section = CtSection(sigma=1.0, fibre_window=2.0, follow=False)
        chosen = settings(section, spacing, grey.shape, None)
    job = Job(volume, spacing, chosen, grey_reference(volume), stride=stride)
    tiles = tiling(job.shape, chosen, stride=stride, budget=1024.0, threads=threads, itemsize=1, masked=False)

    def work() -> None:
        for _ in orientations(job, threads, tiles):
            pass

    return work


def peer_run(grey: np.ndarray) -> Callable[[], None]:
    from structure_tensor import eig_special_3d, structure_tensor_3d

    def work() -> None:
        eig_special_3d(structure_tensor_3d(grey.astype(np.float32), 1.0, 2.0), full=True)

    return work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--voxels", type=int, default=192)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    n = arguments.voxels
    grey = np.random.default_rng(0).integers(0, 255, (n, n, n)).astype(np.uint8)
    cases = {
        "ppmc": ppmc_run(grey, 1, 1, two_scales=False),
        "ppmc, stride 2": ppmc_run(grey, 2, 1, two_scales=False),
        "ppmc, stride 4": ppmc_run(grey, 4, 1, two_scales=False),
        "ppmc, two scales and side windows": ppmc_run(grey, 1, 1, two_scales=True),
        "ppmc, two threads": ppmc_run(grey, 1, 2, two_scales=False),
    }
    try:
        cases = {"structure-tensor": peer_run(grey), **cases}
    except ImportError:
        print("structure-tensor is not installed (pip install structure-tensor): no ratios")
    cpu: dict[str, list[float]] = {name: [] for name in cases}
    wall: dict[str, list[float]] = {name: [] for name in cases}
    for work in cases.values():
        work()
    for _ in range(arguments.rounds):
        for name, work in cases.items():
            start, clock = time.process_time(), time.perf_counter()
            work()
            cpu[name].append(time.process_time() - start)
            wall[name].append(time.perf_counter() - clock)
    base = float(np.median(cpu["structure-tensor"])) if "structure-tensor" in cpu else None
    print("| method | CPU s | ns/voxel | Mvoxel/core-s | ratio | wall s |")
    print("|---|---|---|---|---|---|")
    for name, times in cpu.items():
        t = float(np.median(times))
        ratio = f"{base / t:.1f}" if base else ""
        rate = f"{1e9 * t / n**3:.1f} | {n**3 / t / 1e6:.1f}"
        print(f"| {name} | {t:.3f} | {rate} | {ratio} | {np.median(wall[name]):.3f} |")


if __name__ == "__main__":
    main()
