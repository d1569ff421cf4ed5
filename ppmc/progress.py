"""Progress of long work: a bar with ETA on a terminal, plain lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rich.progress

LINE_EVERY_SHARE = 0.05
LINE_EVERY_SECONDS = 60.0
_shown: ContextVar[bool] = ContextVar("shown", default=True)


@contextmanager
def progress_shown(shown: bool) -> Iterator[None]:
    """Show the progress of all work within the block, or none of it."""
    before = _shown.set(shown)
    try:
        yield
    finally:
        _shown.reset(before)


def _clock(seconds: float) -> str:
    """Return seconds as ``h:mm:ss``."""
    whole = int(seconds + 0.5)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


class Progress:
    """Show how far long work has come.

    Parameters
    ----------
    title : str
        What is being done.
    total : float
        Amount of work, in `unit`.
    unit : str
        What is counted, for the log lines.

    Notes
    -----
    Written to standard error, so that standard output stays usable in a pipe. A log gets one line per 5 % of the
    work or per minute, whichever comes first; a bar redrawn with carriage returns would fill it with noise.
    """

    def __init__(self, title: str, total: float, unit: str = "steps") -> None:
        self.title = title
        self.total = total
        self.unit = unit
        self._done = 0.0
        self._bar: rich.progress.Progress | None = None
        self._task: rich.progress.TaskID | None = None

    def __enter__(self) -> Progress:
        self._start = self._last_time = time.monotonic()
        self._lines = 0
        self._silent = not _shown.get()
        if not self._silent and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
            from rich.progress import Progress as RichProgress

            self._bar = RichProgress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.percentage:>3.0f} %"),
                TimeElapsedColumn(),
                TextColumn("ETA"),
                TimeRemainingColumn(),
                TextColumn("{task.fields[note]}"),
                console=Console(stderr=True),
            )
            self._bar.start()
            self._task = self._bar.add_task(self.title, total=self.total, note="")
        return self

    def advance(self, amount: float = 1.0, note: str = "") -> None:
        """Add `amount` to the work done."""
        self.update(self._done + amount, note)

    def update(self, done: float, note: str = "") -> None:
        """Set the work done so far to `done`; `note` is shown beside it."""
        self._done = done
        if self._silent:
            return
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, note=note)
            return
        now = time.monotonic()
        share = done / self.total if self.total > 0 else 1.0
        lines = int(share / LINE_EVERY_SHARE + 1e-9)
        if lines > self._lines or now - self._last_time >= LINE_EVERY_SECONDS:
            self._lines, self._last_time = lines, now
            elapsed = now - self._start
            eta = _clock(elapsed * (1.0 - share) / share) if 0.0 < share <= 1.0 else "?"
            count = f"{done:.6g}/{self.total:.6g} {self.unit} ({share:.0%})"
            text = f"{self.title}: {count} elapsed {_clock(elapsed)} ETA {eta} {note}"
            print(text.rstrip(), file=sys.stderr, flush=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
