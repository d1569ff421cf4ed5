"""What an analysis found, before it is written down: plain results that tables, figures and report are made from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ppmc.analysis.averages.averages import RegionAverages, in_frames
from ppmc.analysis.averages.paths import InspectionPath
from ppmc.analysis.averages.regions import Region
from ppmc.analysis.averages.sources import Source
from ppmc.analysis.flow.comparisons import Comparison
from ppmc.analysis.flow.ensemble import Ensemble
from ppmc.analysis.flow.kinematics import Kinematics
from ppmc.analysis.flow.knit import KnitLine
from ppmc.analysis.flow.truth import AngleErrors, TruthRow
from ppmc.particles import Particles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ppmc.files.verdict import Verdict


@dataclass(frozen=True)
class Analysed:
    """One source averaged over all regions and paths.

    Attributes
    ----------
    source : Source
    regions : RegionAverages
        Over the regions, the whole first, in tool coordinates.
    paths : tuple of RegionAverages
        Over each path's regions, in tool coordinates.
    """

    source: Source
    regions: RegionAverages
    paths: tuple[RegionAverages, ...]


@dataclass(frozen=True)
class TruthComparison:
    """The chain beside the phantom's truth.

    Attributes
    ----------
    region : Region
        The interior that was compared.
    margin : float
        Distance kept from the specimen's faces, mm.
    rows : list of TruthRow
        The truth first.
    fibre_errors, normal_errors : AngleErrors
        Of CT voxels against the phantom's nearest voxel.
    """

    region: Region
    margin: float
    rows: list[TruthRow]
    fibre_errors: AngleErrors
    normal_errors: AngleErrors


@dataclass(frozen=True)
class PressForce:
    """Forces in time.

    Attributes
    ----------
    time : ndarray, shape (n,)
        s.
    forces : dict of str to ndarray, shape (n,)
        Magnitude on each tool, µN.
    origin : str
        Whether from every step or from the frames.
    bound : str
        Why it is no more than an upper bound, empty where it is more.
    """

    time: np.ndarray
    forces: dict[str, np.ndarray]
    origin: str
    bound: str = ""


@dataclass(frozen=True)
class FlowMaps:
    """What is known at each particle of a flow's last frame.

    Attributes
    ----------
    samples : Particles
        The last frame with all its fields.
    spacing : float
        Distance of neighbours at the start, mm.
    fill_time : ndarray, shape (n,), or None
        Time at which each particle's place was first reached, s; None with one frame only.
    knit : KnitLine
        Particles at knit lines.
    """

    samples: Particles
    spacing: float
    fill_time: np.ndarray | None
    knit: KnitLine


@dataclass
class Results:
    """Everything that one analysis found."""

    regions: tuple[Region, ...]
    paths: tuple[InspectionPath, ...]
    analysed: list[Analysed]
    main: str
    kinematics: list[Kinematics] = field(default_factory=list)
    truth: TruthComparison | None = None
    press_force: PressForce | None = None
    flow_maps: FlowMaps | None = None
    seeds: Ensemble | None = None
    path_seeds: tuple[Ensemble, ...] = ()
    comparisons: list[Comparison] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    verdict: Verdict | None = None

    def path_averages(self, entry: Analysed, k: int) -> RegionAverages:
        """Return a source's averages along path `k` in the path's own components."""
        return in_frames(entry.paths[k], self.paths[k].frames)

    @property
    def frames(self) -> list[Analysed]:
        """The analysed frames of the main input, in time."""
        return [entry for entry in self.analysed if entry.source.product == self.main]

    @property
    def others(self) -> list[Analysed]:
        """Other runs and the measured part, which the input's last frame is compared with."""
        return [entry for entry in self.analysed if entry.source.product in ("run", "moulded")]

    @property
    def shown(self) -> list[Analysed]:
        """What path plots and views show: every source once, of the frames the first and the last."""
        frames = self.frames
        ends = {id(entry) for entry in (frames[0], frames[-1])} if frames else set()
        return [entry for entry in self.analysed if entry.source.product != self.main or id(entry) in ends]


def press_force(history: dict[str, np.ndarray], times: np.ndarray, scalars: dict[str, np.ndarray]) -> PressForce | None:
    """Find the press force in a flow's histories: on each tool at every step, else the total at each frame.

    Parameters
    ----------
    history : dict of str to ndarray, shape (steps,)
        Columns ``time`` and ``force_<tool>_x``, ``_y``, ``_z`` (µN).
    times : ndarray, shape (frames,)
        s.
    scalars : dict of str to ndarray, shape (frames,)
        ``press_force`` (µN) if the solver wrote it.
    """
    tools = sorted(
        {name[len("force_") : -2] for name in history if name.startswith("force_") and name[-2:] in ("_x", "_y", "_z")}
    )
    if "time" in history and tools and len(history["time"]):
        parts = {tool: [history.get(f"force_{tool}_{axis}", np.zeros(1)) for axis in "xyz"] for tool in tools}
        forces = {tool: np.sqrt(np.square(x) + np.square(y) + np.square(z)) for tool, (x, y, z) in parts.items()}
        return PressForce(history["time"], forces, "every step")
    for source, time, origin in ((history, history.get("time"), "every step"), (scalars, times, "every frame")):
        if time is not None and "press_force" in source and len(time):
            return PressForce(np.asarray(time), {"press": source["press_force"]}, origin)
    return None


def scalar_series(entries: Sequence[Analysed], region: int, tensor: str) -> np.ndarray:
    """Return the diagonal of a tensor of one region over the entries, shape (len(entries), 3)."""
    return np.array([np.diagonal(getattr(entry.regions, tensor)[region]) for entry in entries]).reshape(-1, 3)
