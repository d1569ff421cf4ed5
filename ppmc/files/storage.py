"""Outputs appear whole or not at all, and never over what is not theirs: written under another name, then renamed."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ppmc.errors import InputFileError, SceneError, StorageError
from ppmc.files.lock import confirm_locks

HEADROOM_BYTES = 16 * 2**20
SPECIAL = (
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def check_output(
    path: Path,
    inputs: Iterable[Path | None] = (),
    need_bytes: int = 0,
    *,
    is_own: Callable[[Path], str] | None = None,
    force: bool = False,
) -> Path:
    """Make sure that an output can be written, and may be, before the work that fills it.

    Parameters
    ----------
    path : Path
        The output; its folder is made if need be. Of a symbolic link, the file it leads to.
    inputs : iterable of Path
        Files the stage reads; the output must be none of them.
    need_bytes : int
        Room wanted on the disk.
    is_own : callable, optional
        Returns what an existing file is, in words, if it is not of the kind that will replace it; empty if it is.
    force : bool
        Replace files of other kinds too; never inputs and never anything but files.

    Raises
    ------
    SceneError
        If input and output are the same file, or the output is another program's.
    StorageError
        If the output is no file, the folder cannot be made or written to, or the disk is too full.
    """
    path = Path(path)
    for source in inputs:
        if source is not None and (Path(source).absolute() == path.absolute() or _same_file(source, path)):
            raise SceneError(f"{path}: input and output are the same file; name another --output")
    check_replaceable(path)
    if is_own is not None and not force and path.exists() and (what := is_own(path)):
        raise SceneError(f"{path}: {what} and would be replaced; name another --output, or say --force")
    folder = path.resolve().parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # os.access says yes to root even on a read-only mount, so try it.
        probe = folder / f".{path.name}.{os.getpid()}.tmp"
        probe.touch()
        probe.unlink()
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise StorageError(f"{path.parent}: cannot write here ({error.strerror}); name another --output") from None
    if free < need_bytes + HEADROOM_BYTES:
        raise StorageError(
            f"{path.parent}: {free / 2**20:.0f} MiB free, {(need_bytes + HEADROOM_BYTES) / 2**20:.0f} MiB needed; "
            "free some room or name another --output"
        )
    return path


def check_replaceable(path: Path) -> None:
    """Refuse to put a file where a folder, a device or the like is.

    Raises
    ------
    StorageError
        Naming what is there.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise StorageError(f"{path}: cannot write here ({error.strerror}); name another --output") from None
    if stat.S_ISDIR(mode):
        raise StorageError(f"{path}: is a folder; --output names a file")
    for found, what in SPECIAL:
        if found(mode):
            raise StorageError(f"{path}: is {what}; --output names a file")


def is_product(product: str) -> Callable[[Path], str]:
    """Return the `is_own` of a product: nothing but an earlier file of the same product is replaced."""

    def told(path: Path) -> str:
        from ppmc.files.guard import product_of

        if path.stat().st_size == 0:
            return ""
        try:
            found = product_of(path)
        except InputFileError:
            return "is not a file of ppmc"
        return "" if found == product else f"holds '{found}', not '{product}',"

    return told


def is_text_with(mark: bytes, within: int = 4096) -> Callable[[Path], str]:
    """Return the `is_own` of a text output that can be told by what stands near its start."""

    def told(path: Path) -> str:
        with path.open("rb") as handle:
            start = handle.read(within)
        return "" if not start or mark in start else "was not written by ppmc"

    return told


def _same_file(a: Path, b: Path) -> bool:
    """Return whether two existing paths are one file, links included."""
    return Path(a).exists() and b.exists() and Path(a).samefile(b)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it is synced and takes the name, on any failure it goes.

    Of a symbolic link, the file it leads to is replaced, not the link.

    Raises
    ------
    StorageError
        If the disk is full, the folder cannot be written to, or another process has taken the output.
    """
    path = Path(path)
    real = path.resolve()
    temporary = real.with_name(f".{real.name}.{os.getpid()}.tmp")
    try:
        check_replaceable(path)
        real.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        sync(temporary)
        confirm_locks()
        temporary.replace(real)
        sync(real.parent)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        reason = error.strerror or str(error)
        raise StorageError(f"{path}: cannot be written ({reason}); nothing was left behind") from error
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk.

    Raises
    ------
    OSError
        If the disk reports that they are not.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some file systems do not sync folders, and say so.
        if not (path.is_dir() and error.errno in (errno.EBADF, errno.EINVAL)):
            raise
    finally:
        os.close(handle)
