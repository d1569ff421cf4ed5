"""Faults on purpose: kills, full disks, limits, signals, second jobs and changed bits, and what becomes of the work.

    python pipelines/faults.py            the whole campaign (hours)
    python pipelines/faults.py --short    a few of each kind (minutes)

Each try runs the installed `ppmc` on a small scene, puts in one fault, runs the same command again, and compares the
file with that of an unbroken run. The table counts how often the result was right; anything else makes the exit code 1.
Kills and errors at single system calls need strace; without it these rows are left out, and said to be.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

SCENE = """\
name: small
seed: 11
phantom:
  cavity: [6 mm, 5 mm, 2.4 mm]
  voxel_size: 0.2 mm
  platelet: {length: 4 mm, width: 2 mm, thickness: 0.6 mm}
ct: {stride: 2}
charge:
  domain: {shape: box, size: [6 mm, 5 mm, 2.4 mm]}
  spacing: 0.6 mm
  orientation: {source: ct, fallback: {source: nearest}}
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 2.4 mm], normal: [0, 0, -1], motion: {velocity: [0, 0, -1 mm/s]}}
material: {model: transversely_isotropic, shear_viscosity: 1 Pa*s, anisotropy_ratio: 20}
solver: {end_time: 0.1 s, output_interval: 0.02 s, checkpoint_interval: 0.001 s}
analysis: {path: {kind: straight, axis: x1, slices: 3}, views: []}
"""
PRODUCTS = {
    "phantom": "volume",
    "ct": "orientations",
    "charge": "charge",
    "solve": "flow",
    "analyze": "analysis",
}
CALLS = ("pwrite64", "fsync", "rename", "unlink", "ftruncate")
STORAGE, STOPPED, INTERRUPTED = 5, 75, 130
PPMC = (sys.executable, "-m", "ppmc")
TIMEOUT = 600.0


class Bench:
    """A folder with the inputs of every stage, and the file that each makes if nothing disturbs it.

    Attributes
    ----------
    folder : Path
    whole : dict of str to bytes
        The unbroken product of each stage.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "scene.yaml").write_text(SCENE)
        subprocess.run(
            [*PPMC, "run", "scene.yaml", "--workdir", "whole"], cwd=folder, check=True, capture_output=True, text=True
        )
        self.whole = {s: (folder / "whole" / f"{p}.vtkhdf").read_bytes() for s, p in PRODUCTS.items()}

    def clear(self, stage: str) -> Path:
        """Return an empty run folder with what the stage reads."""
        run = self.folder / "run"
        shutil.rmtree(run, ignore_errors=True)
        run.mkdir()
        for earlier, product in PRODUCTS.items():
            if earlier == stage:
                break
            shutil.copy2(self.folder / "whole" / f"{product}.vtkhdf", run)
        return run

    def command(self, stage: str) -> list[str]:
        """Return the command of a stage."""
        return [*PPMC, "run", "scene.yaml", "--workdir", "run", "--only", stage]

    def finish(self, stage: str) -> str:
        """Run a stage to its end and return what is wrong with the result, empty if nothing is."""
        done = subprocess.run(
            self.command(stage), cwd=self.folder, capture_output=True, text=True, check=False, timeout=TIMEOUT
        )
        if done.returncode != 0:
            return f"the same command again: {done.returncode}, {last_line(done.stderr)}"
        if (self.folder / "run" / f"{PRODUCTS[stage]}.vtkhdf").read_bytes() != self.whole[stage]:
            return "other bytes than an unbroken run"
        left = [
            p.name for p in (self.folder / "run").iterdir() if re.search(r"partial|checkpoint|\.tmp$|lock$", p.name)
        ]
        return f"left behind: {left}" if left else ""


def last_line(text: str) -> str:
    """Return the last line of a message."""
    return (text.strip().splitlines() or [""])[-1][:160]


def calls_of(bench: Bench, stage: str) -> Counter[str]:
    """Return how often a stage makes each of the calls that write."""
    bench.clear(stage)
    log = bench.folder / "trace"
    trace = ["strace", "-f", "-o", str(log), "-e", f"trace={','.join(CALLS)}"]
    subprocess.run([*trace, *bench.command(stage)], cwd=bench.folder, check=True, capture_output=True)
    return Counter(re.findall(r"^\d+ +(\w+)\(", log.read_text(errors="replace"), re.MULTILINE))


def at_calls(bench: Bench, stage: str, inject: str, tries: int) -> Iterator[str]:
    """Put a fault at evenly spread system calls of a stage; yield what was wrong after each."""
    counts = calls_of(bench, stage)
    places = [(call, k) for call in CALLS for k in range(1, counts[call] + 1)]
    for call, k in places[:: max(1, len(places) // tries)][:tries]:
        bench.clear(stage)
        when = f"{k}+" if "error" in inject else str(k)
        strace = ["strace", "-f", "-o", os.devnull, "-e", f"trace={call}", "-e", f"inject={call}:{inject}:when={when}"]
        done = subprocess.run(
            [*strace, *bench.command(stage)], cwd=bench.folder, capture_output=True, text=True, check=False,
            timeout=TIMEOUT,
        )  # fmt: skip
        clean = "Traceback" not in done.stderr and (done.returncode in (0, STORAGE) if "error" in inject else True)
        wrong = "" if clean else f"exit code {done.returncode}, {last_line(done.stderr)}"
        yield wrong or bench.finish(stage)


def random_kills(bench: Bench, stage: str, number: int, tries: int) -> Iterator[str]:
    """Send a signal at random moments; yield what was wrong after each."""
    bench.clear(stage)
    begin = time.monotonic()
    bench.finish(stage)
    length = time.monotonic() - begin
    codes = {signal.SIGTERM: STOPPED, signal.SIGHUP: STOPPED, signal.SIGINT: INTERRUPTED, signal.SIGUSR1: 0}
    draw = random.Random(number)
    for _ in range(tries):
        bench.clear(stage)
        with subprocess.Popen(
            bench.command(stage), cwd=bench.folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as job:
            # The interpreter itself needs a tenth of a second before anybody can take care of signals.
            time.sleep(draw.uniform(0.2 if number != signal.SIGKILL else 0.0, length))
            job.send_signal(number)
            _, told = job.communicate(timeout=TIMEOUT)
        fine = number == signal.SIGKILL or job.returncode in (0, codes.get(signal.Signals(number)))
        wrong = "" if fine and "Traceback" not in told else f"exit code {job.returncode}, {last_line(told)}"
        yield wrong or bench.finish(stage)


def limited(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Limit the size of files; yield what was wrong after each."""
    most = len(bench.whole[stage]) // 1024
    for k in range(tries):
        bench.clear(stage)
        line = f"ulimit -f {max(1, most * (k + 1) // (tries + 1))}; exec {' '.join(bench.command(stage))}"
        done = subprocess.run(["bash", "-c", line], cwd=bench.folder, capture_output=True, text=True, check=False)
        fine = done.returncode in (0, STORAGE) and "Traceback" not in done.stderr
        yield (f"exit code {done.returncode}, {last_line(done.stderr)}" if not fine else "") or bench.finish(stage)


def pairs(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Start two jobs on one output, 0 to 2 s apart; yield what was wrong after each pair."""
    draw = random.Random(1)
    for _ in range(tries):
        bench.clear(stage)
        jobs = []
        for wait in (0.0, draw.uniform(0.0, 2.0)):
            time.sleep(wait)
            jobs.append(
                subprocess.Popen(
                    bench.command(stage), cwd=bench.folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
                )
            )
        told = [job.communicate(timeout=TIMEOUT)[1] for job in jobs]
        codes = sorted(job.returncode for job in jobs)
        fine = codes == [0, STORAGE] and any("is writing it" in text for text in told)
        # Apart by more than the work takes, the second finds everything unchanged.
        yield "" if fine or codes == [0, 0] else f"exit codes {codes}, {[last_line(text) for text in told]}"


def changed_bits(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Change single bits of a product; yield what was wrong after each: a file that passes must be as it was."""
    from ppmc.errors import PpmcError
    from ppmc.files.describe import describe_file, verify_file

    path = bench.clear(stage) / "changed.vtkhdf"
    whole = bench.whole[stage]
    path.write_bytes(whole)
    truth = [describe_file(path), *verify_file(path)]
    draw = random.Random(2)
    for _ in range(tries):
        data = bytearray(whole)
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        path.write_bytes(data)
        try:
            wrong = "" if [describe_file(path), *verify_file(path)] == truth else "accepted, and other"
        except PpmcError:
            wrong = ""
        except Exception as error:  # whatever it is, it is not one of ours
            wrong = f"{type(error).__name__}: {error}"
        yield wrong


def campaign(bench: Bench, tries: int, flips: int) -> Iterator[tuple[str, str, Callable[[], Iterator[str]]]]:
    """Yield every row: fault, stage, and what runs it."""
    stages = tuple(PRODUCTS)
    if shutil.which("strace") is None:
        print("strace is not there: no faults at single system calls", file=sys.stderr)
    else:
        for stage in stages:
            yield "kill at a call", stage, lambda s=stage: at_calls(bench, s, "signal=SIGKILL", tries)
            for error in ("ENOSPC", "EIO"):
                yield f"{error} from a call on", stage, lambda s=stage, e=error: at_calls(bench, s, f"error={e}", tries)
    for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1):
        for stage in stages:
            name = f"{signal.Signals(number).name} at random"
            yield name, stage, lambda s=stage, n=number: random_kills(bench, s, n, max(1, tries // 4))
    for stage in stages:
        yield "limit on file sizes", stage, lambda s=stage: limited(bench, s, max(1, tries // 10))
    for stage in ("charge", "solve"):
        yield "two jobs", stage, lambda s=stage: pairs(bench, s, max(1, tries // 2))
    for stage in stages:
        yield "a changed bit", stage, lambda s=stage: changed_bits(bench, s, flips)


def main() -> None:
    """Run the campaign and print its table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--short", action="store_true", help="a few of each kind")
    options.add_argument("--only", default="", help="rows whose fault or stage holds this text")
    options.add_argument("--tries", type=int, help="faults a row")
    given = options.parse_args()
    tries = given.tries or (3 if given.short else 100)
    flips = given.tries or (20 if given.short else 600)
    failed = 0
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        bench = Bench(Path(folder))
        print(f"{'fault':24} {'stage':8} {'tries':>6} {'right':>6}", flush=True)
        for fault, stage, run in campaign(bench, tries, flips):
            if given.only not in f"{fault} {stage}":
                continue
            found = list(run())
            wrong = Counter(text for text in found if text)
            failed += sum(wrong.values())
            print(f"{fault:24} {stage:8} {len(found):6} {len(found) - sum(wrong.values()):6}", flush=True)
            for text, count in wrong.most_common(5):
                print(f"    {count} x {text}", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
