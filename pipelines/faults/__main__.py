"""Faults on purpose: kills, full disks, limits, signals, second jobs, edits, changed files, and what comes of them.

    python pipelines/faults            the whole campaign (one to two hours)
    python pipelines/faults --short    a few of each kind (minutes)

Each try runs `ppmc` on a small scene, puts in one fault, runs the same command again, and compares every file with that
of an unbroken run. The table counts how often that was right; anything else makes the exit code 1. Faults at single
system calls need strace; without it these rows are left out, and said to be.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from bench import PRODUCTS, STAGES, Bench
from calls import at_calls, half_written, limited
from interruptions import lost_terminal, signals, stopped, streams, twice
from mutations import changed_files, growing, through_commands
from others import edits, pairs

Row = tuple[str, str, Callable[[], Iterator[str]]]


def campaign(bench: Bench, tries: int, notes: list[str]) -> Iterator[Row]:
    """Yield every row: fault, stage, and what runs it; `tries` is the number of kills a stage."""
    few, some = max(1, tries // 20), max(1, tries // 10)
    if shutil.which("strace") is None:
        print("strace is not there: no faults at single system calls", file=sys.stderr)
    else:
        for stage in STAGES:
            yield "kill at a call", stage, lambda s=stage: at_calls(bench, s, "signal=SIGKILL", tries)
        for stage in STAGES:
            for error in ("ENOSPC", "EIO"):
                yield f"{error} from a call on", stage, lambda s=stage, e=error: at_calls(bench, s, f"error={e}", some)
    for stage in STAGES:
        yield "limit on file sizes", stage, lambda s=stage: limited(bench, s, few)
        yield "writes of a part", stage, lambda s=stage: half_written(bench, s, min(2, few))
    for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1):
        for stage in STAGES:
            yield f"{number.name} at random", stage, lambda s=stage, n=number: signals(bench, s, n, few)
    for stage in STAGES:
        yield "Ctrl-C twice", stage, lambda s=stage: twice(bench, s, few)
        yield "stopped, and on", stage, lambda s=stage: stopped(bench, s, min(2, few))
        yield "terminal closed", stage, lambda s=stage: lost_terminal(bench, s, min(2, few))
        yield "streams closed or full", stage, lambda s=stage: streams(bench, s, min(4, few))
    for stage in ("charge", "solve"):
        yield "two jobs", stage, lambda s=stage: refusals(bench, s, max(1, tries // 2), notes)
    yield "edit of what is named", "run", lambda: edits(bench, max(3, tries * 2 // 5))
    for kind, path in products(bench).items():
        yield "changed file, read", kind, lambda k=kind, p=path: changed_files(bench, k, p, 4 * tries, Counter())
    yield "changed file, command", "all", lambda: through_commands(bench, tries * 3 // 2)


def products(bench: Bench) -> dict[str, Path]:
    """Return a file of every product that there is."""
    found = growing(bench)
    for product in PRODUCTS.values():
        found[product] = bench.folder / f"changed-{product}.vtkhdf"
        found[product].write_bytes(bench.whole[f"{product}.vtkhdf"])
    return found


def refusals(bench: Bench, stage: str, tries: int, notes: list[str]) -> Iterator[str]:
    """Run pairs of jobs, and note how long those that were refused took."""
    seconds: list[tuple[float, float]] = []
    yield from pairs(bench, stage, tries, seconds)
    if seconds:
        lived, computed = (sorted(column) for column in zip(*seconds, strict=True))
        notes.append(
            f"two jobs, {stage}: {len(seconds)} were refused, after {lived[len(lived) // 2]:.1f} s "
            f"({computed[len(computed) // 2]:.1f} s of computing) in the middle, {lived[-1]:.1f} s at most"
        )


def main() -> None:
    """Run the campaign and print its table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--short", action="store_true", help="a few of each kind")
    options.add_argument("--only", default="", help="rows whose fault or stage holds this text")
    options.add_argument("--tries", type=int, help="kills a stage; the other rows follow (100; short: 3)")
    given = options.parse_args()
    tries = given.tries or (3 if given.short else 100)
    failed, notes = 0, list[str]()
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        bench = Bench(Path(folder))
        print(f"{'fault':24} {'stage':12} {'tries':>6} {'right':>6}", flush=True)
        for fault, stage, run in campaign(bench, tries, notes):
            if given.only not in f"{fault} {stage}":
                continue
            found = list(run())
            wrong = Counter(text for text in found if text)
            failed += sum(wrong.values())
            print(f"{fault:24} {stage:12} {len(found):6} {len(found) - sum(wrong.values()):6}", flush=True)
            for text, count in wrong.most_common(5):
                print(f"    {count} x {text}", flush=True)
    print("\n".join(notes))
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
