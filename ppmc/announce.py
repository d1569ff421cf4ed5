"""The verdict of a run on the terminal: quiet if it passed, not to be overlooked if it did not."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ppmc.errors import VerdictError

if TYPE_CHECKING:
    from ppmc.files.verdict import Verdict

LOUD, PLAIN = "\033[1;31m", "\033[0m"


def announce(verdict: Verdict | None, path: Path) -> None:
    """Say on standard error what became of a run whose flow history lies at `path`."""
    if verdict is None:
        print(f"{path}: carries no verdict; a run of this version gives it one", file=sys.stderr)
        return
    text = "\n".join(f"ppmc: verdict {line}" if not k else f"ppmc: {line}" for k, line in enumerate(verdict.lines()))
    if not verdict.passed and sys.stderr.isatty():
        text = f"{LOUD}{text}{PLAIN}"
    print(text, file=sys.stderr)


def insist(verdict: Verdict | None, path: Path) -> None:
    """Refuse a run that did not pass.

    Raises
    ------
    VerdictError
        If it broke a limit, or if its file does not say.
    """
    if verdict is None:
        raise VerdictError(f"{path}: carries no verdict, and --strict asks for one that passed; solve it anew")
    if not verdict.passed:
        names = ", ".join(finding.name for finding in verdict.broken)
        raise VerdictError(f"{path}: complete, but --strict takes no broken limit: {names}")
