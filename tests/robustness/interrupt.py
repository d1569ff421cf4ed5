"""Faults put in at a chosen system call: death, an error from then on, or a write of half the bytes.

All writing of products goes through the functions of `os` named here, so that a child process can count them.
"""

from __future__ import annotations

import errno
import os
import signal
from collections.abc import Callable
from typing import Any

CALLS = ("open", "pwrite", "ftruncate", "fsync", "replace", "rename", "unlink", "rmdir", "mkdir", "close")
FAILING = ("pwrite", "ftruncate", "fsync", "replace")


def in_child(work: Callable[[], None], fault: str, at: int) -> tuple[int, int]:
    """Do some work in a child process with a fault at the call number `at`.

    Returns
    -------
    status : int
        Exit code, or minus the number of the signal.
    calls : int
        System calls that the child made, if it lived to tell.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        count = 0

        def wrapped(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
            def call(*args: Any, **kwargs: Any) -> Any:
                nonlocal count
                if fault == "error" and name not in FAILING:
                    return real(*args, **kwargs)
                count += 1
                if fault == "kill" and count == at:
                    os.kill(os.getpid(), signal.SIGKILL)
                if fault == "error" and count >= at:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                if fault == "short" and name == "pwrite" and len(args[1]) > 1:
                    return real(args[0], args[1][: len(args[1]) // 2], args[2])
                return real(*args, **kwargs)

            return call

        status = 99
        try:
            for name in CALLS:
                setattr(os, name, wrapped(name, getattr(os, name)))
            work()
            status = 0
        except Exception as error:
            status = getattr(error, "exit_code", 98)
        finally:
            os.write(writing, str(count).encode())
            os._exit(status)
    os.close(writing)
    told = b""
    while part := os.read(reading, 64):
        told += part
    os.close(reading)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), int(told or b"0")
