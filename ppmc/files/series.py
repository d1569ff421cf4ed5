"""Read products that change in time, sealed or still growing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.files.fields import FIELDS
from ppmc.files.fields import field as spec_of
from ppmc.files.frame_files import FrameFolder
from ppmc.files.guard import (
    BlockCheck,
    block_check,
    check_layout,
    check_unchanged,
    check_values,
    compare_block,
    dataset_of,
    group_of,
    open_guarded,
    read_whole,
)
from ppmc.files.particles import POSITION
from ppmc.files.provenance import Provenance
from ppmc.files.text import numbers, read_json

# Returns the named arrays of a frame, positions as "Points".
Read = Callable[[int, tuple[str, ...]], list[NDArray[Any]]]


@dataclass
class SeriesFile:
    """An open series, sealed or still growing; frames are read, and verified, one at a time.

    Attributes
    ----------
    path : Path
        The file, or the folder in which it grows.
    product : str
        ``"flow"`` or ``"analysis"``.
    n : int
        Number of particles or regions.
    times : ndarray, shape (frames,)
        Times of the frames, s.
    names : tuple of str
        Fields that change in time.
    static : dict of str to ndarray
        Fields with one value for all times.
    scalars : dict of str to ndarray, shape (frames,)
        Numbers of each frame.
    history : dict of str to ndarray, shape (steps,)
        Numbers of each step; empty in a growing file.
    extra : dict
        Further facts.
    complete : bool
        Whether the run went to its end.
    provenance : Provenance
        Origin of the file.
    """

    path: Path
    product: str
    n: int
    times: NDArray[np.float64]
    names: tuple[str, ...]
    static: dict[str, NDArray[Any]]
    scalars: dict[str, NDArray[np.float64]]
    history: dict[str, NDArray[np.float64]]
    extra: dict[str, Any]
    complete: bool
    provenance: Provenance
    _read: Read

    def frame(self, k: int, names: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Return frame `k` (negative counts from the end): ``position`` and the named fields, verified.

        Raises
        ------
        InputFileError
            If there is no such frame, or a field breaks its contract or is not what was written.
        """
        frames = len(self.times)
        if not -frames <= k < frames:
            raise InputFileError(f"{self.path}: has {frames} frames, frame {k} was asked for")
        asked = tuple(self.names if names is None else names)
        moving = tuple(name for name in asked if name not in self.static)
        position, *values = self._read(k % frames, ("Points", *moving))
        found = {**self.static, **dict(zip(moving, values, strict=True))}
        return {"position": position, **{name: found[name] for name in asked}}


@contextmanager
def open_series(path: Path, product: str) -> Iterator[SeriesFile]:
    """Open a flow history or an analysis: a sealed file, or the folder in which one grows.

    Raises
    ------
    InputFileError
        If the file is missing, damaged, without a frame, or breaks its contract.
    """
    path = Path(path)
    if path.is_dir():
        yield _growing(path, product)
        return
    with ExitStack() as stack:
        yield _sealed(stack.enter_context(open_guarded(path, product)), path, product)


def load_series(path: Path, product: str) -> SeriesFile:
    """Return a flow history or an analysis that stays of use: each frame opens the file for itself.

    Raises
    ------
    InputFileError
        As `open_series`; and on taking a frame, if the file is no longer the one that was read.
    """
    path = Path(path)
    with open_series(path, product) as series:
        if path.is_dir():
            return series
        first = _mark(path)

        def read(k: int, names: tuple[str, ...]) -> list[NDArray[Any]]:
            if not path.is_file() or _mark(path) != first:
                raise InputFileError(f"{path}: is not the file any more that was read; read it again")
            with open_guarded(path, product) as file:
                checks: dict[str, BlockCheck] = {}
                return [_rows(file, k, name, series, checks) for name in names]

        return replace(series, _read=read)


def _mark(path: Path) -> tuple[int, int, int]:
    """Return what changes when another file takes a name."""
    found = path.stat()
    return found.st_ino, found.st_size, found.st_mtime_ns


def _growing(path: Path, product: str) -> SeriesFile:
    """Return the frames that are there so far."""
    folder = FrameFolder.open(path)
    if folder.product != product:
        raise InputFileError(f"{path}: holds '{folder.product}', but '{product}' is needed here")
    times, scalars = [], []
    for k in range(folder.count()):
        with folder.frame(k) as frame:
            times.append(frame.time)
            scalars.append(frame.scalars)
    if not times:
        raise InputFileError(f"{path}: holds no frame yet")

    def read(k: int, names: tuple[str, ...]) -> list[NDArray[Any]]:
        with folder.frame(k) as frame:
            return [frame.read(name) for name in names]

    return SeriesFile(
        path=path,
        product=product,
        n=folder.n,
        times=np.array(times),
        names=folder.names,
        static=folder.static(),
        scalars=dict(zip(folder.scalars, np.array(scalars).reshape(len(times), -1).T, strict=True)),
        history={},
        extra={},
        complete=False,
        provenance=folder.provenance,
        _read=read,
    )


def _sealed(file: h5py.File, path: Path, product: str) -> SeriesFile:
    """Return a complete product."""
    steps = group_of(file, "VTKHDF/Steps", path)
    n = int(read_whole(file, "VTKHDF/NumberOfPoints", path)[0])
    frames = int(numbers(steps, "NSteps", 1)[0])
    if frames < 1:
        raise InputFileError(f"{path}: holds no frame yet")
    times = read_whole(file, "VTKHDF/Steps/Values", path)[:frames].astype(np.float64)
    points = dataset_of(file, "VTKHDF/Points", path)
    if points.ndim != 2 or points.shape[1] != 3 or points.shape[0] < frames * n or len(times) < frames:
        raise InputFileError(f"{path}: {points.name} has shape {points.shape}, needs {frames} frames of ({n}, 3)")
    data = group_of(file, "VTKHDF/PointData", path)
    names, static = [], {}
    for spec in FIELDS[product]:
        if spec.name not in data:
            if spec.required:
                raise InputFileError(f"{path}: /VTKHDF/PointData/{spec.name} is missing ({spec.doc})")
            continue
        where = f"VTKHDF/PointData/{spec.name}"
        dataset = dataset_of(file, where, path)
        if spec.static:
            check_layout(dataset, spec, (n,), path)
            static[spec.name] = read_whole(file, where, path)
            check_values(static[spec.name], spec, dataset.name, path)
        else:
            check_layout(dataset, spec, None, path)
            if dataset.shape[0] < frames * n:
                raise InputFileError(f"{path}: {dataset.name} has {dataset.shape[0]} rows, needs {frames * n}")
            names.append(spec.name)
    checks: dict[str, BlockCheck] = {}
    check_unchanged(file, path)
    own = file.get("ppmc", {})
    series = SeriesFile(
        path=path,
        product=product,
        n=n,
        times=times,
        names=tuple(names),
        static=static,
        scalars={k: read_whole(file, f"ppmc/frames/{k}", path)[:frames] for k in own.get("frames", {})},
        history={k: read_whole(file, f"ppmc/history/{k}", path) for k in own.get("history", {})},
        extra=read_json(own, "extra") if own else {},
        complete="history" in own,
        provenance=Provenance.load(file),
        _read=lambda k, names: [_rows(file, k, name, series, checks) for name in names],
    )
    return series


def _rows(file: h5py.File, k: int, name: str, series: SeriesFile, checks: dict[str, BlockCheck]) -> NDArray[Any]:
    """Return an array of a frame of a complete product, verified; `checks` keeps digests from frame to frame."""
    path, product, n = series.path, series.product, series.n
    where = "VTKHDF/Points" if name == "Points" else f"VTKHDF/PointData/{name}"
    dataset, rows = dataset_of(file, where, path), slice(k * n, (k + 1) * n)
    values: NDArray[Any] = dataset[rows]
    if name != "Points" or product == "flow":
        spec = POSITION if name == "Points" else spec_of(product, name)
        check_values(values, spec, f"{dataset.name} (frame {k})", path)
    if name not in checks:
        checks[name] = block_check(file, where, path)
    compare_block(checks[name], (rows,), path)
    return values
