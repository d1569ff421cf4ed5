"""Where a run goes on: the furthest checkpoint that is whole, has its frames, and belongs to the same run."""

from pathlib import Path
from typing import Any

from ppmc.errors import InputFileError, SceneError
from ppmc.files import Provenance, SeriesWriter, growing_folder
from ppmc.files.frame_files import FrameFolder
from ppmc.scene.depends import FLOW_SECTIONS
from ppmc.solver.run.checkpoint import Checkpoint, sound_checkpoints
from ppmc.solver.step.model import Model

# What may differ: it changes how far a run goes and what it writes on the way, not the flow it has computed so far.
FREE = ("solver.end_time", "solver.output_interval", "solver.output_times", "solver.checkpoint_interval")
MOST_DIFFERENCES = 8
RESTART = "say --restart to start over and lose them, or name another --output"


def where_to_go_on(output: Path, model: Model, provenance: Provenance) -> tuple[Checkpoint, SeriesWriter] | None:
    """Return the checkpoint and the growing history of an unfinished run, None if there is none to go on with.

    Raises
    ------
    SceneError
        If the unfinished run is of another scene, input or version; all differences are named.
    InputFileError
        If no checkpoint has all its frames.
    """
    folder = growing_folder(output)
    found = sound_checkpoints(output)
    if not found or not folder.is_dir():
        return None
    furthest, origin = found[0]
    differences = _differences(origin, provenance) or _other_constants(furthest, model)
    if differences:
        shown = differences[:MOST_DIFFERENCES]
        if len(differences) > len(shown):
            shown.append(f"and {len(differences) - len(shown)} more")
        raise SceneError(
            f"{output}: {furthest.frames} frames up to t = {furthest.time:.6g} s are there, of a run that differs: "
            f"{'; '.join(shown)}; {RESTART}"
        )
    if furthest.time > model.settings.end_time:
        raise SceneError(
            f"{output}: the run is at t = {furthest.time:.6g} s, solver.end_time is {model.settings.end_time:.6g} s; "
            f"give a later end, {RESTART}"
        )
    have = FrameFolder.open(folder).sound_frames(furthest.frames)
    for checkpoint, _ in found:
        if checkpoint.frames <= have:
            return checkpoint, SeriesWriter.resume(folder, checkpoint.frames, provenance)
    raise InputFileError(
        f"{folder}: {have} frames are whole, but the checkpoint goes with {furthest.frames}: a frame was removed or "
        f"damaged; {RESTART}"
    )


def constants_of(model: Model) -> dict[str, float]:
    """Return what a run derives from its scene once, and must not change on the way."""
    return {
        "bulk modulus": model.bulk_modulus,
        "density": model.density,
        "smoothing length": model.smoothing_length,
    }


def _other_constants(checkpoint: Checkpoint, model: Model) -> list[str]:
    """Return derived constants that are not what they were; a later end can bring a faster tool."""
    now = constants_of(model)
    return [
        f"{name}: {value:.9g} -> {now[name]:.9g} (from the tools' motion up to the end)"
        for name, value in checkpoint.constants.items()
        if name in now and value != now[name]
    ]


def _differences(then: Provenance, now: Provenance) -> list[str]:
    """Return in words what differs between two origins as far as the flow depends on it."""
    out = []
    if then.ppmc_version != now.ppmc_version:
        out.append(f"ppmc {then.ppmc_version} -> {now.ppmc_version}")
    if sorted(then.inputs.values()) != sorted(now.inputs.values()):
        names = sorted(set(then.inputs) | set(now.inputs))
        out += [f"{name}: other content" for name in names if then.inputs.get(name) != now.inputs.get(name)]
    for section in FLOW_SECTIONS:
        before, after = (_flat(p.scene.get(section), section) for p in (then, now))
        for key in sorted(set(before) | set(after)):
            if key not in FREE and before.get(key) != after.get(key):
                out.append(f"{key}: {before.get(key, 'absent')} -> {after.get(key, 'absent')}")
    return out


def _flat(value: Any, key: str) -> dict[str, Any]:
    """Return the leaves of nested sections by dotted key."""
    if not isinstance(value, dict) or not value:
        return {key: value}
    return {k: v for name, inner in value.items() for k, v in _flat(inner, f"{key}.{name}").items()}
