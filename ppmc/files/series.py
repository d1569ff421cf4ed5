"""Read products that change in time, sealed or still growing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.files.fields import FIELDS
from ppmc.files.fields import field as spec_of
from ppmc.files.guard import check_layout, check_values, dataset_of, group_of, open_guarded
from ppmc.files.particles import POSITION
from ppmc.files.provenance import Provenance
from ppmc.files.text import read_json


@dataclass
class SeriesFile:
    """An open series; frames are read, and verified, one at a time.

    Attributes
    ----------
    path : Path
        The file.
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
    _file: h5py.File

    def frame(self, k: int, names: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Return frame `k` (negative counts from the end): ``position`` and the named fields, verified.

        Raises
        ------
        InputFileError
            If there is no such frame, or a field breaks its contract.
        """
        frames = len(self.times)
        if not -frames <= k < frames:
            raise InputFileError(f"{self.path}: has {frames} frames, frame {k} was asked for")
        k %= frames
        rows = slice(k * self.n, (k + 1) * self.n)
        points = dataset_of(self._file, "VTKHDF/Points", self.path)
        out = {"position": points[rows]}
        if self.product == "flow":
            check_values(out["position"], POSITION, f"{points.name} (frame {k})", self.path)
        for name in self.names if names is None else names:
            if name in self.static:
                out[name] = self.static[name]
                continue
            dataset = dataset_of(self._file, f"VTKHDF/PointData/{name}", self.path)
            out[name] = dataset[rows]
            check_values(out[name], spec_of(self.product, name), f"{dataset.name} (frame {k})", self.path)
        return out


@contextmanager
def open_series(path: Path, product: str) -> Iterator[SeriesFile]:
    """Open a flow history or an analysis, sealed or still growing.

    Raises
    ------
    InputFileError
        If the file is missing, damaged, without a frame, or breaks its contract.
    """
    path = Path(path)
    with open_guarded(path, product) as file:
        root = group_of(file, "VTKHDF", path)
        steps = group_of(file, "VTKHDF/Steps", path)
        n = int(dataset_of(file, "VTKHDF/NumberOfPoints", path)[0])
        frames = int(steps.attrs.get("NSteps", 0))
        if frames < 1:
            raise InputFileError(f"{path}: holds no frame yet")
        times = dataset_of(file, "VTKHDF/Steps/Values", path)[:frames].astype(np.float64)
        points = dataset_of(file, "VTKHDF/Points", path)
        if points.ndim != 2 or points.shape[1] != 3 or points.shape[0] < frames * n or len(times) < frames:
            raise InputFileError(f"{path}: {points.name} has shape {points.shape}, needs {frames} frames of ({n}, 3)")
        data = root["PointData"]
        names, static = [], {}
        for spec in FIELDS[product]:
            if spec.name not in data:
                if spec.required:
                    raise InputFileError(f"{path}: /VTKHDF/PointData/{spec.name} is missing ({spec.doc})")
                continue
            dataset = dataset_of(file, f"VTKHDF/PointData/{spec.name}", path)
            if spec.static:
                check_layout(dataset, spec, (n,), path)
                static[spec.name] = dataset[:]
                check_values(static[spec.name], spec, dataset.name, path)
            else:
                check_layout(dataset, spec, None, path)
                if dataset.shape[0] < frames * n:
                    raise InputFileError(f"{path}: {dataset.name} has {dataset.shape[0]} rows, needs {frames * n}")
                names.append(spec.name)
        own = file.get("ppmc", {})
        yield SeriesFile(
            path=path,
            product=product,
            n=n,
            times=times,
            names=tuple(names),
            static=static,
            scalars={k: v[:frames] for k, v in own.get("frames", {}).items()},
            history={k: v[:] for k, v in own.get("history", {}).items()},
            extra=read_json(own, "extra") if own else {},
            complete="history" in own,
            provenance=Provenance.load(file),
            _file=file,
        )
