"""Time and memory of charges: random platelets at 150 thousand and a million particles, and the map from a CT file.

    python pipelines/benchmarks/charge_speed.py seed                 random platelets
    python pipelines/benchmarks/charge_speed.py map [--file FILE]    152,592 particles from a volume of 512^3 voxels

Each case is the whole stage `charge`, file written, in a process of its own after a first small charge has compiled
the kernels; the medians of `--rounds` runs, and the most memory the process held. Wall times depend on what else
runs; CPU times are printed beside them. For `map` the search alone comes first, from opening the file to the last
direction; the rest of the stage is the digest of the file (SHA-256, on a second thread). `map` first writes a
synthetic orientations file of 3.9 GB where `--file` says (a temporary folder if left out) and keeps it there for the
next time: directions are noise, 3 % of the voxels are not valid, and confidences lie evenly between 0 and 1, so that
a threshold takes away its own share.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ppmc.charge.domains.domain import lattice_of
from ppmc.charge.orientations.from_ct import frames_from_ct
from ppmc.charge.stage import run
from ppmc.files import Provenance, VoxelGrid, VoxelWriter, read_voxels
from ppmc.scene import Scene
from ppmc.scene.loader import parse_scene

BRACKET = (93.5, 34.0, 6.0)
VOXELS = 512
SCENE = """
name: {name}
charge:
  domain: {{shape: box, size: [93.5 mm, 34 mm, 6 mm]}}
  spacing: {spacing}
  orientation: {orientation}
"""
PLATELETS = {
    "12.7 x 12.7 mm, hard walls": "{source: platelets, length: 12.7 mm, width: 12.7 mm}",
    "6.35 x 1.59 mm, hard walls": "{source: platelets, length: 6.35 mm, width: 1.59 mm}",
    "the measured state (J13)": "{source: platelets, length: 12.7 mm, width: 6.35 mm, wall_softness: 0.38,"
    " pitch: 9.5 deg, roll: 19.5 deg, on_edge: {share: 0.9, depth: 0.5 mm}}",
}
SPACINGS = {"152,592": "0.5 mm", "1,004,544": "[0.2625 mm, 0.2656 mm, 0.2727 mm]"}
MAPPED = "{{source: ct, confidence: {threshold}, fallback: {{source: nearest}}}}"


def orientations(path: Path) -> None:
    """Write an orientations file of 512^3 voxels over the bracket's charge."""
    rng, n, thick = np.random.default_rng(1), VOXELS, 32
    spacing = tuple(size / n for size in BRACKET)
    grid = VoxelGrid((n, n, n), spacing, tuple(h / 2 for h in spacing), tuple(map(tuple, np.eye(3))))
    names = ["fibre_direction", "platelet_normal", "confidence", "valid"]
    with VoxelWriter(path, "orientations", names, grid=grid, provenance=Provenance("benchmark")) as writer:
        for z in range(0, n, thick):
            shape = (thick, n, n)
            angle = np.pi * rng.random(shape, dtype=np.float32)
            p, r = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.float32)
            p[..., 0], p[..., 1], r[..., 2] = np.cos(angle), np.sin(angle), 1.0
            valid = (rng.random(shape, dtype=np.float32) < 0.97).astype(np.uint8)
            for name, values in zip(names, (p, r, rng.random(shape, dtype=np.float32), valid), strict=True):
                writer.write(name, z, values)


def measure(orientation: str, spacing: str, file: Path | None, rounds: int) -> None:
    """Print the medians of one case; run in a process of its own."""
    scene = parse_scene(SCENE.format(name="case", spacing=spacing, orientation=orientation))
    warm = parse_scene(SCENE.format(name="warm", spacing="3 mm", orientation=orientation))
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "charge.vtkhdf"
        run(warm, input=file, output=output)
        if file is not None:
            print(f"search {timed(lambda: search(scene, file), rounds)}; stage ", end="")
        print(timed(lambda: run(scene, input=file, output=output), rounds), end="")
    print(f", {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB", flush=True)


def search(scene: Scene, file: Path) -> None:
    """Find the nearest valid voxel of each particle and take its directions."""
    section = scene.require("charge")
    lattice = lattice_of(section)
    with read_voxels(file, "orientations") as source:
        frames_from_ct(section.orientation, source, lattice.positions, lattice.spacing, np.random.default_rng(0))


def timed(work: Callable[[], Any], rounds: int) -> str:
    """Return the medians of wall and CPU time."""
    wall, cpu = [], []
    for _ in range(rounds):
        start = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - start[0])
        cpu.append(time.process_time() - start[1])
    return f"{np.median(wall):.2f} s wall, {np.median(cpu):.2f} s CPU"


def in_process(orientation: str, spacing: str, rounds: int, file: Path | None = None) -> None:
    """Measure one case in a process of its own."""
    extra = ["--file", str(file)] if file is not None else []
    command = [sys.executable, __file__, "one", "--orientation", orientation, "--spacing", spacing, *extra]
    subprocess.run([*command, "--rounds", str(rounds)], check=True)


def main() -> None:
    """Run the cases asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", choices=["seed", "map", "one"], help="`one` is what the others start for each case")
    parser.add_argument("--file", type=Path, help="orientations file of 512^3 voxels")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--orientation", default="")
    parser.add_argument("--spacing", default="0.5 mm")
    asked = parser.parse_args()
    if asked.case == "one":
        measure(asked.orientation, asked.spacing, asked.file, asked.rounds)
    elif asked.case == "seed":
        for name, orientation in PLATELETS.items():
            for count, spacing in SPACINGS.items():
                print(f"{count:>9} particles, {name}: ", end="", flush=True)
                in_process(orientation, spacing, asked.rounds)
    else:
        file = asked.file or Path(tempfile.gettempdir()) / "ppmc-benchmark-orientations-512.vtkhdf"
        if not file.exists():
            orientations(file)
        for threshold in (0.0, 0.2, 0.5, 0.9):
            print(f"152,592 particles from {VOXELS}^3 voxels, threshold {threshold}: ", end="", flush=True)
            in_process(MAPPED.format(threshold=threshold), "0.5 mm", asked.rounds, file)


if __name__ == "__main__":
    main()
