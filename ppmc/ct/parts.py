"""Finished tiles kept in a folder, so that work can be resumed or shared out to several machines."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ppmc.ct.block import Box
from ppmc.ct.tiles import Tiling
from ppmc.errors import InputFileError
from ppmc.files import Provenance, read_state, write_state

Fields = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Parts:
    """Tiles of one piece of work, one sealed file each; tiles of other work are not taken for them.

    Attributes
    ----------
    folder : Path
        Where the files are.
    provenance : Provenance
        The work: scene, volume and version.
    tiles : Tiling
        How the volume is cut.
    """

    folder: Path
    provenance: Provenance
    tiles: Tiling

    def keep(self, fields: Fields, box: Box) -> None:
        """Write a tile; it is there whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        attributes = {"key": self.provenance.key, "box": [list(r) for r in box]}
        write_state(self._path(box), fields, attributes, provenance=self.provenance)

    def missing(self, boxes: list[Box]) -> list[Box]:
        """Return the tiles that are not there yet, or are of other work, or damaged."""
        return [box for box in boxes if not self._is_sound(box)]

    def read(self, box: Box) -> Fields:
        """Return the fields of a tile.

        Raises
        ------
        InputFileError
            If it is missing or damaged.
        """
        fields, _, _ = read_state(self._path(box))
        return fields

    def remove(self) -> None:
        """Delete all tiles of the work, and the folder if nothing else is in it."""
        for box in self.tiles.boxes():
            self._path(box).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _path(self, box: Box) -> Path:
        return self.folder / ("-".join(f"{a}to{b}" for a, b in box) + ".h5ckpt")

    def _is_sound(self, box: Box) -> bool:
        try:
            _, attributes, _ = read_state(self._path(box))
        except InputFileError:
            return False
        return bool(attributes.get("key") == self.provenance.key)
