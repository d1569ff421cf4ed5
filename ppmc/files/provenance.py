"""Where a file comes from: version, scene, inputs and seed, stored inside the file itself."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py

from ppmc import __version__
from ppmc.errors import InputFileError
from ppmc.files.fields import AXES, MADE_BY, SCHEMA_VERSION, UNITS
from ppmc.files.references import referenced_files
from ppmc.files.text import attribute, put_attribute, put_json, read_json

if TYPE_CHECKING:
    from ppmc.scene import Scene
    from ppmc.scene.depends import Depends

PACKAGES = ("numpy", "numba", "scipy", "h5py")
READ_BYTES = 2**22


def file_digest(path: Path) -> str:
    """Return the SHA-256 of all that is read when a file is read.

    That is its bytes; of a folder, the names and bytes of all files in it, in the order of their names; and in both
    cases the files that a file refers to: included ones, and those in which HDF5 keeps data.
    """
    digest = hashlib.sha256()
    path = Path(path)
    parts = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    for part in parts:
        if path.is_dir():
            digest.update(f"{part.relative_to(path).as_posix()} {part.stat().st_size}\n".encode())
        for read in (part, *referenced_files(part)):
            with read.open("rb") as handle:
                while block := handle.read(READ_BYTES):
                    digest.update(block)
    return digest.hexdigest()


def _digests(paths: Iterable[Path]) -> dict[str, str]:
    """Return the digest of each file by name; files of one name are told apart by their folder, then by a number."""
    found: dict[str, str] = {}
    for path in paths:
        name, k = path.name, 2
        if name in found:
            name = f"{path.absolute().parent.name}/{path.name}"
        while name in found:
            name, k = f"{path.absolute().parent.name}/{path.name} ({k})", k + 1
        found[name] = file_digest(path)
    return found


def _packages() -> dict[str, str]:
    """Return the versions of the packages that results can depend on."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


@dataclass(frozen=True)
class Provenance:
    """The origin of one file.

    Attributes
    ----------
    creator : str
        What wrote it, such as ``"ppmc.ct"``.
    scene : dict
        The resolved scene, defaults written out.
    inputs : dict
        SHA-256 of each input by file name; files of one name have their folder before it.
    seed : int or None
        Seed of the random draws, None where there were none.
    key : str
        Digest of all that decides the content: the sections used, the inputs, the seed and the version. Equal keys
        mean equal files. No date and no machine name is kept, so that equal work gives equal bytes.
    """

    creator: str
    scene: dict[str, Any] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    seed: int | None = None
    key: str = ""
    ppmc_version: str = __version__
    packages: dict[str, str] = field(default_factory=dict)

    @classmethod
    def collect(
        cls,
        creator: str,
        scene: Scene | None = None,
        sections: Iterable[str] = (),
        inputs: Iterable[Path | None] = (),
        seed: int | None = None,
        made_here: Mapping[str, str] | None = None,
    ) -> Provenance:
        """Gather the origin of a file about to be written.

        Parameters
        ----------
        creator : str
            The stage, such as ``"ppmc.ct"``.
        scene : Scene, optional
            Stored whole.
        sections : iterable of str
            The sections that decide this file's content.
        inputs : iterable of Path
            Files read; None entries are passed over.
        seed : int, optional
            Seed, for stages that draw random numbers.
        made_here : mapping of str to str, optional
            Digests by name of inputs that no file holds.
        """
        resolved = scene.resolved() if scene is not None else {}
        digests = _digests([Path(p) for p in inputs if p is not None]) | dict(made_here or {})
        decides = {
            "creator": creator,
            "version": __version__,
            "sections": {s: resolved.get(s) for s in sections},
            "inputs": digests,
            "seed": seed,
        }
        key = hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()
        return cls(creator, resolved, digests, seed, key, __version__, _packages())

    @classmethod
    def of(cls, scene: Scene, depends: Depends, made_here: Mapping[str, str] | None = None) -> Provenance:
        """Gather the origin of a file from what the scene says it depends on; `made_here` as in `collect`."""
        return cls.collect(depends.creator, scene, depends.sections, depends.inputs, depends.seed, made_here)

    def store(self, file: h5py.File, product: str) -> None:
        """Write the origin and the contract's name and version into the group ``/ppmc``."""
        group = file.require_group("ppmc")
        put_attribute(group, "schema", product)
        group.attrs["schema_version"] = SCHEMA_VERSION
        put_attribute(group, "ppmc_version", self.ppmc_version)
        put_attribute(group, "creator", self.creator)
        put_attribute(group, "made_by", MADE_BY.get(product, self.creator))
        put_attribute(group, "units", UNITS)
        put_attribute(group, "axes", AXES)
        put_attribute(group, "key", self.key)
        put_attribute(group, "seed", "none" if self.seed is None else str(self.seed))
        # Datasets, since attributes end at 64 KiB.
        put_json(group, "scene", self.scene)
        put_json(group, "inputs", self.inputs)
        put_json(group, "packages", self.packages)

    @classmethod
    def load(cls, file: h5py.File) -> Provenance:
        """Read the origin back; a file that another program wrote has an empty one."""
        if "ppmc" not in file:
            return cls(creator="unknown", ppmc_version="unknown")
        group = file["ppmc"]

        seed = attribute(group, "seed", "none")
        if seed != "none" and not re.fullmatch(r"-?\d{1,40}", seed):
            raise InputFileError(f"{file.filename}: /ppmc@seed is '{seed[:40]}', must be a number or 'none'")
        return cls(
            creator=attribute(group, "creator", "unknown"),
            scene=read_json(group, "scene"),
            inputs=read_json(group, "inputs"),
            seed=None if seed == "none" else int(seed),
            key=attribute(group, "key"),
            ppmc_version=attribute(group, "ppmc_version", "unknown"),
            packages=read_json(group, "packages"),
        )
