"""How a command ends: one message for everything that can stop it, and its exit code."""

from __future__ import annotations

import errno
import signal
import sys
from collections.abc import Callable
from typing import NoReturn

from ppmc.errors import PpmcError, StoppedWithCheckpoint, StorageError
from ppmc.interrupts import INTERRUPTED, LastingStream, StopSignal, ignore

# Commands whose result is what they print: that it could not be printed is their failure.
PRINTING = ("info", "check", "schema", "part")


def exit_code_of(run: Callable[[], int]) -> int:
    """Return the exit code of a command, after the one message of whatever stopped it."""
    try:
        return run()
    except PpmcError as error:
        print(f"ppmc: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt as error:
        told = str(error) or "nothing half-written was left; the same command starts again"
        print(f"ppmc: interrupted; {told}", file=sys.stderr)
        return INTERRUPTED
    except StopSignal as error:
        print(
            f"ppmc: stopped by {error.name}; nothing half-written was left, and the same command goes on from what is "
            "there",
            file=sys.stderr,
        )
        return StoppedWithCheckpoint.exit_code
    except BrokenPipeError:
        return 128 + signal.SIGPIPE  # the reader of a pipe (head, less) went away: not an error of ours
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"ppmc: {where}{error.strerror or error}", file=sys.stderr)
        return StorageError.exit_code
    except (MemoryError, RecursionError) as error:
        what = "not enough memory" if isinstance(error, MemoryError) else "nested too deeply"
        print(f"ppmc: {what}{f' ({error})' if str(error) else ''}", file=sys.stderr)
        return PpmcError.exit_code


def left_with(run: Callable[[], int]) -> NoReturn:
    """Run a command and leave the interpreter with its exit code."""
    code = exit_code_of(run)
    ignore()
    sys.stdout.flush()
    sys.stderr.flush()
    lost = sys.stdout.error if isinstance(sys.stdout, LastingStream) else None
    if code == 0 and lost is not None and (sys.argv[1:2] or ["info"])[0] in (*PRINTING, "--help", "--version"):
        if lost.errno == errno.EPIPE:
            code = 128 + signal.SIGPIPE
        else:
            print(f"ppmc: standard output: {lost.strerror}", file=sys.stderr)
            code = StorageError.exit_code
    sys.exit(code)
