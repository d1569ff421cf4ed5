"""Ways to change a file: what a bad disk, a careless program or a hand does to a product."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import h5py
import numpy as np

HUGE = 2**42


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
    """Remove a group or dataset, but for the one without which a file is another program's, and taken as such."""
    del file[draw.choice([name for name in objects(file) if name != "ppmc"])]


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
