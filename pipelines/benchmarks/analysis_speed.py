"""Speed of region averages and of a whole report.

    python pipelines/benchmarks/analysis_speed.py            1M particles x 360 regions
    python pipelines/benchmarks/analysis_speed.py --report   the report of a 152,592-particle run (the bracket of J)
    python pipelines/benchmarks/analysis_speed.py --all      the same with every view, film, browser scene, two other
                                                             runs and a mesh of 8,000 elements

Wall times depend on what else runs; CPU times are printed beside them. Compilation is done before the clock starts.
"""

from __future__ import annotations

import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from ppmc.analysis.averages.averages import region_averages
from ppmc.analysis.averages.regions import box, cylinder, sphere
from ppmc.files import Provenance, SeriesWriter
from ppmc.orientation import normalise, push_affine, push_normal
from ppmc.particles import Particles

BRACKET = (187, 68, 12)
SPACING = 0.5


def averages() -> None:
    """Time sectors round a hole, balls along a circle and slices of the base."""
    rng, n = np.random.default_rng(1), 1_000_000
    x = rng.uniform([0, 0, 0], [90, 34, 6], (n, 3))
    ids = rng.integers(0, 5000, n)
    s = Particles(
        "s", x, rng.uniform(0.1, 1, n), normalise(rng.normal(size=(n, 3))), normalise(rng.normal(size=(n, 3))), ids
    )
    turn = np.radians(np.arange(360))
    cases = {
        "sectors": [cylinder("s", [45, 17, 3], [0, 0, 1], 6, 16, 6, a, a + np.radians(10)) for a in turn],
        "balls": [sphere("s", [45 + 12 * np.cos(a), 17 + 12 * np.sin(a), 3], 4) for a in turn],
        "slices": [box("s", [k / 4, 0, 0], [(k + 1) / 4, 34, 6]) for k in range(360)],
    }
    for name, regions in cases.items():
        region_averages(s, regions[:1])
        wall, cpu = time.perf_counter(), time.process_time()
        found = region_averages(s, regions)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        print(
            f"1M particles x 360 {name}: {wall:.2f} s wall, {cpu:.2f} s CPU, {found.particle_count.mean():.0f} a region"
        )


PLAIN = "name: benchmark\nanalysis: {frames: all, path: {axis: x1, slices: 50}}"
EVERYTHING = """
name: benchmark
analysis:
  frames: all
  paths:
    base: {axis: x1, slices: 50}
    hole: {kind: circle, centre: [46, 17, 1.5], axis: [0, 0, 1], zero: [1, 0, 0], inner_radius: 6, outer_radius: 16,
           height: 6, points: 72}
    across: {kind: swept, along: x2, sweep: x1, length: 30, width: 2, centre: 17}
  views: [fibre_direction, platelet_normal, dominant_direction, iso_surface, platelets, maps, fill_time, knit_line,
          difference]
  cuts: {middle: {point: [46, 17, 1], normal: [0, -1, 0]}}
  animation: true
  interactive: true
  mesh: {path: part.vtu, method: average, formats: [vtu, abaqus, gmsh]}
"""
MESH_EDGES = (101, 41, 3)


def write_mesh(path: Path, size: tuple[float, float, float]) -> None:
    """Write a block of bricks."""
    import meshio

    axes = [np.linspace(0, s, n) for s, n in zip(size, MESH_EDGES, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    node = np.arange(len(points)).reshape(MESH_EDGES)
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    i, j, k = (n - 1 for n in MESH_EDGES)
    cells = [node[a : a + i, b : b + j, c : c + k].ravel() for c in (0, 1) for a, b in corners]
    meshio.write(path, meshio.Mesh(points, [("hexahedron", np.column_stack(cells))]))


def report(everything: bool) -> None:
    """Time the whole stage on an affine squeeze with six frames."""
    from ppmc.analysis.stage import run
    from ppmc.scene import parse_scene

    x = np.stack(np.meshgrid(*(np.arange(0.5, n) * SPACING for n in BRACKET), indexing="ij"), -1).reshape(-1, 3)
    n, rng = len(x), np.random.default_rng(3)
    ids = (
        (x[:, 0] // 12).astype(np.int64)
        + 10 * (x[:, 1] // 6).astype(np.int64)
        + 100 * (x[:, 2] // 0.5).astype(np.int64)
    )
    angle = rng.uniform(0, np.pi, ids.max() + 1)[ids]
    p, r = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), np.tile([0.0, 0.0, 1.0], (n, 1))
    static = {"platelet_id": ids, "reference_position": x, "volume": np.full(n, SPACING**3)}
    names = ("fibre_direction", "platelet_normal", "deformation_gradient", "volume_ratio", "velocity", "pressure")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        writer = SeriesWriter.create(
            path / "p.vtkhdf", n, static, names, ("press_force",), provenance=Provenance("benchmark")
        )
        for t in np.linspace(0, 1, 6):
            F = np.broadcast_to(np.diag([(1 - t / 2) ** -0.5, (1 - t / 2) ** -0.5, 1 - t / 2]), (n, 3, 3))
            fields = {
                "fibre_direction": push_affine(p, F),
                "platelet_normal": push_normal(r, F),
                "deformation_gradient": F.reshape(n, 9),
                "volume_ratio": np.ones(n),
                "velocity": np.zeros((n, 3)),
                "pressure": np.zeros(n),
            }
            writer.append(t, x @ F[0].T, fields, {"press_force": 1e8})
        writer.seal(path / "flow.vtkhdf")
        scene = parse_scene(EVERYTHING if everything else PLAIN, path / "scene.yaml")
        others = [path / name / "flow.vtkhdf" for name in ("second", "third")] if everything else []
        for other in others:
            other.parent.mkdir()
            shutil.copy(path / "flow.vtkhdf", other)
        write_mesh(path / "part.vtu", tuple((x @ F[0].T).max(axis=0)))
        wall = time.perf_counter()
        output = path / "out" / "analysis.vtkhdf"
        run(scene, input=path / "flow.vtkhdf", output=output, compare=others[:1], seeds=others[1:])
        own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    print(
        f"report of {n:,} particles: {time.perf_counter() - wall:.1f} s wall; "
        f"{own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime:.1f} s CPU with making the file; "
        f"{max(own.ru_maxrss, children.ru_maxrss) / 1024:.0f} MiB"
    )


if __name__ == "__main__":
    if {"--report", "--all"} & set(sys.argv):
        report("--all" in sys.argv)
    else:
        averages()
