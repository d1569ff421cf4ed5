"""What a file holds, in words: the text of ``ppmc info``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ppmc.files.digests import DIGESTS
from ppmc.files.fields import FIELDS, MADE_BY, UNITS
from ppmc.files.frame_files import HEADER, FrameFolder, frame_name
from ppmc.files.guard import (
    block_check,
    check_unchanged,
    check_values,
    compare_block,
    compare_whole,
    dataset_of,
    group_of,
    open_guarded,
    read_whole,
)
from ppmc.files.provenance import Provenance
from ppmc.files.text import attribute, numbers, read_json
from ppmc.files.verdict import KEY, read_verdict

SUMMARY_VALUES = 2_000_000
SLAB_BYTES = 2**26
MEANING = {
    "volume": "grey values of a CT volume, with the true orientations if a phantom made it",
    "orientations": "fibre direction and platelet normal of each voxel of a CT volume",
    "charge": "the particles before moulding, each with its platelet's frame",
    "flow": "the particles through the moulding, a frame for each output time",
    "analysis": "orientation tensors of regions and path slices, a point for each",
    "frame": "one frame of a product that is still growing; its folder is the whole",
    "checkpoint": "the exact state of an unfinished flow simulation, to resume from",
}


def describe_file(path: Path) -> str:
    """Return a description of a ppmc file for someone who has never seen one.

    Parameters
    ----------
    path : Path
        Any file that a stage wrote.

    Returns
    -------
    str
        What it is, its fields as "name / unit: description" with ranges, times, and where it comes from.

    Raises
    ------
    InputFileError
        If the file is missing, damaged or not of ppmc.
    """
    path = Path(path)
    if (path / HEADER).is_file():
        return _describe_growing(path)
    with open_guarded(path, None) as file:
        product = attribute(file["ppmc"], "schema")
        lines = [
            f"{path}",
            f"  {product}: {MEANING.get(product, '')}",
            f"  {_size(path.stat().st_size)}; units {UNITS}",
        ]
        if product in FIELDS:
            lines += ["", *_shape(file, path, product), "", "Fields (name / unit: description)"]
            lines += list(_fields(file, path, product))
        if product == "flow":
            lines += ["", *_verdict(file, path)]
        lines += list(_tables(file))
        lines += ["", *_origin(Provenance.load(file), product)]
        if product in FIELDS:
            lines += ["", "Open it in ParaView as it is, or in Python: pyvista.read(file) or ppmc.files"]
    return "\n".join(lines)


def _describe_growing(path: Path) -> str:
    """Return a description of a product that is not complete yet: its last frame stands for it."""
    folder = FrameFolder.open(path)
    count = folder.count()
    lines = [f"{path}", f"  {folder.product}: {MEANING[folder.product]}", f"  {folder.n:,} particles, {count} frames"]
    if count:
        lines[-1] += f" from {folder.time_of(0):g} s to {folder.time_of(count - 1):g} s"
    lines.append("  still growing, or its run was stopped: 'ppmc solve' goes on with it")
    lines += ["", f"Fields: {', '.join(folder.names)}", "", *_origin(folder.provenance, folder.product)]
    watched = path / f"{path.stem}.vtkhdf.series"
    return "\n".join([*lines, "", f"Watch it in ParaView or pyvista: {watched}"])


def _size(count: int) -> str:
    """Return a byte count for people."""
    return f"{count / 2**20:.1f} MiB" if count > 2**19 else f"{count / 2**10:.1f} KiB"


def _shape(file: h5py.File, path: Path, product: str) -> list[str]:
    """Return how many voxels, particles or regions, where, and at what times."""
    root = group_of(file, "VTKHDF", path)
    if product in ("volume", "orientations"):
        x0, x1, y0, y1, z0, z1 = (int(v) for v in numbers(root, "WholeExtent", 6))
        counts = np.array([x1 - x0 + 1, y1 - y0 + 1, z1 - z0 + 1])
        spacing, origin = numbers(root, "Spacing", 3), numbers(root, "Origin", 3)
        turned = "" if np.allclose(numbers(root, "Direction", 9), np.eye(3).ravel()) else ", axes turned (Direction)"
        return [
            f"{counts[0]} x {counts[1]} x {counts[2]} voxels (x, y, z) of {' x '.join(f'{s:g}' for s in spacing)} mm",
            f"first voxel's centre at ({', '.join(f'{v:g}' for v in origin)}) mm{turned}",
        ]
    n = int(read_whole(file, "VTKHDF/NumberOfPoints", path)[0])
    points = dataset_of(file, "VTKHDF/Points", path)
    what = "regions" if product == "analysis" else "particles"
    lines = [f"{n:,} {what}"]
    if "Steps" in root:
        frames = int(numbers(root["Steps"], "NSteps", 1)[0])
        times = dataset_of(file, "VTKHDF/Steps/Values", path)[:frames]
        lines.append(f"{frames} frames from {times[0]:g} s to {times[-1]:g} s" if frames else "no frame yet")
        spans = [("start", points[:n]), ("end", points[(frames - 1) * n : frames * n])] if frames else []
    else:
        spans = [("span", points[:n])]
    for name, x in spans:
        low, high = np.nanmin(x, axis=0), np.nanmax(x, axis=0)
        lines.append(f"{name}: " + ", ".join(f"x{i + 1} {low[i]:.4g} to {high[i]:.4g}" for i in range(3)) + " mm")
    return lines


def _fields(file: h5py.File, path: Path, product: str) -> Iterator[str]:
    """Yield a line for each field: name / unit: description, and the range of its last values."""
    data = group_of(file, "VTKHDF/PointData", path)
    for name in data:
        dataset = dataset_of(file, f"VTKHDF/PointData/{name}", path)
        unit, doc = attribute(dataset, "unit", "?"), attribute(dataset, "description")
        yield f"  {name} / {unit}: {doc}{_range(dataset)}"


def _range(dataset: h5py.Dataset) -> str:
    """Return the range of a scalar field, or the number of components; the last part stands for large ones."""
    if dataset.ndim > 1 and dataset.shape[-1] in (3, 6, 9):
        return f" [{dataset.shape[-1]} components]"
    rows = max(1, SUMMARY_VALUES // max(1, int(np.prod(dataset.shape[1:]))))
    values = dataset[-rows:]
    if values.dtype.kind == "f":
        values = values[np.isfinite(values)]
    if not values.size:
        return " [no values]"
    return f" [{values.min():.5g} to {values.max():.5g}]"


def _verdict(file: h5py.File, path: Path) -> Iterator[str]:
    """Yield what a flow says about itself: the verdict, and every limit."""
    verdict = read_verdict(read_json(file["ppmc"], "extra"), path)
    if verdict is None:
        yield "Verdict: none; the run has not come to its end, or an older version wrote the file"
        return
    yield f"Verdict: {verdict.headline}"
    yield from (f"  {'  ' if finding.kept else '! '}{finding.told()}" for finding in verdict.findings)


def _tables(file: h5py.File) -> Iterator[str]:
    """Yield what else the file holds: numbers of each frame, of each step, and facts about the whole."""
    own = file["ppmc"]
    if len(own.get("frames", ())):
        yield f"Numbers of each frame: {', '.join(own['frames'])}"
    if len(own.get("history", ())):
        rows = next(iter(own["history"].values())).shape[0]
        yield f"History of {rows} steps: {', '.join(own['history'])}"
    for key, value in read_json(own, "extra").items():
        if key == KEY:
            continue
        text = json.dumps(value)
        yield f"  {key} = {text if len(text) < 90 else text[:87] + '...'}"


def _origin(origin: Provenance, product: str) -> list[str]:
    """Return where the file comes from."""
    lines = [f"Made by {MADE_BY.get(product, origin.creator)} ({origin.creator} {origin.ppmc_version})"]
    if origin.scene:
        lines.append(f"  scene '{origin.scene.get('name')}', stored whole in /ppmc/scene")
    if origin.seed is not None:
        lines.append(f"  seed {origin.seed}")
    lines += [f"  from {name}, SHA-256 {value[:16]}..." for name, value in origin.inputs.items()]
    if origin.packages:
        lines.append("  with " + ", ".join(f"{k} {v}" for k, v in origin.packages.items()))
    return lines


def verify_file(path: Path) -> list[str]:
    """Read a whole file, or the folder of a growing one, and verify every value against contract and digest.

    Returns
    -------
    list of str
        A line for each dataset that was verified.

    Raises
    ------
    InputFileError
        At the first fault, naming the dataset.
    """
    path = Path(path)
    if (path / HEADER).is_file():
        parts = [path / HEADER, *(path / frame_name(k) for k in range(FrameFolder.open(path).count()))]
        return [f"{part.name}{line}" for part in parts for line in verify_file(part)]
    lines = []
    with open_guarded(path, None) as file:
        product = attribute(file["ppmc"], "schema")
        specs = {f.name: f for f in FIELDS.get(product, ())}
        found: list[str] = []
        file.visititems(lambda n, o: found.append(n) if isinstance(o, h5py.Dataset) else None)
        for name in found:
            dataset = dataset_of(file, name, path)
            spec = specs.get(name.rsplit("/", 1)[-1]) if name.startswith("VTKHDF/PointData/") else None
            check = block_check(file, name, path)
            noted = "sha256" in dataset.attrs or f"{DIGESTS}/{name}" in file
            for rows in _parts(dataset, check.block):
                values: Any = dataset[rows] if rows else dataset[()]
                if spec is not None:
                    check_values(values, spec, dataset.name, path)
                if rows and f"{DIGESTS}/{name}" in file:
                    compare_block(check, rows, path)
                else:
                    compare_whole(dataset, values, path)
            if noted or spec is not None:
                lines.append(f"{dataset.name}: {'values and digest' if noted else 'values'} verified")
        check_unchanged(file, path)
    return lines


def _parts(dataset: h5py.Dataset, block: tuple[int, ...]) -> list[tuple[slice, ...]]:
    """Return slabs that cover a dataset, of a few blocks each; a single empty one for what is read whole."""
    if dataset.ndim == 0 or "sha256" in dataset.attrs or not dataset.size:
        return [()]
    rows = max(1, SLAB_BYTES // max(1, dataset.nbytes // dataset.shape[0]) // max(1, block[0])) * max(1, block[0])
    return [(slice(k, min(k + rows, dataset.shape[0])),) for k in range(0, dataset.shape[0], rows)]
