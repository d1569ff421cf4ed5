"""Signals at any moment, from the start of the process to its end; stops; terminals and streams that go away."""

from __future__ import annotations

import os
import pty
import random
import signal
import subprocess
import time
from collections.abc import Callable, Iterator

from bench import INTERRUPTED, STOPPED, TIMEOUT, Bench, wrong_end

# The interpreter needs this long before anybody can take care of signals.
DEAF_SECONDS = 0.2
CODES = {signal.SIGTERM: STOPPED, signal.SIGHUP: STOPPED, signal.SIGINT: INTERRUPTED, signal.SIGUSR1: 0}


def length_of(bench: Bench, stage: str) -> float:
    """Return how long a stage takes from the start of its process, s."""
    bench.clear(stage)
    begin = time.monotonic()
    with bench.process(stage) as job:
        job.communicate(timeout=TIMEOUT)
    return time.monotonic() - begin


def signals(bench: Bench, stage: str, number: signal.Signals, tries: int) -> Iterator[str]:
    """Send a signal at random moments; yield what was wrong after each."""
    length = length_of(bench, stage)
    draw = random.Random(number)
    for _ in range(tries):
        bench.clear(stage)
        when = draw.uniform(0.0 if number == signal.SIGKILL else DEAF_SECONDS, length)
        with bench.process(stage) as job:
            time.sleep(when)
            job.send_signal(number)
            _, told = job.communicate(timeout=TIMEOUT)
        allowed = (0, -signal.SIGKILL) if number == signal.SIGKILL else (0, CODES[number])
        wrong = wrong_end(job.returncode, told, allowed) or bench.finish(stage)
        yield f"after {when:.1f} s: {wrong}" if wrong else ""


def twice(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Send a second Ctrl-C right after the first; yield what was wrong after each."""
    length = length_of(bench, stage)
    draw = random.Random("twice")
    for _ in range(tries):
        bench.clear(stage)
        with bench.process(stage) as job:
            time.sleep(draw.uniform(DEAF_SECONDS, length))
            for _ in range(2):
                job.send_signal(signal.SIGINT)
                time.sleep(draw.uniform(0.0, 0.1))
            _, told = job.communicate(timeout=TIMEOUT)
        yield wrong_end(job.returncode, told, (0, INTERRUPTED)) or bench.finish(stage)


def stopped(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Stop a job and let it go on, several times; yield what was wrong after each."""
    length = length_of(bench, stage)
    draw = random.Random("stop")
    for _ in range(tries):
        bench.clear(stage)
        with bench.process(stage) as job:
            for _ in range(3):
                time.sleep(draw.uniform(0.0, length / 3))
                job.send_signal(signal.SIGSTOP)
                time.sleep(0.2)
                job.send_signal(signal.SIGCONT)
            _, told = job.communicate(timeout=TIMEOUT)
        yield wrong_end(job.returncode, told, (0,)) or bench.finish(stage)


def lost_terminal(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Close the terminal that a job writes to; it hangs up (75), or goes on if it was told to ignore that (nohup)."""
    for k in range(tries):
        bench.clear(stage)
        ours, theirs = pty.openpty()

        def begin(theirs: int = theirs, ignoring: bool = k % 2 == 1) -> None:
            os.setsid()
            os.dup2(theirs, 0)
            if ignoring:
                signal.signal(signal.SIGHUP, signal.SIG_IGN)

        job = subprocess.Popen(
            bench.command(stage), cwd=bench.folder, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=begin
        )
        os.close(theirs)
        time.sleep(0.5)
        os.close(ours)
        code = job.wait(TIMEOUT)
        yield wrong_end(code, "", (0, STOPPED)) or bench.finish(stage)


def streams(bench: Bench, stage: str, tries: int) -> Iterator[str]:
    """Give a job closed and full streams; yield what was wrong after each: it must do its work all the same."""

    def closed(*numbers: int) -> Callable[[], None]:
        return lambda: [os.close(number) for number in numbers] and None  # type: ignore[func-returns-value]

    ways: tuple[tuple[Callable[[], None] | None, str], ...] = (
        (closed(1), os.devnull),
        (closed(2), os.devnull),
        (closed(0, 1, 2), os.devnull),
        (None, "/dev/full"),
    )
    for prepare, target in ways[:tries]:
        bench.clear(stage)
        with open(target, "w") as stream:  # noqa: PTH123
            job = subprocess.run(
                bench.command(stage), cwd=bench.folder, stdout=stream, stderr=stream, preexec_fn=prepare, check=False,
                timeout=TIMEOUT,
            )  # fmt: skip
        yield wrong_end(job.returncode, "", (0,)) or bench.finish(stage)
