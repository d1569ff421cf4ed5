"""Write products that change in time: the flow history and the analysis.

A growing file gains a frame at a time and stays readable whenever its writer is killed: every frame is one chunk of
each dataset, data is flushed before the number of steps counts it, and the file is closed between frames. When the
run is over it is sealed: copied whole into a file with checksummed metadata.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError, StorageError
from ppmc.files import vtkhdf
from ppmc.files.fields import FIELDS
from ppmc.files.fields import field as spec_of
from ppmc.files.guard import group_of, open_guarded
from ppmc.files.particles import POSITION
from ppmc.files.provenance import Provenance
from ppmc.files.storage import whole_file
from ppmc.files.text import attribute, put_attribute, put_json

# A viewer that reads a long series holds the lock for long, and a run of hours must not end for that.
LOCKED_SECONDS, LOCKED_WAIT_SECONDS = 600.0, 0.2


class SeriesWriter:
    """A growing file of frames.

    Attributes
    ----------
    path : Path
        The growing file.
    frames : int
        Finished frames in it.
    """

    def __init__(self, path: Path, product: str, n: int, names: tuple[str, ...], frames: int) -> None:
        self.path = Path(path)
        self.product = product
        self.n = n
        self.names = names
        self.frames = frames

    @classmethod
    def create(
        cls,
        path: Path,
        n: int,
        static: Mapping[str, NDArray[Any]],
        fields: Iterable[str],
        scalars: Iterable[str] = (),
        *,
        provenance: Provenance,
        product: str = "flow",
    ) -> SeriesWriter:
        """Make a file without frames.

        Parameters
        ----------
        path : Path
            The growing file; replaced if it exists.
        n : int
            Number of particles, the same at all times.
        static : mapping of str to ndarray, shape (n[, components])
            Fields with one value for all times.
        fields : iterable of str
            Fields that every frame will bring.
        scalars : iterable of str
            Numbers that every frame will bring.
        provenance : Provenance
            Origin of the file.
        product : str
            ``"flow"`` or ``"analysis"``.

        Raises
        ------
        StorageError
            If the file cannot be written.
        """
        names = tuple(fields)
        with whole_file(path) as temporary, h5py.File(temporary, "w") as file:
            root = vtkhdf.begin(file, "PolyData")
            data = vtkhdf.points_header(root, n)
            steps = root.create_group("Steps")
            offsets = steps.create_group("PointDataOffsets")
            put_attribute(_growing(root, "Points", (n, 3), "f8"), "unit", "mm")
            for name in names:
                spec = spec_of(product, name)
                shape = (n,) if spec.components == 1 else (n, spec.components)
                vtkhdf.describe(_growing(data, name, shape, spec.dtype), spec, provenance.creator)
                _growing(offsets, name, (1,), "i8")
            for name, values in static.items():
                vtkhdf.put(data, spec_of(product, name), values, (n,), provenance.creator)
                _growing(offsets, name, (1,), "i8")
            put_attribute(_growing(steps, "Values", (1,), "f8"), "unit", "s")
            for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
                _growing(steps, name, (1,), "i8")
            for name in ("CellOffsets", "ConnectivityIdOffsets"):
                _growing(steps, name, (1, 4), "i8")
            provenance.store(file, product)
            frames = file["ppmc"].create_group("frames")
            for name in scalars:
                _growing(frames, name, (1,), "f8")
            steps.attrs["NSteps"] = np.int64(0)
        return cls(Path(path), product, n, names, 0)

    @classmethod
    def resume(cls, path: Path, frames: int | None = None) -> SeriesWriter:
        """Go on with a growing file; frames past `frames` will be written over.

        Raises
        ------
        InputFileError
            If the file is missing, damaged, or has fewer frames than asked.
        """
        with open_guarded(path, None) as file:
            product = attribute(file["ppmc"], "schema")
            root = group_of(file, "VTKHDF", Path(path))
            n = int(root["NumberOfPoints"][0])
            have = int(root["Steps"].attrs["NSteps"])
            static = {f.name for f in FIELDS[product] if f.static}
            names = tuple(name for name in root["PointData"] if name not in static)
        if frames is not None and have < frames:
            raise InputFileError(f"{path}: holds {have} frames, the checkpoint goes with {frames}; start the run anew")
        keep = have if frames is None else frames
        if keep != have:
            with _reopened(Path(path)) as file:
                file["VTKHDF/Steps"].attrs["NSteps"] = np.int64(keep)
        return cls(Path(path), product, n, names, keep)

    def append(
        self,
        time: float,
        positions: NDArray[np.floating],
        fields: Mapping[str, NDArray[Any]],
        scalars: Mapping[str, float] | None = None,
    ) -> None:
        """Add a frame.

        Parameters
        ----------
        time : float
            Time, s.
        positions : ndarray, shape (n, 3)
            Positions, mm.
        fields : mapping of str to ndarray, shape (n[, components])
            The fields named at creation, every one of them.
        scalars : mapping of str to float, optional
            The numbers named at creation.

        Raises
        ------
        StorageError
            If the disk is full or the file is held by another program for long.
        """
        if set(fields) != set(self.names):
            raise ValueError(f"a frame must bring {sorted(self.names)}, got {sorted(fields)}")
        k, n = self.frames, self.n
        try:
            with _reopened(self.path) as file:
                root = file["VTKHDF"]
                data, steps = root["PointData"], root["Steps"]
                _put_frame(root["Points"], k, vtkhdf.as_stored(positions, POSITION, (n,)))
                for name, values in fields.items():
                    _put_frame(data[name], k, vtkhdf.as_stored(values, spec_of(self.product, name), (n,)))
                for name, offset in steps["PointDataOffsets"].items():
                    _put_frame(offset, k, np.array([k * n if name in fields else 0]))
                _put_frame(steps["Values"], k, np.array([time]))
                _put_frame(steps["PartOffsets"], k, np.array([0]))
                _put_frame(steps["NumberOfParts"], k, np.array([1]))
                _put_frame(steps["PointOffsets"], k, np.array([k * n]))
                _put_frame(steps["CellOffsets"], k, np.zeros((1, 4)))
                _put_frame(steps["ConnectivityIdOffsets"], k, np.zeros((1, 4)))
                for name, dataset in file["ppmc/frames"].items():
                    _put_frame(dataset, k, np.array([float((scalars or {}).get(name, np.nan))]))
                file.flush()
                steps.attrs["NSteps"] = np.int64(k + 1)
        except (OSError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
            raise StorageError(f"{self.path}: frame {k} cannot be written ({reason}); {k} frames are safe") from error
        self.frames = k + 1

    def seal(
        self, final: Path, history: Mapping[str, NDArray[Any]] | None = None, extra: Mapping[str, Any] | None = None
    ) -> None:
        """Copy the frames into the final file, with the history of every step, and remove the growing one.

        Parameters
        ----------
        final : Path
            The product's file.
        history : mapping of str to ndarray, shape (steps,)
            Columns with a value each step, time among them.
        extra : mapping, optional
            Further facts, anything that JSON can hold.
        """
        count = self.frames * self.n
        growing = {"Points": count} | {f"PointData/{name}": count for name in self.names}
        with (
            open_guarded(self.path, self.product) as source,
            whole_file(final) as temporary,
            h5py.File(temporary, "w", libver=vtkhdf.SEALED) as file,
        ):

            def copy(name: str, item: Any) -> None:
                if isinstance(item, h5py.Group):
                    _copy_attributes(item, file.require_group(name))
                    return
                if name.startswith("VTKHDF/Steps/") or name.startswith("ppmc/frames/"):
                    values = item[: self.frames]
                else:
                    rows = growing.get(name.removeprefix("VTKHDF/"))
                    values = item[()] if rows is None else item[:rows]
                dataset = file.create_dataset(name, data=values)
                _copy_attributes(item, dataset)
                if isinstance(values, np.ndarray):
                    put_attribute(dataset, "sha256", vtkhdf.digest(values))

            source.visititems(copy)
            table = file["ppmc"].create_group("history")
            for name, values in (history or {}).items():
                table.create_dataset(name, data=np.asarray(values, dtype=np.float64))
            put_json(file["ppmc"], "extra", dict(extra or {}))
        self.path.unlink()


def _copy_attributes(source: Any, target: Any) -> None:
    """Copy attributes with their exact types (VTK wants fixed-length text)."""
    for name in source.attrs:
        target.attrs.create(name, source.attrs[name], dtype=source.attrs.get_id(name).dtype)


def _growing(group: h5py.Group, name: str, frame: tuple[int, ...], dtype: str) -> h5py.Dataset:
    """Return a new dataset that grows by one chunk a frame."""
    big = int(np.prod(frame)) > 64
    return group.create_dataset(
        name,
        shape=(0, *frame[1:]),
        maxshape=(None, *frame[1:]),
        chunks=frame,
        dtype=dtype,
        fillvalue=np.nan if np.dtype(dtype).kind == "f" else -1,
        compression="gzip" if big else None,
        compression_opts=1 if big else None,
        shuffle=big,
    )


def _put_frame(dataset: h5py.Dataset, k: int, values: NDArray[Any]) -> None:
    """Write chunk `k`, over what a killed writer may have left there."""
    rows = dataset.chunks[0]
    if dataset.shape[0] < (k + 1) * rows:
        dataset.resize((k + 1) * rows, axis=0)
    dataset[k * rows : (k + 1) * rows] = values


@contextmanager
def _reopened(path: Path) -> Iterator[h5py.File]:
    """Open a growing file for the moment of a frame; wait while a viewer holds it."""
    end = clock.monotonic() + LOCKED_SECONDS
    while True:
        try:
            file = h5py.File(path, "r+")
            break
        except BlockingIOError:
            if clock.monotonic() > end:
                raise StorageError(
                    f"{path}: another program has held it open for {LOCKED_SECONDS:.0f} s; close that, and resume"
                ) from None
            clock.sleep(LOCKED_WAIT_SECONDS)
    with file:
        yield file
    with path.open("rb") as handle:
        os.fsync(handle.fileno())
