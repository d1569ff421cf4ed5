"""Where a chain keeps its files, when nobody says otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ppmc.scene.scene import Scene


@dataclass(frozen=True)
class RunPaths:
    """Files of one run, all in one folder.

    Attributes
    ----------
    directory : Path
        The folder, ``runs/<scene name>`` by default.
    """

    directory: Path

    @property
    def volume(self) -> Path:
        """Voxel volume made by the phantom."""
        return self.directory / "volume.vtkhdf"

    @property
    def orientations(self) -> Path:
        """Voxel orientations made by ``ppmc ct``."""
        return self.directory / "orientations.vtkhdf"

    @property
    def charge(self) -> Path:
        """Particles made by ``ppmc charge``."""
        return self.directory / "charge.vtkhdf"

    @property
    def flow(self) -> Path:
        """Flow history made by ``ppmc solve``."""
        return self.directory / "flow.vtkhdf"

    @property
    def analysis(self) -> Path:
        """Tensors of regions and paths made by ``ppmc analyze``."""
        return self.directory / "analysis.vtkhdf"


def run_paths(scene: Scene, workdir: Path | None = None) -> RunPaths:
    """Return the default files of a scene's run, in `workdir` or ``runs/<scene name>``."""
    return RunPaths(Path(workdir) if workdir is not None else Path("runs") / scene.name)
