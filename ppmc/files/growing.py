"""Write products that change in time: the flow history and the analysis.

While it grows, a product is a folder: a header, and one small sealed file for each frame, written whole and renamed.
Whatever ends the writer, at whatever moment, all frames but the one in flight are there, and none is ever touched
again. An index in the folder lets ParaView and pyvista watch. When the run is over the frames are joined into one
file, which appears whole; only then the folder goes.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError, StorageError
from ppmc.files import vtkhdf
from ppmc.files.digests import LENGTH, digest, put_block_digests, put_digest
from ppmc.files.fields import FIELDS, SCHEMA_VERSION
from ppmc.files.fields import field as spec_of
from ppmc.files.frame_files import HEADER, OWN_FILE, FrameFolder, frame_name
from ppmc.files.hdf5_output import new_hdf5
from ppmc.files.particles import POSITION
from ppmc.files.provenance import Provenance
from ppmc.files.storage import whole_file
from ppmc.files.text import put_attribute, put_json

LINKED = ("NumberOfPoints", "Vertices", "Lines", "Polygons", "Strips")  # the same in every frame


def growing_folder(final: Path) -> Path:
    """Return the folder in which a product grows until it is complete."""
    return final.with_name(f"{final.stem}.partial")


class SeriesWriter:
    """A growing product.

    Attributes
    ----------
    path : Path
        The folder.
    frames : int
        Finished frames in it.
    """

    def __init__(
        self, path: Path, product: str, n: int, names: tuple[str, ...], scalars: tuple[str, ...],
        provenance: Provenance, run: str, frames: int,
    ) -> None:  # fmt: skip
        self.path = Path(path)
        self.product = product
        self.n = n
        self.names = names
        self.scalars = scalars
        self.provenance = provenance
        self.run = run
        self.frames = frames
        self._times: list[float] = []

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
        """Make a product without frames.

        Parameters
        ----------
        path : Path
            The folder in which it grows; replaced if it exists.
        n : int
            Number of particles, the same at all times.
        static : mapping of str to ndarray, shape (n[, components])
            Fields with one value for all times.
        fields : iterable of str
            Fields that every frame will bring.
        scalars : iterable of str
            Numbers that every frame will bring.
        provenance : Provenance
            Origin of the product.
        product : str
            ``"flow"`` or ``"analysis"``.

        Raises
        ------
        StorageError
            If the folder cannot be written, or holds files of others.
        """
        path = Path(path)
        names, numbers = tuple(fields), tuple(scalars)
        FrameFolder.clear(path)
        with new_hdf5(path / HEADER) as new:
            root = vtkhdf.begin(new.file, "PolyData")
            data = vtkhdf.points_header(root, n)
            for name, values in static.items():
                vtkhdf.put(data, spec_of(product, name), values, (n,), provenance.creator)
            provenance.store(new.file, product)
            put_json(new.file["ppmc"], "growing", {"fields": names, "scalars": numbers, "n": n})
        return cls(path, product, n, names, numbers, provenance, provenance.key, 0)

    @classmethod
    def resume(cls, path: Path, frames: int | None = None, provenance: Provenance | None = None) -> SeriesWriter:
        """Go on with a growing product; frames past `frames` go.

        Parameters
        ----------
        path : Path
            The folder.
        frames : int, optional
            How many frames to keep; all by default.
        provenance : Provenance, optional
            Origin that the complete product will state; that of the beginning by default.

        Raises
        ------
        InputFileError
            If the folder is missing, a frame to be kept is damaged, or there are fewer than asked.
        """
        folder = FrameFolder.open(path)
        have = folder.sound_frames(frames)
        if frames is not None and have < frames:
            raise InputFileError(
                f"{path}: holds {have} sound frames, the checkpoint goes with {frames}; start anew with --restart"
            )
        folder.drop_from(have)
        writer = cls(
            folder.path, folder.product, folder.n, folder.names, folder.scalars,
            provenance or folder.provenance, folder.run, have,
        )  # fmt: skip
        writer._times = [folder.time_of(k) for k in range(have)]
        writer._write_index()
        return writer

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
            If the disk is full, or another process has taken the output.
        """
        if set(fields) != set(self.names):
            raise ValueError(f"a frame must bring {sorted(self.names)}, got {sorted(fields)}")
        k, n = self.frames, self.n
        try:
            with new_hdf5(self.path / frame_name(k)) as new:
                root = vtkhdf.begin(new.file, "PolyData")
                for name in LINKED:
                    root[name] = h5py.ExternalLink(HEADER, f"VTKHDF/{name}")
                data = root.create_group("PointData")
                stored = vtkhdf.as_stored(positions, POSITION, (n,))
                put_digest(root.create_dataset("Points", data=stored), stored)
                for name in self.names:
                    vtkhdf.put(data, spec_of(self.product, name), fields[name], (n,), self.provenance.creator)
                for spec in FIELDS[self.product]:
                    if spec.static:
                        data[spec.name] = h5py.ExternalLink(HEADER, f"VTKHDF/PointData/{spec.name}")
                own = new.file.create_group("ppmc")
                put_attribute(own, "schema", "frame")
                own.attrs["schema_version"] = SCHEMA_VERSION
                put_attribute(own, "run", self.run)
                own.attrs["frame"] = np.int64(k)
                own.attrs["time"] = np.float64(time)
                own.attrs["scalars"] = np.array([(scalars or {}).get(s, np.nan) for s in self.scalars], np.float64)
            self._times = [*self._times[:k], float(time)]
            self._write_index()
        except StorageError as error:
            raise StorageError(f"{error}; {k} frames are safe in {self.path}") from error
        self.frames = k + 1

    def _write_index(self) -> None:
        """Write the list of frames that viewers take for one animation."""
        files = [{"name": frame_name(k), "time": time} for k, time in enumerate(self._times)]
        with whole_file(self.path / f"{self.path.stem}.vtkhdf.series") as temporary:
            temporary.write_text(json.dumps({"file-series-version": "1.0", "files": files}), encoding="utf-8")

    def seal(
        self, final: Path, history: Mapping[str, NDArray[Any]] | None = None, extra: Mapping[str, Any] | None = None
    ) -> None:
        """Join the frames to the complete product, with the history of every step and remove the folder.

        Parameters
        ----------
        final : Path
            The product's file.
        history : mapping of str to ndarray, shape (steps,)
            Columns with a value each step, time among them.
        extra : mapping, optional
            Further facts, anything that JSON can hold.

        Raises
        ------
        InputFileError
            If a frame has been damaged since it was written.
        StorageError
            If the file cannot be written; all frames stay then.
        """
        folder = FrameFolder.open(self.path)
        count, n = self.frames, self.n
        with new_hdf5(final) as new:
            file = new.file
            root = vtkhdf.begin(file, "PolyData")
            data = vtkhdf.points_header(root, n)
            for name, values in folder.static().items():
                vtkhdf.put(data, spec_of(self.product, name), values, (n,), self.provenance.creator)
            targets = {"Points": root.create_dataset("Points", shape=(count * n, 3), dtype="f8")}
            put_attribute(targets["Points"], "unit", "mm")
            for name in self.names:
                spec = spec_of(self.product, name)
                shape = (count * n,) if spec.components == 1 else (count * n, spec.components)
                targets[name] = data.create_dataset(name, shape=shape, dtype=spec.dtype)
                vtkhdf.describe(targets[name], spec, self.provenance.creator)
            digests = {name: np.zeros((count, LENGTH), np.uint8) for name in targets}
            scalars = np.full((count, len(self.scalars)), np.nan)
            for k in range(count):
                with folder.frame(k) as frame:
                    for name, target in targets.items():
                        values = frame.read(name)
                        target[k * n : (k + 1) * n] = values
                        digests[name][k] = np.frombuffer(bytes.fromhex(digest(values)), np.uint8)
                    scalars[k] = frame.scalars
                new.check()
            for name, target in targets.items():
                block = (n, *target.shape[1:])
                found = digests[name].reshape(count, *(1,) * (target.ndim - 1), LENGTH)
                put_block_digests(target, block, found)
            self._put_steps(root, folder, count)
            self.provenance.store(file, self.product)
            own = file["ppmc"]
            frames = own.create_group("frames")
            for name, column in zip(self.scalars, scalars.T, strict=True):
                frames.create_dataset(name, data=column)
            table = own.create_group("history")
            for name, values in (history or {}).items():
                table.create_dataset(name, data=np.asarray(values, dtype=np.float64))
            put_json(own, "extra", dict(extra or {}))
        self.remove()

    def _put_steps(self, root: h5py.Group, folder: FrameFolder, count: int) -> None:
        """Write where each time step begins, as VTK wants it."""
        n = self.n
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(count)
        begins = np.arange(count, dtype=np.int64) * n
        steps["Values"] = np.array([folder.time_of(k) for k in range(count)], dtype=np.float64)
        put_attribute(steps["Values"], "unit", "s")
        steps["PartOffsets"] = np.zeros(count, np.int64)
        steps["NumberOfParts"] = np.ones(count, np.int64)
        steps["PointOffsets"] = begins
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            steps[name] = np.zeros((count, 4), np.int64)
        # Viewers that open one frame only, as pyvista.read does with the first, have the times of all beside it.
        # Groups are made by name: those that HDF5 makes on the way to a dataset carry the time of day.
        times = root.create_group("FieldData").create_dataset("frame_times", data=steps["Values"][:])
        put_attribute(times, "unit", "s")
        steps.create_group("FieldDataOffsets")["frame_times"] = np.zeros(count, np.int64)
        sizes = np.tile(np.array([1, count], np.int64), (count, 1))
        steps.create_group("FieldDataSizes")["frame_times"] = sizes
        offsets = steps.create_group("PointDataOffsets")
        for name in root["PointData"]:
            offsets[name] = begins if name in self.names else np.zeros(count, np.int64)

    def remove(self) -> None:
        """Remove the folder: the product is complete, or nobody wants it."""
        remove_growing(self.path)


def remove_growing(folder: Path) -> None:
    """Remove the folder of a growing product, at one stroke for all who look; one that holds anything else stays."""
    if not folder.is_dir() or any(not OWN_FILE.fullmatch(path.name) for path in folder.iterdir()):
        return
    aside = folder.with_name(f".{folder.name}.{os.getpid()}.tmp")
    with suppress(OSError):
        folder.rename(aside)
        shutil.rmtree(aside)
