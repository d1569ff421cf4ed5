"""Faults at single system calls, put in by strace: death, a full disk, an I/O error; and writes of half the bytes."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from bench import STORAGE, Bench, Job, wrong_end

# The calls that change what is on the disk; all others leave it as the one before has left it.
CALLS = ("pwrite64", "write", "fsync", "rename", "unlink", "unlinkat", "ftruncate", "mkdir", "rmdir")


def traced(bench: Bench, stage: str, options: list[str]) -> Job:
    """Start a stage under strace."""
    job = bench.start(stage, held=True)
    trace = ["strace", "-f", "-q", *options, "-p", str(job.pid)]
    strace = subprocess.Popen(trace, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    status = Path(f"/proc/{job.pid}/status")
    end = time.monotonic() + 20.0
    while re.search(r"TracerPid:\t0\n", status.read_text()):
        if strace.poll() is not None or time.monotonic() > end:
            os.kill(job.pid, signal.SIGKILL)
            raise RuntimeError("strace cannot trace here")
        time.sleep(0.002)
    os.kill(job.pid, signal.SIGCONT)
    job.wait()
    strace.wait()
    return job


def calls_of(bench: Bench, stage: str) -> Counter[str]:
    """Return how often a stage makes each of the calls."""
    bench.clear(stage)
    log = bench.folder / "trace"
    traced(bench, stage, ["-o", str(log), "-e", f"trace={','.join(CALLS)}"])
    return Counter(re.findall(r"^\d+ +(\w+)\(", log.read_text(errors="replace"), re.MULTILINE))


def places_of(counts: Counter[str], tries: int) -> list[tuple[str, int]]:
    """Return calls by name and number: of rare kinds up to all, of frequent ones evenly spread ones."""
    kinds = sorted((call for call in CALLS if counts[call]), key=lambda call: counts[call])
    places: list[tuple[str, int]] = []
    for k, call in enumerate(kinds):
        share = min(counts[call], (tries - len(places)) // (len(kinds) - k))
        places += [(call, 1 + i * counts[call] // share) for i in range(share)]
    return places


def at_calls(bench: Bench, stage: str, fault: str, tries: int) -> Iterator[str]:
    """Put a fault at system calls of a stage, each in a run of its own; yield what was wrong after each."""
    for call, k in places_of(calls_of(bench, stage), tries):
        bench.clear(stage)
        when = f"{k}+" if "error" in fault else str(k)
        job = traced(
            bench, stage, ["-o", os.devnull, "-e", f"trace={call}", "-e", f"inject={call}:{fault}:when={when}"]
        )
        allowed = (0, STORAGE) if "error" in fault else (0, -signal.SIGKILL)
        if wrong := wrong_end(job.wait(), job.told, allowed) or bench.finish(stage):
            wrong = f"{call} {k}: {wrong}"
        yield wrong


def limited(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Limit the size of files; yield what was wrong after each."""
    largest = max(len(data) for data in bench.whole.values())
    for k in range(tries):
        bench.clear(stage)
        most = max(512, largest * (k + 1) // (tries + 1))

        def limit(most: int = most) -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))

        job = bench.start(stage, prepare=limit)
        wrong = wrong_end(job.wait(), job.told, (0, STORAGE)) or bench.finish(stage)
        yield f"{most} bytes: {wrong}" if wrong else ""


def half_written(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Let the system write less than it is asked to, which it may; yield what was wrong after each run."""
    real = os.pwrite
    for k in range(tries):
        bench.clear(stage)

        def some(file: int, data: memoryview, offset: int, k: int = k) -> int:
            return real(file, data[: max(1, len(data) * (k + 1) // (tries + 1))], offset)

        def cut(some: object = some) -> None:
            os.pwrite = some  # type: ignore[assignment]

        job = bench.start(stage, prepare=cut)
        yield wrong_end(job.wait(), job.told, (0,)) or bench.finish(stage)
