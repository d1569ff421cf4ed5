"""HDF5 products written whole: the library never meets a failing disk, and nothing is written that has no digest.

A disk that fills up, a limit on file sizes or an I/O error leaves HDF5 in a state in which closing the file, or leaving
the interpreter, ends in a segmentation fault. Here HDF5 writes through a stream of our own. The stream keeps the first
error to itself and takes everything that follows without writing it; the file is then closed in peace, thrown away, and
the error raised.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py

from ppmc.files.digests import put_missing_digests
from ppmc.files.storage import whole_file

SEALED = ("v110", "v114")  # checksummed metadata that VTK still reads; "latest" is not read


class _Stream(io.RawIOBase):
    """The bytes of a new file; the first error of the operating system is kept, and all later writing left out."""

    def __init__(self, path: Path) -> None:
        self.error: OSError | None = None
        # Buffered I/O would hold back errors until closing, and mapped memory would turn them into signals.
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._position = 0
        self._size = 0

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        self._position = base + offset
        return self._position

    def tell(self) -> int:
        return self._position

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        count = 0
        try:
            while count < len(view):
                got = os.preadv(self._file, [view[count:]], self._position + count)
                if got == 0:
                    break
                count += got
        except OSError as error:
            self.error = self.error or error
        view[count:] = bytes(len(view) - count)
        self._position += len(view)
        return len(view)

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        count = 0
        try:
            # The system may write less than asked, and does so just before a disk is full.
            while count < len(view) and self.error is None:
                count += os.pwrite(self._file, view[count:], self._position + count)
        except OSError as error:
            self.error = error
        self._position += len(view)
        self._size = max(self._size, self._position)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        self._size = self._position if size is None else size
        try:
            if self.error is None:
                os.ftruncate(self._file, self._size)
        except OSError as error:
            self.error = error
        return self._size

    def flush(self) -> None:
        """Leave it to `close`: until then the file has no name that anybody reads."""

    def close(self) -> None:
        if not self.closed:
            super().close()
            os.close(self._file)


class NewFile:
    """An HDF5 file on its way.

    Attributes
    ----------
    file : h5py.File
        To be filled.
    """

    def __init__(self, path: Path) -> None:
        self._stream = _Stream(path)
        self.file = h5py.File(self._stream, "w", libver=SEALED)

    def check(self) -> None:
        """Raise what went wrong so far, so that long work does not go on for nothing.

        Raises
        ------
        OSError
            The first error of the operating system.
        """
        if self._stream.error is not None:
            raise self._stream.error

    def close(self) -> None:
        """Close file and stream; errors of the system are left to `check`."""
        try:
            self.file.close()
        except (OSError, RuntimeError):
            if self._stream.error is None:
                raise
        finally:
            self._stream.close()


@contextmanager
def new_hdf5(path: Path) -> Iterator[NewFile]:
    """Yield a new HDF5 file that takes its name, every dataset with a digest, when the block ends well.

    Parameters
    ----------
    path : Path
        The product; replaced if it exists.

    Raises
    ------
    StorageError
        If it cannot be written; nothing is left behind then.
    """
    with whole_file(path) as temporary:
        new = NewFile(temporary)
        try:
            yield new
            put_missing_digests(new.file)
        except BaseException as error:
            with suppress(OSError, RuntimeError):
                new.close()
            if isinstance(error, OSError | RuntimeError):
                new.check()  # HDF5 tells of the consequences, the stream of the cause
            raise
        new.close()
        new.check()
