"""A product that changes in time, kept in memory: what is taken from it is what its file would give, bit for bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.files.fields import FIELDS
from ppmc.files.fields import field as spec_of
from ppmc.files.growing import SeriesWriter, growing_folder
from ppmc.files.particles import POSITION
from ppmc.files.provenance import Provenance
from ppmc.files.series import SeriesFile


class MemorySeries:
    """A growing product in memory.

    Parameters
    ----------
    product : str
        ``"flow"`` or ``"analysis"``.
    static : mapping of str to ndarray, shape (n[, components])
        Fields with one value for all times.
    names, scalars : tuple of str
        Fields and numbers that every frame brings.
    provenance : Provenance

    Attributes
    ----------
    times : list of float
        Of the frames, s.
    """

    def __init__(
        self, product: str, static: Mapping[str, NDArray[Any]], names: tuple[str, ...], scalars: tuple[str, ...],
        provenance: Provenance,
    ) -> None:  # fmt: skip
        self.product = product
        self.names = names
        self.scalars = scalars
        self.provenance = provenance
        self.static = {name: np.array(values, spec_of(product, name).dtype) for name, values in static.items()}
        self.times: list[float] = []
        self._frames: list[dict[str, NDArray[Any]]] = []
        self._numbers: list[list[float]] = []
        self._history: dict[str, NDArray[np.float64]] = {}
        self._extra: dict[str, Any] = {}
        self._complete = False

    def append(
        self, time: float, positions: NDArray[np.floating], fields: Mapping[str, NDArray[Any]],
        scalars: Mapping[str, float],
    ) -> None:  # fmt: skip
        """Add a frame, as :meth:`ppmc.files.SeriesWriter.append` does."""
        if set(fields) != set(self.names):
            raise ValueError(f"a frame must bring {sorted(self.names)}, got {sorted(fields)}")
        frame = {name: np.array(fields[name], spec_of(self.product, name).dtype) for name in self.names}
        self._frames.append({"Points": np.array(positions, POSITION.dtype), **frame})
        self._numbers.append([scalars.get(name, np.nan) for name in self.scalars])
        self.times.append(float(time))

    def seal(self, history: Mapping[str, NDArray[Any]], extra: Mapping[str, Any]) -> None:
        """Add the table of steps and further facts: the run is complete."""
        self._history = {name: np.array(values, np.float64) for name, values in history.items()}
        # As JSON gives it back: lists, no tuples.
        self._extra, self._complete = json.loads(json.dumps(dict(extra))), True

    def opened(self) -> SeriesFile:
        """Return the product as if it had been read from its file."""
        frames = list(self._frames)
        numbers = np.array(self._numbers[: len(frames)]).reshape(len(frames), len(self.scalars))
        return SeriesFile(
            path=Path(f"{self.product} in memory"),
            product=self.product,
            n=len(next(iter(self.static.values()))),
            times=np.array(self.times[: len(frames)]),
            # In the order of the contract, as a file is read.
            names=tuple(spec.name for spec in FIELDS[self.product] if spec.name in self.names),
            static=self.static,
            scalars=dict(zip(self.scalars, numbers.T.copy(), strict=True)),
            history=self._history,
            extra=self._extra,
            complete=self._complete,
            provenance=self.provenance,
            # A copy, as from a file: what is done to it stays with whoever took it.
            _read=lambda k, names: [frames[k][name].copy() for name in names],
        )


def write_series(series: SeriesFile, output: Path, provenance: Provenance | None = None) -> Path:
    """Write a product as the file that its stage would have written.

    Parameters
    ----------
    series : SeriesFile
    output : Path
        The file to make.
    provenance : Provenance, optional
        Origin that the file states; that of `series` by default.

    Raises
    ------
    StorageError
        If the file cannot be written.
    """
    writer = SeriesWriter.create(
        growing_folder(output), series.n, series.static, series.names, tuple(series.scalars),
        provenance=provenance or series.provenance, product=series.product,
    )  # fmt: skip
    try:
        for k, time in enumerate(series.times):
            fields = series.frame(k)
            scalars = {name: float(values[k]) for name, values in series.scalars.items()}
            writer.append(float(time), fields.pop("position"), fields, scalars)
        writer.seal(output, series.history, series.extra)
    finally:
        writer.remove()  # gone already if it was sealed
    return output
