"""From a TIFF stack to a file of orientations: CPU time of ppmc and of structure-tensor with h5py, on one thread.

    python pipelines/benchmarks/ct_end_to_end.py [--voxels 256] [--rounds 3]

A volume of streaks along z with noise, uint8. structure-tensor reads it with tifffile, works with sigma 1 and rho 2,
and writes eigenvalues and vectors with h5py, uncompressed. ppmc runs as `ppmc ct` does, for p with eigenvalues
(``normals: false``), with normals from the same fixed window (``follow: false``), and as it is by default. The first
round, in which kernels are compiled, is not counted.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import h5py
import numpy as np
import tifffile

from ppmc.ct.stage import run
from ppmc.scene import Scene

CASES = {"p with eigenvalues": {"normals": False}, "with normals": {"follow": False}, "default": {}}


def peer(source: Path, output: Path, *, full: bool) -> Callable[[], None]:
    from structure_tensor import eig_special_3d, structure_tensor_3d

    def work() -> None:
        tensor = structure_tensor_3d(tifffile.imread(source).astype(np.float32), 1.0, 2.0)
        values, vectors = eig_special_3d(tensor, full=full)
        with h5py.File(output, "w") as file:
            file["eigenvalues"], file["vectors"] = values, vectors

    return work


def ours(source: Path, output: Path, section: dict[str, bool]) -> Callable[[], None]:
    ct = {"source": {"path": str(source), "voxel_size": 1.0}, "threads": 1, **section}
    return lambda: run(Scene(name="benchmark", ct=ct), output=output) and None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--voxels", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    from scipy.ndimage import gaussian_filter

    n = arguments.voxels
    rng = np.random.default_rng(0)
    grey = gaussian_filter(rng.standard_normal((n, n, n)).astype(np.float32), (3, 1, 1))
    grey = 120 + 30 * grey / grey.std() + 8 * rng.standard_normal(grey.shape, dtype=np.float32)
    with tempfile.TemporaryDirectory() as folder:
        source, output, other = (Path(folder) / name for name in ("volume.tif", "o.vtkhdf", "o.h5"))
        tifffile.imwrite(source, np.clip(grey, 0, 255).astype(np.uint8), photometric="minisblack")
        del grey
        works = {f"ppmc, {name}": ours(source, output, section) for name, section in CASES.items()}
        for full in (False, True):
            works[f"structure-tensor, {'all vectors' if full else 'p'}"] = peer(source, other, full=full)
        times: dict[str, list[float]] = {name: [] for name in works}
        sizes = {}
        for turn in range(arguments.rounds + 1):
            for name, work in works.items():
                start = time.process_time()
                work()
                if turn > 0:
                    times[name].append((time.process_time() - start) * 1e9 / n**3)
                sizes[name] = (output if "ppmc" in name else other).stat().st_size / n**3
    print("| | CPU ns a voxel | B a voxel | ratio to structure-tensor |")
    print("|---|---|---|---|")
    for name, found in times.items():
        base = times["structure-tensor, p" if "eigenvalues" in name else "structure-tensor, all vectors"]
        ratio = f"{np.median(base) / np.median(found):.1f}" if "ppmc" in name else ""
        print(f"| {name} | {np.median(found):.0f} | {sizes[name]:.1f} | {ratio} |")


if __name__ == "__main__":
    main()
