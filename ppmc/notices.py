"""What may be wrong but need not be is told on standard error, once, while the work goes on."""

from __future__ import annotations

import contextlib
import sys

_told: set[str] = set()


def notice(text: str) -> None:
    """Tell the user something, once in a process; a standard error that is gone is no reason to stop.

    Parameters
    ----------
    text : str
        One sentence that names file, value and what to do.
    """
    if text in _told:
        return
    _told.add(text)
    with contextlib.suppress(OSError, ValueError):
        print(f"ppmc: note: {text}", file=sys.stderr, flush=True)
