"""Changed files, as the stages read them: refused, or as they were."""

from __future__ import annotations

import hashlib
import os
import random
import resource
import shutil
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from bench import PRODUCTS, Bench, Job, files_of, wrong_end
from changes import change, datasets

SECONDS, MEMORY = 20, 2**31
WRONG, REFUSED, SAME = 1, 3, 0


def content_of(kind: str, path: Path) -> str:
    """Return a digest of all that the stages can read from a product."""
    from ppmc.files import open_series, read_particles, read_state, read_voxels

    read: list[Any] = []
    if kind in ("volume", "orientations"):
        with read_voxels(path, kind) as voxels:
            read = [voxels.names, voxels.grid, voxels.provenance, *(voxels.read(name) for name in voxels.names)]
    elif kind == "charge":
        charge = read_particles(path, kind)
        read = [charge.positions, charge.fields, charge.extra, charge.provenance]
    elif kind == "checkpoint":
        read = [*read_state(path)]
    else:
        product = kind if kind in ("flow", "analysis") else "flow"
        with open_series(path if kind == product else path.parent, product) as series:
            read = [series.names, series.static, series.scalars, series.history, series.extra, series.provenance]
            read += [series.times, *(series.frame(k) for k in range(len(series.times)))]
    digest = hashlib.sha256()
    _feed(digest, read)
    return digest.hexdigest()


def _feed(digest: Any, item: Any) -> None:
    if isinstance(item, np.ndarray):
        digest.update(f"{item.dtype} {item.shape}".encode() + np.ascontiguousarray(item).tobytes())
    elif isinstance(item, dict):
        for key in sorted(item):
            digest.update(str(key).encode())
            _feed(digest, item[key])
    elif isinstance(item, list | tuple):
        for part in item:
            _feed(digest, part)
    else:
        digest.update(repr(item).encode())


def in_child(work: Callable[[], int]) -> int:
    """Return what some work says in a process of its own, bounded in memory and time; minus a signal's number."""
    child = os.fork()
    if child == 0:
        code = WRONG
        try:
            resource.setrlimit(resource.RLIMIT_AS, (_size() + MEMORY, resource.RLIM_INFINITY))
            signal.alarm(SECONDS)
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _size() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def growing(bench: Bench) -> dict[str, Path]:
    """Return a checkpoint, and header and frame of a growing flow, as a run that stops leaves them."""
    run = bench.clear("solve")

    def stop() -> None:
        from ppmc.solver.run.simulation import Simulation

        real = Simulation._save

        def save(self: Simulation) -> None:
            real(self)
            if self.time > 0.03:
                os._exit(0)

        Simulation._save = save  # type: ignore[method-assign]

    bench.start("solve", prepare=stop).wait()
    kept = bench.folder / "stopped"
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(run, kept)
    partial = kept / "flow.partial"
    return {
        "checkpoint": kept / "flow.checkpoint-a.h5ckpt",
        "header": partial / "header.vtkhdf",
        "frame": partial / "frame_000001.vtkhdf",
    }


def changed_files(bench: Bench, kind: str, path: Path, tries: int, counted: Counter[str]) -> Iterator[str]:
    """Change a product in many ways and read it; yield what was wrong: it must be refused, or be as it was."""
    whole, truth = path.read_bytes(), content_of(kind, path)
    draw = random.Random(f"changes {kind}")
    told = bench.folder / "told"

    def read() -> int:
        from ppmc.errors import PpmcError

        try:
            return SAME if content_of(kind, path) == truth else WRONG
        except PpmcError:
            return REFUSED
        except BaseException as error:
            told.write_text(f"{type(error).__name__}: {error}"[:160])
            return WRONG

    done = 0
    while done < tries:
        path.write_bytes(whole)
        how = change(path, draw)
        if not how or path.read_bytes() == whole:
            continue
        done += 1
        told.write_text("accepted, and other")
        code = in_child(read)
        counted[{SAME: "the same", REFUSED: "refused"}.get(code, "wrong")] += 1
        if code not in (SAME, REFUSED):
            keep = bench.folder / f"wrong-{kind}-{done}"
            shutil.copy(path, keep)
        yield "" if code in (SAME, REFUSED) else f"{how}: {told.read_text() if code > 0 else f'signal {-code}'}"
    path.write_bytes(whole)


READERS = {
    "phantom": ("ct", "charge", "analyze"),
    "ct": ("charge", "analyze"),
    "charge": ("solve",),
    "solve": ("analyze",),
}


def through_commands(bench: Bench, tries: int) -> Iterator[str]:
    """Change an input of a stage and run the command; yield what was wrong: a refusal, or the right result."""
    draw = random.Random("commands")
    stopped = growing(bench)
    for k in range(tries):
        if k % 3 == 2:
            stage, kind = "solve", draw.choice(sorted(stopped))
            shutil.rmtree(bench.folder / "run")
            shutil.copytree(bench.folder / "stopped", bench.folder / "run")
            path = bench.folder / "run" / stopped[kind].relative_to(bench.folder / "stopped")
        else:
            maker = draw.choice(sorted(READERS))
            stage, kind = draw.choice(READERS[maker]), PRODUCTS[maker]
            path = bench.clear(stage) / f"{kind}.vtkhdf"
        how = change(path, draw)
        job = Job([*bench.arguments(stage)], bench.folder, prepare=lambda: signal.alarm(0))
        wrong = wrong_end(job.wait(), job.told, (0, 2, 3))
        product = f"{PRODUCTS[stage]}.vtkhdf"
        found = files_of(bench.folder / "run")
        if not wrong and job.code == 0 and found.get(product) != bench.whole[product]:
            # The input's own digest is part of what a product says of its origin.
            wrong = "" if same_values(bench, product) else "another result"
        yield f"{stage}, {kind}, {how}: {wrong}" if wrong else ""


def same_values(bench: Bench, product: str) -> bool:
    """Return whether two products hold the same fields, whatever they say of their inputs' bytes."""
    with h5py.File(bench.folder / "run" / product, "r") as a, h5py.File(bench.folder / "whole" / product, "r") as b:
        names = [name for name in datasets(b) if not name.startswith("ppmc/")]
        return all(name in a and np.array_equal(a[name][()], b[name][()], equal_nan=True) for name in names)
