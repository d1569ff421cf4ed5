"""One writer for each output: a lock for the whole length of a run, which ends with the process that holds it.

The lock is a record lock of the operating system on a small file beside the output. Such locks work across machines on
NFS and cannot be left behind: a killed process has none. The file says who holds it.
"""

from __future__ import annotations

import errno
import fcntl
import functools
import inspect
import json
import os
import shutil
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from ppmc.errors import StorageError

P = ParamSpec("P")
T = TypeVar("T")

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
TAKEN = (errno.EACCES, errno.EAGAIN)
NAMED_SECONDS = 0.5  # within which a process that has just taken a lock has written its name
MOST_BYTES = 4096


@dataclass(frozen=True)
class Claim:
    """What a run wants for itself.

    Attributes
    ----------
    path : Path
        An output.
    shared : bool
        Whether others of the same kind may work on it too: shares of one CT volume.
    """

    path: Path
    shared: bool = False

    @property
    def lock(self) -> Path:
        """The lock file: one for all files of a stem, as growing histories and checkpoints are named after it."""
        real = self.path.resolve()
        return real.with_name(f".{real.stem}.lock")


class _Held:
    """One lock that this process holds."""

    def __init__(self, claim: Claim) -> None:
        self.claim = claim
        self.path = claim.lock
        self.file = -1
        self.sure = True

    def take(self) -> None:
        """Take the lock, or say who has it."""
        if self.path in _HELD:
            raise StorageError(f"{self.claim.path}: this very process is already writing it; name another --output")
        while True:
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
            except OSError as error:
                raise StorageError(
                    f"{self.path.parent}: cannot write here ({error.strerror}); name another --output"
                ) from None
            try:
                self._lock()
            except OSError as error:
                holder = _read_holder(self.file) if error.errno in TAKEN else ""
                self._close()
                if error.errno in TAKEN:
                    raise StorageError(
                        f"{self.claim.path}: {holder or 'another process'} is writing it; wait for its end, or name "
                        "another --output"
                    ) from None
                raise StorageError(f"{self.path}: cannot be locked ({error.strerror})") from None
            if self._is_named():
                break
            self._close()  # its last owner has just removed it
        with suppress(OSError):  # on a full disk the lock holds, but has no name
            text = json.dumps(_myself()).encode()
            os.ftruncate(self.file, 0)
            os.pwrite(self.file, text, 0)
        _HELD[self.path] = self

    def _lock(self) -> None:
        try:
            fcntl.lockf(self.file, (fcntl.LOCK_SH if self.claim.shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
            if self.sure:
                print(
                    f"ppmc: {self.path.parent} keeps no locks ({error.strerror}): a second job on {self.claim.path} "
                    "would not be noticed",
                    file=sys.stderr,
                )
            self.sure = False

    def _is_named(self) -> bool:
        """Return whether the locked file is the one that has the name."""
        try:
            there = self.path.stat()
        except OSError:
            return False
        mine = os.fstat(self.file)
        return (there.st_dev, there.st_ino) == (mine.st_dev, mine.st_ino)

    def confirm(self) -> None:
        """Make sure that the lock is still ours: servers may lose locks, and people remove files."""
        try:
            if self._is_named():
                self._lock()
                return
        except OSError as error:
            if error.errno not in TAKEN:
                raise StorageError(f"{self.path}: the lock cannot be confirmed ({error.strerror})") from None
            holder = _read_holder(self.file) or "another process"
            raise StorageError(f"{self.claim.path}: {holder} has begun to write it; this run stops") from None
        self._close()
        del _HELD[self.path]
        self.take()

    def release(self) -> None:
        """Give the lock back; its file goes while nobody else can hold it."""
        _HELD.pop(self.path, None)
        if self.file >= 0:
            with suppress(OSError):
                if self.claim.shared:
                    fcntl.lockf(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while others share it
                if self._is_named():
                    self.path.unlink()
            self._close()

    def _close(self) -> None:
        os.close(self.file)
        self.file = -1


_HELD: dict[Path, _Held] = {}
os.register_at_fork(after_in_child=_HELD.clear)  # locks stay with the parent
_OURS: ContextVar[frozenset[Path]] = ContextVar("ours", default=frozenset())  # held by who calls, not by other threads


def _myself() -> dict[str, Any]:
    """Return who this process is, for those who find it at work."""
    return {
        "host": socket.gethostname(),
        "process": os.getpid(),
        "since": time.strftime("%Y-%m-%d %H:%M:%S"),
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])[:500] if sys.argv else "",
    }


def _read_holder(file: int) -> str:
    """Return who holds a lock, empty if the file does not say."""
    end = time.monotonic() + NAMED_SECONDS
    while True:
        with suppress(OSError, ValueError, KeyError, TypeError):
            who = json.loads(os.pread(file, MOST_BYTES, 0))
            command = f" ({who['command']})" if who["command"] else ""
            return f"process {who['process']} on {who['host']}, since {who['since']}{command},"
        if time.monotonic() > end:
            return ""
        time.sleep(0.02)


def confirm_locks() -> None:
    """Make sure that every lock of this process is still its own, before something is written for good.

    Raises
    ------
    StorageError
        If another process has taken one.
    """
    for held in tuple(_HELD.values()):
        held.confirm()


@contextmanager
def locked(claims: Sequence[Claim]) -> Iterator[None]:
    """Hold locks for the length of a block; those that the caller holds already stay as they are.

    Raises
    ------
    StorageError
        If another process has one of them; it is named, with host, process and since when.
    """
    with ExitStack() as stack:
        ours = _OURS.get() & _HELD.keys()
        wanted = {claim.lock: claim for claim in claims}
        for lock, claim in wanted.items():
            if lock in ours and (claim.shared or not _HELD[lock].claim.shared):
                continue
            held = _Held(claim)
            held.take()
            stack.callback(held.release)
            if not claim.shared:
                remove_leftovers(claim.path.resolve().parent, claim.path.resolve().name)
        token = _OURS.set(ours | wanted.keys())
        stack.callback(_OURS.reset, token)
        yield


def remove_leftovers(folder: Path, name: str = "*") -> None:
    """Remove what killed writers of a locked output have left: nobody else writes it now.

    Parameters
    ----------
    folder : Path
        Where the output is.
    name : str
        Its name; of folders that a stage has for itself, any.
    """
    if name == "*":
        patterns: tuple[str, ...] = (".*.tmp",)
    else:
        stem = _escaped(Path(name).stem)
        beside = ("partial", "checkpoint-?.h5ckpt", "crash.h5ckpt", "steps.csv")
        patterns = tuple(f".{each}.*.tmp" for each in (_escaped(name), *(f"{stem}.{end}" for end in beside)))
    for left in (found for pattern in patterns for found in folder.glob(pattern)):
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        with suppress(OSError):
            left.unlink()


def _escaped(name: str) -> str:
    """Return a name that a pattern takes literally."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)


def one_writer(claims: Callable[[Mapping[str, Any]], Sequence[Claim]]) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Let a stage hold the locks of its outputs from its first line to its last.

    Parameters
    ----------
    claims : callable
        Returns what the stage writes from the arguments it is called with.
    """

    def decorate(stage: Callable[P, T]) -> Callable[P, T]:
        signature = inspect.signature(stage)

        @functools.wraps(stage)
        def alone(*args: P.args, **kwargs: P.kwargs) -> T:
            bound = signature.bind(*args, **kwargs)
            bound.apply_defaults()
            with locked(claims(bound.arguments)):
                return stage(*args, **kwargs)

        return alone

    return decorate
