"""The folder in which a product grows: a header, a file for each frame, and an index for viewers; read and checked."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError, StorageError
from ppmc.files.fields import FIELDS
from ppmc.files.fields import field as spec_of
from ppmc.files.guard import check_layout, check_unchanged, check_values, dataset_of, group_of, open_guarded, read_whole
from ppmc.files.particles import POSITION
from ppmc.files.provenance import Provenance
from ppmc.files.text import attribute, numbers, read_json

HEADER = "header.vtkhdf"
OWN_FILE = re.compile(r"header\.vtkhdf|frame_\d{6,}\.vtkhdf|.*\.vtkhdf\.series|\..*\.tmp")


def frame_name(k: int) -> str:
    """Return the name of the file of frame `k`."""
    return f"frame_{k:06d}.vtkhdf"


@dataclass(frozen=True)
class FrameFile:
    """One open frame.

    Attributes
    ----------
    path : Path
        Its file.
    product : str
        The product that it is a frame of.
    n : int
        Number of particles.
    time : float
        Its time, s.
    scalars : ndarray, shape (scalars,)
        Its numbers.
    """

    path: Path
    product: str
    n: int
    time: float
    scalars: NDArray[np.float64]
    _file: h5py.File

    def read(self, name: str) -> NDArray[Any]:
        """Return ``"Points"`` or a field, compared with its digest and its contract.

        Raises
        ------
        InputFileError
            If it is missing, damaged, or breaks its contract.
        """
        spec = POSITION if name == "Points" else spec_of(self.product, name)
        where = "VTKHDF/Points" if name == "Points" else f"VTKHDF/PointData/{name}"
        check_layout(dataset_of(self._file, where, self.path), spec, (self.n,), self.path)
        values = read_whole(self._file, where, self.path)
        if name != "Points" or self.product == "flow":
            check_values(values, spec, f"/{where}", self.path)
        return values


class FrameFolder:
    """A growing product, open for reading.

    Attributes
    ----------
    path : Path
        The folder.
    product : str
        Its contract.
    n : int
        Number of particles.
    names, scalars : tuple of str
        Fields and numbers that every frame has.
    provenance : Provenance
        Its origin.
    run : str
        What all frames of one run carry.
    """

    def __init__(self, path: Path, product: str, n: int, growing: dict[str, Any], provenance: Provenance) -> None:
        self.path = path
        self.product = product
        self.n = n
        self.names = tuple(growing["fields"])
        self.scalars = tuple(growing["scalars"])
        self.provenance = provenance
        self.run = provenance.key

    @classmethod
    def open(cls, path: Path) -> FrameFolder:
        """Open a folder.

        Raises
        ------
        InputFileError
            If it is not there, or its header is missing or damaged.
        """
        path = Path(path)
        with open_guarded(path / HEADER, None) as file:
            product = attribute(file["ppmc"], "schema")
            if product not in FIELDS:
                raise InputFileError(f"{path / HEADER}: holds '{product}', which does not grow")
            growing = read_json(file["ppmc"], "growing")
            n = int(read_whole(file, "VTKHDF/NumberOfPoints", path / HEADER)[0])
            known = {f.name for f in FIELDS[product] if not f.static}
            if not isinstance(growing, dict) or not set(growing.get("fields", ())) <= known:
                raise InputFileError(f"{path / HEADER}: does not say what grows here")
            check_unchanged(file, path / HEADER)
            return cls(path, product, n, growing, Provenance.load(file))

    @staticmethod
    def clear(path: Path) -> None:
        """Make an empty folder; one that holds nothing but a growing product is emptied.

        Raises
        ------
        StorageError
            If something else is in it, or it cannot be made.
        """
        try:
            if path.exists() or path.is_symlink():
                strange = [p.name for p in path.iterdir() if not OWN_FILE.fullmatch(p.name)]
                if strange:
                    raise StorageError(f"{path}: holds {strange[0]}, which is not ppmc's; move that folder away")
                shutil.rmtree(path)
            path.mkdir(parents=True)
        except OSError as error:
            raise StorageError(f"{path}: cannot be made ({error.strerror}); name another --output") from None

    def static(self) -> dict[str, NDArray[Any]]:
        """Return the fields with one value for all times, checked.

        Raises
        ------
        InputFileError
            If one is missing, damaged, or breaks its contract.
        """
        path, out = self.path / HEADER, {}
        with open_guarded(path, self.product) as file:
            data = group_of(file, "VTKHDF/PointData", path)
            for spec in FIELDS[self.product]:
                if spec.static and (spec.required or spec.name in data):
                    where = f"VTKHDF/PointData/{spec.name}"
                    check_layout(dataset_of(file, where, path), spec, (self.n,), path)
                    out[spec.name] = read_whole(file, where, path)
                    check_values(out[spec.name], spec, f"/{where}", path)
        return out

    @contextmanager
    def frame(self, k: int) -> Iterator[FrameFile]:
        """Open a frame.

        Raises
        ------
        InputFileError
            If it is missing, damaged, or of another run.
        """
        path = self.path / frame_name(k)
        with open_guarded(path, "frame") as file:
            own = group_of(file, "ppmc", path)
            if attribute(own, "run") != self.run or int(numbers(own, "frame", 1)[0]) != k:
                raise InputFileError(f"{path}: belongs to another run than {HEADER}; start anew with --restart")
            scalars = numbers(own, "scalars", len(self.scalars)) if self.scalars else np.empty(0)
            time = float(numbers(own, "time", 1)[0])
            check_unchanged(file, path)
            yield FrameFile(path, self.product, self.n, time, scalars, file)

    def time_of(self, k: int) -> float:
        """Return the time, s, of a frame."""
        with self.frame(k) as frame:
            return frame.time

    def count(self) -> int:
        """Return how many frames there are in a row, without reading them."""
        k = 0
        while (self.path / frame_name(k)).is_file():
            k += 1
        return k

    def sound_frames(self, most: int | None = None) -> int:
        """Return how many frames in a row are whole, each value compared with its digest; no more than `most`."""
        k = 0
        while most is None or k < most:
            try:
                with self.frame(k) as frame:
                    for name in ("Points", *self.names):
                        frame.read(name)
            except InputFileError:
                break
            k += 1
        return k

    def drop_from(self, k: int) -> None:
        """Remove frame `k` and all later ones, the last one first, so that no gap is ever left.

        Raises
        ------
        StorageError
            If one cannot be removed.
        """
        try:
            found = [p for p in self.path.glob("frame_*.vtkhdf") if OWN_FILE.fullmatch(p.name)]
            numbers = sorted((int(p.stem.removeprefix("frame_")) for p in found), reverse=True)
            for number in numbers:
                if number >= k:
                    (self.path / frame_name(number)).unlink()
        except OSError as error:
            raise StorageError(f"{self.path}: cannot be written ({error.strerror})") from None
