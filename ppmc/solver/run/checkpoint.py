"""Checkpoints: two files in turn, so that one is whole whenever the other is being written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ppmc.errors import InputFileError
from ppmc.files import Provenance, read_state, write_state
from ppmc.solver.particles.state import ParticleState


@dataclass
class Checkpoint:
    """Everything that a resumed run needs to go on bit for bit.

    Attributes
    ----------
    state : ParticleState
    list_positions, list_shape : ndarray
        Positions and kernel shapes from which the neighbour list was last made.
    history : ndarray, shape (steps, columns)
    forced, forced_speed : ndarray, shapes (tools, 3) and (2, forced)
        Displacement, mm, and speed, mm/s, with its trend, of the tools driven by a force.
    time, time_step : float
        Time reached and last step, s.
    frames : int
        Frames written so far.
    constants : dict of str to float
        What the run derived from its scene at the start.
    """

    state: ParticleState
    list_positions: np.ndarray
    list_shape: np.ndarray
    history: np.ndarray
    forced: np.ndarray
    forced_speed: np.ndarray
    time: float
    time_step: float
    frames: int
    constants: dict[str, float]


def checkpoint_paths(output: Path) -> tuple[Path, Path]:
    """Return both checkpoint files of an output."""
    return output.with_name(f"{output.stem}.checkpoint-a.h5ckpt"), output.with_name(
        f"{output.stem}.checkpoint-b.h5ckpt"
    )


def crash_path(output: Path) -> Path:
    """Return where the state goes in which a run of an output has failed."""
    return output.with_name(f"{output.stem}.crash.h5ckpt")


def save_checkpoint(output: Path, checkpoint: Checkpoint, provenance: Provenance) -> Path:
    """Write over the older of the two files."""
    first, second = checkpoint_paths(output)
    ages = [path.stat().st_mtime_ns if path.exists() else -1 for path in (first, second)]
    path = first if ages[0] <= ages[1] else second
    arrays = {f"state_{name}": values for name, values in checkpoint.state.arrays().items()}
    arrays |= {
        name: getattr(checkpoint, name)
        for name in ("list_positions", "list_shape", "history", "forced", "forced_speed")
    }
    # Floats go as hexadecimal text: exact, where a decimal detour need not be.
    attributes: dict[str, Any] = {
        "time": float(checkpoint.time).hex(),
        "time_step": float(checkpoint.time_step).hex(),
        "frames": checkpoint.frames,
        "constants": {name: float(value).hex() for name, value in checkpoint.constants.items()},
    }  # fmt: skip
    write_state(path, arrays, attributes, provenance=provenance)
    return path


def sound_checkpoints(output: Path) -> list[tuple[Checkpoint, Provenance]]:
    """Return the checkpoints of an output that are whole, the furthest first, each with its origin."""
    found = []
    for path in checkpoint_paths(output):
        if not path.exists():
            continue
        try:
            arrays, attributes, provenance = read_state(path)
            state = ParticleState(**_with_prefix(arrays, "state_"))
            checkpoint = Checkpoint(
                state, arrays["list_positions"], arrays["list_shape"], arrays["history"], arrays["forced"],
                arrays["forced_speed"], float.fromhex(attributes["time"]), float.fromhex(attributes["time_step"]),
                attributes["frames"], {k: float.fromhex(v) for k, v in attributes["constants"].items()},
            )  # fmt: skip
        except (InputFileError, KeyError, TypeError):
            continue  # damaged, or of another version; the other one is there for that
        found.append((checkpoint, provenance))
    return sorted(found, key=lambda pair: pair[0].time, reverse=True)


def remove_checkpoints(output: Path) -> None:
    """Delete both files, once the run is complete and they are of no use."""
    for path in checkpoint_paths(output):
        path.unlink(missing_ok=True)


def _with_prefix(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}
