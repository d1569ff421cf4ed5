"""Changed files: what a bad disk, a careless program or a hand does to a product, and how a stage reads it then."""

from __future__ import annotations

import hashlib
import os
import random
import resource
import shutil
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from bench import PRODUCTS, Bench, Job, files_of, wrong_end

SECONDS, MEMORY = 20, 2**31
HUGE = 2**42
WRONG, REFUSED, SAME = 1, 3, 0


def flip(data: bytearray, draw: random.Random) -> None:
    """Change one bit."""
    data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)


def flip_some(data: bytearray, draw: random.Random) -> None:
    """Change eight bytes."""
    for _ in range(8):
        data[draw.randrange(len(data))] = draw.randrange(256)


def cut(data: bytearray, draw: random.Random) -> None:
    """Leave out the end."""
    del data[draw.randrange(len(data)) :]


def zero(data: bytearray, draw: random.Random) -> None:
    """Clear a block of a disk."""
    at = draw.randrange(max(1, len(data) // 512)) * 512
    data[at : at + 512] = bytes(len(data[at : at + 512]))


def swap_blocks(data: bytearray, draw: random.Random) -> None:
    """Exchange two blocks of a disk."""
    a, b = (512 * draw.randrange(max(1, len(data) // 512 - 1)) for _ in range(2))
    data[a : a + 512], data[b : b + 512] = data[b : b + 512], data[a : a + 512]


def append(data: bytearray, draw: random.Random) -> None:
    """Add something behind the end."""
    data += draw.randbytes(draw.randrange(1, 2000))


RAW = (flip, flip, flip, flip_some, cut, zero, swap_blocks, append)


def datasets(file: h5py.File) -> list[str]:
    """Return the names of all datasets that lie in the file itself."""
    found: list[str] = []
    file.visititems(lambda name, item: found.append(name) if isinstance(item, h5py.Dataset) else None)
    return sorted(found)


def objects(file: h5py.File) -> list[str]:
    """Return the names of all groups and datasets."""
    found: list[str] = []
    file.visititems(lambda name, _: found.append(name))
    return sorted(found)


def rewritten(file: h5py.File, name: str, **how: Any) -> None:
    """Put another dataset in a dataset's place, its attributes kept."""
    kept = dict(file[name].attrs)
    del file[name]
    new = file.create_dataset(name, **how)
    for key, value in kept.items():
        new.attrs[key] = value


def swap(file: h5py.File, draw: random.Random) -> None:
    """Exchange the names of two datasets, their digests with them."""
    names = datasets(file)
    a = draw.choice(names)
    b = draw.choice([n for n in names if n != a and file[n].shape == file[a].shape] or names)
    if a != b:
        file.move(a, "aside")
        file.move(b, a)
        file.move("aside", b)


def value(file: h5py.File, draw: random.Random) -> None:
    """Change one value of a dataset."""
    data = file[draw.choice(datasets(file))]
    if data.dtype.kind == "S" or not data.size:
        return
    at = tuple(draw.randrange(n) for n in data.shape)
    data[at] = data[at] + 1 if data.dtype.kind in "iu" else -data[at] + 0.25


def value_without_digest(file: h5py.File, draw: random.Random) -> None:
    """Change a value, and take the digest away."""
    name = draw.choice(datasets(file))
    data = file[name]
    if data.dtype.kind == "S" or not data.size:
        return
    data[tuple(draw.randrange(n) for n in data.shape)] = draw.choice([0, 1, 2])
    if "sha256" in data.attrs:
        del data.attrs["sha256"]
    if f"ppmc/digests/{name}" in file:
        del file[f"ppmc/digests/{name}"]


def another_type(file: h5py.File, draw: random.Random) -> None:
    """Store the values of a dataset as another kind of number, text or record."""
    name = draw.choice(datasets(file))
    values = file[name][()]
    kind = draw.choice(["f2", "f4", "i4", "u1", "c8", "S8", "record", "vlen", "bool", ">f8"])
    if kind == "record":
        rewritten(file, name, data=np.zeros(np.shape(values), [("a", "f8"), ("b", "i4")]))
    elif kind == "vlen":
        rewritten(file, name, data=["a", "bc"], dtype=h5py.string_dtype())
    elif np.asarray(values).dtype.kind == "S":
        rewritten(file, name, data=np.zeros(3, kind))
    else:
        with np.errstate(all="ignore"):
            rewritten(file, name, data=np.asarray(values).astype(kind))


def another_shape(file: h5py.File, draw: random.Random) -> None:
    """Cut a dataset, lengthen it, turn it or flatten it."""
    name = draw.choice(datasets(file))
    values = np.asarray(file[name][()])
    shapes = (
        lambda v: v[:-1] if v.ndim else v,
        lambda v: np.concatenate([v, v[-1:]]) if v.ndim and len(v) else v[None],
        lambda v: v.T if v.ndim > 1 else v[..., None],
        np.ravel,
        lambda v: v[:0] if v.ndim else v,
        lambda v: np.broadcast_to(v, (2, *v.shape)),
    )
    rewritten(file, name, data=draw.choice(shapes)(values))


def huge(file: h5py.File, draw: random.Random) -> None:
    """Claim a size that no disk holds."""
    name = draw.choice(datasets(file))
    data = file[name]
    shape = (HUGE, *data.shape[1:]) if data.ndim else (HUGE,)
    rewritten(file, name, shape=shape, dtype=data.dtype, chunks=(1024, *data.shape[1:]))


def link(file: h5py.File, draw: random.Random) -> None:
    """Put a link in the place of a group or dataset."""
    names = objects(file)
    name, other = draw.choice(names), draw.choice(names)
    target: Any = draw.choice(
        [
            h5py.SoftLink(f"/{other}"),
            h5py.SoftLink(f"/{name}"),
            h5py.ExternalLink("other.h5", "/x"),
            h5py.ExternalLink("/etc/passwd", "/x"),
            file["/"],
            file[other],
        ]
    )
    del file[name]
    file[name] = target


def elsewhere(file: h5py.File, draw: random.Random) -> None:
    """Keep the data of a dataset in another file."""
    name = draw.choice(datasets(file))
    data = file[name]
    shape, kind = data.shape or (1,), data.dtype
    if draw.random() < 0.5:
        rewritten(file, name, shape=shape, dtype=kind, external=[("/etc/passwd", 0, 4096)])
    else:
        layout = h5py.VirtualLayout(shape, kind)
        layout[...] = h5py.VirtualSource(file.filename, "/VTKHDF/Points", shape=shape)
        kept = dict(data.attrs)
        del file[name]
        file.create_virtual_dataset(name, layout)
        file[name].attrs.update(kept)


def attribute(file: h5py.File, draw: random.Random) -> None:
    """Change, remove or add an attribute, or give it another type."""
    owners = [file[name] for name in objects(file) if len(file[name].attrs)]
    target = draw.choice(owners)
    key = draw.choice(sorted(target.attrs))
    old = target.attrs[key]
    way = draw.randrange(5)
    if way == 0:
        del target.attrs[key]
    elif way == 1:
        target.attrs[key] = draw.choice([np.arange(5.0), 3, np.nan, b"\xff\xfe\x00", "text", np.zeros((2, 2), "f4")])
    elif way == 2:
        target.attrs[draw.choice(["added", "sha256", "unit"])] = "added"
    elif isinstance(old, bytes | np.bytes_ | str):
        text = old.encode() if isinstance(old, str) else bytes(old)
        target.attrs[key] = np.bytes_(text[:-1] + b"x")
    else:
        target.attrs[key] = np.asarray(old) * 2 + 1


def remove(file: h5py.File, draw: random.Random) -> None:
    """Remove a group or dataset."""
    del file[draw.choice(objects(file))]


def add(file: h5py.File, draw: random.Random) -> None:
    """Add a group or dataset."""
    groups = [name for name in objects(file) if isinstance(file[name], h5py.Group)]
    parent = file[draw.choice([*groups, "/"])]
    if draw.random() < 0.5:
        parent.create_group("added")
    else:
        parent["added"] = np.arange(10.0)


def digest_cleared(file: h5py.File, draw: random.Random) -> None:
    """Take away what says how all names and attributes were."""
    if "ppmc" in file and "manifest" in file["ppmc"].attrs:
        del file["ppmc"].attrs["manifest"]


STRUCTURAL = (
    swap, swap, value, value_without_digest, another_type, another_shape, huge, link, elsewhere, attribute, attribute,
    remove, add, digest_cleared,
)  # fmt: skip


def change(path: Path, draw: random.Random) -> str:
    """Change a file in place; return how."""
    if draw.random() < 0.45:
        way = draw.choice(RAW)
        data = bytearray(path.read_bytes())
        way(data, draw)
        path.write_bytes(data)
        return way.__name__
    inner = draw.choice(STRUCTURAL)
    try:
        with h5py.File(path, "r+", locking=False) as file:
            inner(file, draw)
    except (KeyError, ValueError, TypeError, OSError, RuntimeError):
        return ""  # the library itself refuses to make this file
    return inner.__name__


def content_of(kind: str, path: Path) -> str:
    """Return a digest of all that the stages can read from a product."""
    from ppmc.files import open_series, read_particles, read_state, read_voxels

    read: list[Any] = []
    if kind in ("volume", "orientations"):
        with read_voxels(path, kind) as voxels:
            read = [voxels.names, voxels.grid, voxels.provenance, *(voxels.read(name) for name in voxels.names)]
    elif kind == "charge":
        charge = read_particles(path, kind)
        read = [charge.positions, charge.fields, charge.extra, charge.provenance]
    elif kind == "checkpoint":
        read = [*read_state(path)]
    else:
        product = kind if kind in ("flow", "analysis") else "flow"
        with open_series(path if kind == product else path.parent, product) as series:
            read = [series.names, series.static, series.scalars, series.history, series.extra, series.provenance]
            read += [series.times, *(series.frame(k) for k in range(len(series.times)))]
    digest = hashlib.sha256()
    _feed(digest, read)
    return digest.hexdigest()


def _feed(digest: Any, item: Any) -> None:
    if isinstance(item, np.ndarray):
        digest.update(f"{item.dtype} {item.shape}".encode() + np.ascontiguousarray(item).tobytes())
    elif isinstance(item, dict):
        for key in sorted(item):
            digest.update(str(key).encode())
            _feed(digest, item[key])
    elif isinstance(item, list | tuple):
        for part in item:
            _feed(digest, part)
    else:
        digest.update(repr(item).encode())


def in_child(work: Callable[[], int]) -> int:
    """Return what some work says in a process of its own, bounded in memory and time; minus a signal's number."""
    child = os.fork()
    if child == 0:
        code = WRONG
        try:
            resource.setrlimit(resource.RLIMIT_AS, (_size() + MEMORY, resource.RLIM_INFINITY))
            signal.alarm(SECONDS)
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _size() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def growing(bench: Bench) -> dict[str, Path]:
    """Return a checkpoint, and header and frame of a growing flow, as a run that stops leaves them."""
    run = bench.clear("solve")

    def stop() -> None:
        from ppmc.solver.run.simulation import Simulation

        real = Simulation._save

        def save(self: Simulation) -> None:
            real(self)
            if self.time > 0.03:
                os._exit(0)

        Simulation._save = save  # type: ignore[method-assign]

    bench.start("solve", prepare=stop).wait()
    kept = bench.folder / "stopped"
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(run, kept)
    partial = kept / "flow.partial"
    return {
        "checkpoint": kept / "flow.checkpoint-a.h5ckpt",
        "header": partial / "header.vtkhdf",
        "frame": partial / "frame_000001.vtkhdf",
    }


def changed_files(bench: Bench, kind: str, path: Path, tries: int, counted: Counter[str]) -> Iterator[str]:
    """Change a product in many ways and read it; yield what was wrong: it must be refused, or be as it was."""
    whole, truth = path.read_bytes(), content_of(kind, path)
    draw = random.Random(f"changes {kind}")
    told = bench.folder / "told"

    def read() -> int:
        from ppmc.errors import PpmcError

        try:
            return SAME if content_of(kind, path) == truth else WRONG
        except PpmcError:
            return REFUSED
        except BaseException as error:
            told.write_text(f"{type(error).__name__}: {error}"[:160])
            return WRONG

    done = 0
    while done < tries:
        path.write_bytes(whole)
        how = change(path, draw)
        if not how or path.read_bytes() == whole:
            continue
        done += 1
        told.write_text("accepted, and other")
        code = in_child(read)
        counted[{SAME: "the same", REFUSED: "refused"}.get(code, "wrong")] += 1
        if code not in (SAME, REFUSED):
            keep = bench.folder / f"wrong-{kind}-{done}"
            shutil.copy(path, keep)
        yield "" if code in (SAME, REFUSED) else f"{how}: {told.read_text() if code > 0 else f'signal {-code}'}"
    path.write_bytes(whole)


READERS = {
    "phantom": ("ct", "charge", "analyze"),
    "ct": ("charge", "analyze"),
    "charge": ("solve",),
    "solve": ("analyze",),
}


def through_commands(bench: Bench, tries: int) -> Iterator[str]:
    """Change an input of a stage and run the command; yield what was wrong: a refusal, or the right result."""
    draw = random.Random("commands")
    stopped = growing(bench)
    for k in range(tries):
        if k % 3 == 2:
            stage, kind = "solve", draw.choice(sorted(stopped))
            shutil.rmtree(bench.folder / "run")
            shutil.copytree(bench.folder / "stopped", bench.folder / "run")
            path = bench.folder / "run" / stopped[kind].relative_to(bench.folder / "stopped")
        else:
            maker = draw.choice(sorted(READERS))
            stage, kind = draw.choice(READERS[maker]), PRODUCTS[maker]
            path = bench.clear(stage) / f"{kind}.vtkhdf"
        how = change(path, draw)
        job = Job([*bench.arguments(stage)], bench.folder, prepare=lambda: signal.alarm(0))
        wrong = wrong_end(job.wait(), job.told, (0, 2, 3))
        product = f"{PRODUCTS[stage]}.vtkhdf"
        found = files_of(bench.folder / "run")
        if not wrong and job.code == 0 and found.get(product) != bench.whole[product]:
            # The input's own digest is part of what a product says of its origin.
            wrong = "" if same_values(bench, product) else "another result"
        yield f"{stage}, {kind}, {how}: {wrong}" if wrong else ""


def same_values(bench: Bench, product: str) -> bool:
    """Return whether two products hold the same fields, whatever they say of their inputs' bytes."""
    with h5py.File(bench.folder / "run" / product, "r") as a, h5py.File(bench.folder / "whole" / product, "r") as b:
        names = [name for name in datasets(b) if not name.startswith("ppmc/")]
        return all(name in a and np.array_equal(a[name][()], b[name][()], equal_nan=True) for name in names)
