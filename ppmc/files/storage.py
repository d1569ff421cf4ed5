"""Outputs appear whole or not at all: written under a temporary name, then renamed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ppmc.errors import SceneError, StorageError

HEADROOM_BYTES = 16 * 2**20


def check_output(path: Path, inputs: Iterable[Path | None] = (), need_bytes: int = 0) -> Path:
    """Make sure that an output can be written, before the work that fills it.

    Parameters
    ----------
    path : Path
        The output; its folder is made if need be.
    inputs : iterable of Path
        Files the stage reads; the output must be none of them.
    need_bytes : int
        Room wanted on the disk.

    Raises
    ------
    SceneError
        If input and output are the same file.
    StorageError
        If the folder cannot be made or written to, or the disk is too full.
    """
    path = Path(path)
    for source in inputs:
        if source is not None and (Path(source).absolute() == path.absolute() or _same_file(source, path)):
            raise SceneError(f"{path}: input and output are the same file; name another --output")
    if path.is_dir():
        raise StorageError(f"{path}: is a folder; --output names a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # os.access says yes to root even on a read-only mount, so try it.
        probe = path.parent / f".{path.name}.{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
        free = shutil.disk_usage(path.parent).free
    except OSError as error:
        raise StorageError(f"{path.parent}: cannot write here ({error.strerror}); name another --output") from None
    if free < need_bytes + HEADROOM_BYTES:
        raise StorageError(
            f"{path.parent}: {free / 2**20:.0f} MiB free, {(need_bytes + HEADROOM_BYTES) / 2**20:.0f} MiB needed; "
            "free some room or name another --output"
        )
    return path


def _same_file(a: Path, b: Path) -> bool:
    """Return whether two existing paths are one file, links included."""
    return Path(a).exists() and b.exists() and Path(a).samefile(b)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it is synced and takes the name, on any failure it goes.

    Raises
    ------
    StorageError
        If the disk is full or the folder cannot be written to.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb") as handle:
            os.fsync(handle.fileno())
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        reason = error.strerror or str(error)
        raise StorageError(f"{path}: cannot be written ({reason}); nothing was left behind") from error
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
