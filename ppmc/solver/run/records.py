"""What a run leaves behind: a growing flow history with checkpoints in files, or the same frames in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ppmc.files import MemorySeries, Provenance, SeriesFile, SeriesWriter, growing_folder, write_state
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.run.checkpoint import Checkpoint, crash_path, remove_checkpoints, save_checkpoint
from ppmc.solver.run.history import table_path
from ppmc.solver.run.resume import where_to_go_on
from ppmc.solver.step.model import Model


class Record(Protocol):
    """Where a run puts its frames and all else.

    Attributes
    ----------
    keeps : bool
        Whether it keeps checkpoints, from which a run that was stopped can go on.
    """

    keeps: bool

    @property
    def frames(self) -> int:
        """Frames taken so far."""

    @property
    def table(self) -> Path | None:
        """The CSV file that mirrors the table of steps."""

    def going_on(self, model: Model, resume: bool) -> Checkpoint | None:
        """Return the checkpoint that an unfinished run goes on from."""

    def begin(self, static: Mapping[str, np.ndarray], names: Iterable[str], scalars: Iterable[str]) -> None:
        """Begin anew: fields that do not change, and the names of those and of the numbers each frame brings."""

    def append(
        self, time: float, positions: np.ndarray, fields: Mapping[str, np.ndarray], scalars: Mapping[str, float]
    ) -> None:
        """Take a frame."""

    def save(self, checkpoint: Checkpoint) -> None:
        """Keep a checkpoint."""

    def dump(self, state: ParticleState, time: float) -> Path | None:
        """Keep a state that went wrong, and return where."""

    def seal(self, history: Mapping[str, np.ndarray], facts: Mapping[str, Any]) -> None:
        """Take the table of steps and facts about the whole: the run is complete."""


class FileRecord:
    """A flow history that grows in the folder ``<stem>.partial`` beside its checkpoints until it is complete.

    Parameters
    ----------
    output : Path
        The complete history.
    provenance : Provenance
    """

    keeps = True

    def __init__(self, output: Path, provenance: Provenance) -> None:
        self.output = output
        self.provenance = provenance
        self._writer: SeriesWriter | None = None

    @property
    def frames(self) -> int:
        """Frames written so far."""
        return 0 if self._writer is None else self._writer.frames

    @property
    def table(self) -> Path:
        """The live table of steps."""
        return table_path(self.output)

    def going_on(self, model: Model, resume: bool) -> Checkpoint | None:
        """Return the checkpoint to go on from, its frames opened; without one all that is left of old runs goes.

        Raises
        ------
        SceneError
            If the unfinished run is of another scene, input or version.
        InputFileError
            If no checkpoint has all its frames.
        """
        found = where_to_go_on(self.output, model, self.provenance) if resume else None
        if found is None:
            remove_checkpoints(self.output)
            return None
        checkpoint, self._writer = found
        return checkpoint

    def begin(self, static: Mapping[str, np.ndarray], names: Iterable[str], scalars: Iterable[str]) -> None:
        """Make the folder of frames."""
        n = len(static["volume"])
        self._writer = SeriesWriter.create(
            growing_folder(self.output), n, static, names, scalars, provenance=self.provenance
        )

    def append(
        self, time: float, positions: np.ndarray, fields: Mapping[str, np.ndarray], scalars: Mapping[str, float]
    ) -> None:
        """Write a frame."""
        assert self._writer is not None
        self._writer.append(time, positions, fields, scalars)

    def save(self, checkpoint: Checkpoint) -> None:
        """Write a checkpoint over the older of two."""
        save_checkpoint(self.output, checkpoint, self.provenance)

    def dump(self, state: ParticleState, time: float) -> Path:
        """Write a state that went wrong beside the output."""
        path = crash_path(self.output)
        write_state(path, state.arrays(), {"time": time}, provenance=self.provenance)
        return path

    def seal(self, history: Mapping[str, np.ndarray], facts: Mapping[str, Any]) -> None:
        """Join the frames to the complete file; checkpoints are no longer needed."""
        assert self._writer is not None
        self._writer.seal(self.output, history, facts)
        remove_checkpoints(self.output)


@dataclass
class MemoryRecord:
    """A flow history in memory, about 240 bytes a particle and frame.

    Attributes
    ----------
    provenance : Provenance
    """

    provenance: Provenance
    keeps: bool = False
    table: None = None
    _series: MemorySeries | None = field(default=None, init=False)

    @property
    def frames(self) -> int:
        """Frames taken so far."""
        return 0 if self._series is None else len(self._series.times)

    def series(self) -> SeriesFile | None:
        """Return the frames taken so far, as a flow file of them would be read; None before the first."""
        return self._series.opened() if self._series is not None and self.frames else None

    def going_on(self, model: Model, resume: bool) -> None:
        """Return nothing: memory holds no unfinished run."""

    def begin(self, static: Mapping[str, np.ndarray], names: Iterable[str], scalars: Iterable[str]) -> None:
        """Begin without frames."""
        self._series = MemorySeries("flow", static, tuple(names), tuple(scalars), self.provenance)

    def append(
        self, time: float, positions: np.ndarray, fields: Mapping[str, np.ndarray], scalars: Mapping[str, float]
    ) -> None:
        """Keep a frame."""
        assert self._series is not None
        self._series.append(time, positions, fields, scalars)

    def save(self, checkpoint: Checkpoint) -> None:
        """Keep nothing: what stops the process ends a run in memory."""

    def dump(self, state: ParticleState, time: float) -> None:
        """Keep nothing: the frames so far are at hand."""

    def seal(self, history: Mapping[str, np.ndarray], facts: Mapping[str, Any]) -> None:
        """Take the table of steps and the facts."""
        assert self._series is not None
        self._series.seal(history, facts)
