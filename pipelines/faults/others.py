"""Other jobs, other inputs: two writers of one output, and edits of files that a scene names."""

from __future__ import annotations

import os
import random
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from bench import STORAGE, TIMEOUT, Bench, Job, last_line

NAMING = """\
name: named
seed: 1
charge:
  domain: {shape: mesh, file: domain.stl}
  spacing: 0.6 mm
  orientation: {source: file, file: points.csv}
tooling:
  lower: {shape: mesh, file: tool.stl}
  ram: {shape: plane, point: [0, 0, 2.4 mm], normal: [0, 0, -1], motion: {velocity: [0, 0, -1 mm/s]}}
material: {model: transversely_isotropic, shear_viscosity: 1 Pa*s, anisotropy_ratio: 20}
solver: {end_time: 0.02 s, output_interval: 0.02 s}
analysis: {path: {kind: straight, axis: x1, slices: 3}, views: [], mesh: {path: part.inp}}
"""
STAGES = ("charge", "solve", "analyze")
FACES = (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2)
FACES = (*FACES, (1, 3, 7), (1, 7, 5))
CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)


def pairs(bench: Bench, stage: str, tries: int, seconds: list[tuple[float, float]]) -> Iterator[str]:
    """Start two jobs on one output, 0 to 2 s apart; yield what was wrong: one must win, the other name it.

    `seconds` takes of each job that was refused how long it lived and what it computed in that time.
    """
    draw = random.Random(1)
    for _ in range(tries):
        run = bench.clear(stage)
        jobs = []
        for k, wait in enumerate((0.0, draw.uniform(0.0, 2.0))):
            time.sleep(wait)
            with (bench.folder / f"told{k}").open("w") as told:
                job = subprocess.Popen(bench.command(stage), cwd=bench.folder, stdout=subprocess.DEVNULL, stderr=told)
            jobs.append((job, time.monotonic()))
        ends: dict[int, tuple[int, float, float]] = {}
        while len(ends) < 2:
            for k, (job, begin) in enumerate(jobs):
                if k not in ends:
                    done, status, used = os.wait4(job.pid, os.WNOHANG)
                    if done:
                        job.returncode = os.waitstatus_to_exitcode(status)
                        lived = time.monotonic() - begin
                        ends[k] = job.returncode, lived, used.ru_utime + used.ru_stime
            if time.monotonic() - jobs[1][1] > TIMEOUT:
                raise TimeoutError("a pair of jobs does not end")
            time.sleep(0.005)
        texts = [(bench.folder / f"told{k}").read_text() for k in range(2)]
        codes = sorted(code for code, _, _ in ends.values())
        seconds += [end[1:] for end in ends.values() if end[0] == STORAGE]
        named = any("is writing it" in text and "process" in text for text in texts)
        # Apart by more than the work takes, the second finds everything unchanged.
        fine = (codes == [0, STORAGE] and named) or (codes == [0, 0] and "unchanged" in texts[1])
        product = bench.product(stage)
        whole = (run / product).read_bytes() == bench.whole[product]
        yield "" if fine and whole else f"exit codes {codes}, {[last_line(text) for text in texts]}, whole: {whole}"


def write_cube(path: Path, size: tuple[float, ...], corner: tuple[float, ...]) -> None:
    """Write a box as ASCII STL."""
    points = np.array(corner) + np.array(size) * CORNERS
    lines = ["solid box"]
    for face in FACES:
        corners = "".join("vertex {:g} {:g} {:g}\n".format(*points[k]) for k in face)
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid box", ""]))


def write_points(path: Path, angle: float) -> None:
    """Write orientations at the corners of a grid, fibres at an angle to x1, degrees."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    rows = [f"{x},{y},{z},{c:.6f},{s:.6f},0,0,0,1" for x in range(5) for y in range(4) for z in range(3)]
    path.write_text("\n".join(["x1,x2,x3,p1,p2,p3,r1,r2,r3", *rows, ""]))


def write_mesh(path: Path, height: float) -> None:
    """Write a structural mesh whose nodes stand in a file that it includes."""
    path.write_text(f"*NODE, INPUT={path.stem}_nodes.inp\n*ELEMENT, TYPE=C3D8\n1, 1, 2, 4, 3, 5, 6, 8, 7\n")
    nodes = [f"{k + 1}, {4 * x:g}, {3 * y:g}, {height * z:g}" for k, (x, y, z) in enumerate(CORNERS)]
    path.with_name(f"{path.stem}_nodes.inp").write_text("\n".join([*nodes, ""]))


def edits(bench: Bench, tries: int) -> Iterator[str]:
    """Edit what a scene names, directly or through another file; yield what was wrong with what was computed anew."""
    folder = bench.folder / "named"
    folder.mkdir(exist_ok=True)
    scene = folder / "scene.yaml"
    scene.write_text(NAMING)
    write_cube(folder / "domain.stl", (4, 3, 2.4), (0, 0, 0))
    write_cube(folder / "tool.stl", (40, 40, 5), (-15, -15, -5))
    write_points(folder / "points.csv", 0.0)
    write_mesh(folder / "part.inp", 2.0)

    def in_scene(old: str, new: str) -> None:
        text = scene.read_text()
        scene.write_text(text.replace(old, new) if old in text else text.replace(new, old))

    def damaged(name: str, k: int) -> None:
        data = bytearray((folder / "run" / name).read_bytes())
        data[(k + 1) * len(data) // 50] ^= 1
        (folder / "run" / name).write_bytes(data)

    # What is edited, and the stages that must run anew; later stages do if their input came out otherwise.
    kinds: tuple[tuple[Callable[[int], None], tuple[str, ...]], ...] = (
        (lambda k: write_points(folder / "points.csv", k + 1.0), STAGES),
        (lambda k: write_cube(folder / "domain.stl", (4 - 0.01 * k, 3, 2.4), (0, 0, 0)), STAGES),
        # While the scene is the one that it was made from, which it keeps: it comes out as it was.
        (lambda k: damaged("charge.vtkhdf", k), ("charge",)),
        (lambda k: write_cube(folder / "tool.stl", (40, 40 + k, 5), (-15, -15, -5)), ("solve", "analyze")),
        (lambda k: write_mesh(folder / "part.inp", 2.0 + 0.01 * k), ("analyze",)),
        (lambda _: in_scene("anisotropy_ratio: 20", "anisotropy_ratio: 21"), ("solve", "analyze")),
        (lambda _: in_scene("slices: 3", "slices: 4"), ("analyze",)),
        (lambda k: damaged("report.html", k), ("analyze",)),
        (lambda _: scene.write_text(f"{scene.read_text()}# a comment\n"), ()),
        (lambda _: [p.touch() for p in folder.iterdir() if p.is_file()] and None, ()),  # type: ignore[func-returns-value]
    )

    def made_anew() -> tuple[str, ...] | str:
        job = Job(["run", str(scene), "--workdir", str(folder / "run")], folder)
        if job.wait() != 0:
            return f"exit code {job.code}, {last_line(job.told)}"
        return tuple(stage for stage in STAGES if f"{stage}: writing" in job.told)

    made_anew()
    for k in range(tries):
        edit, expected = kinds[k % len(kinds)]
        edit(k)
        found = made_anew()
        again = made_anew()
        yield "" if (found, again) == (expected, ()) else f"edit {k}: {found} for {expected}, then {again}"
