"""How a charge's volume compares to that of the cavity that the tools leave where they have come closest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import SceneError
from ppmc.geometry.cavity.cavity import Cavity, cavity_volume
from ppmc.geometry.tools.overlaps import Overlap, overlaps
from ppmc.geometry.tools.toolset import ToolSet

FloatArray = NDArray[np.float64]

# The cavity is looked for from so many points of the charge.
MOST_SEEDS = 2000
# A charge and a closed cavity that differ by less are equal; beyond the second a charge has no room.
BALANCE, OVERFULL = 0.005, 1.05


@dataclass(frozen=True)
class ChargeBalance:
    """Volume of a charge against that of the closed cavity.

    Attributes
    ----------
    share : float or None
        Charge over cavity; None where there is no closed cavity to compare with.
    told : str
        The same in words, with what to do about it.
    forced : bool
        Whether the cavity is that at the stops of tools under force, which need not get there.
    """

    share: float | None
    told: str
    forced: bool = False

    @property
    def off(self) -> bool:
        """Whether charge and cavity are known to differ."""
        return self.share is not None and abs(self.share - 1.0) > BALANCE

    def check_room(self, bulk_modulus: float | None, source: str) -> None:
        """Refuse a charge that is far too large for the closed cavity and not said to be compressible.

        Parameters
        ----------
        bulk_modulus : float or None
            What the scene gives as ``solver.bulk_modulus``.
        source : str
            File or section to name.

        Raises
        ------
        SceneError
        """
        if (self.share or 0.0) > OVERFULL and bulk_modulus is None and not self.forced:
            raise SceneError(f"{source}: {self.told}, or give solver.bulk_modulus if it can be compressed")


def charge_balance(tools: ToolSet, points: NDArray, end_time: float, volume: float, spacing: float) -> ChargeBalance:
    """Compare a charge with the closed cavity, at the time when tools that move have come farthest.

    Parameters
    ----------
    tools : ToolSet
    points : ndarray, shape (n, 3)
        Places in the charge, mm.
    end_time : float
        s.
    volume : float
        Of the charge, mm^3.
    spacing : float
        Of its particles, mm: clearances below it are closed.

    Raises
    ------
    SceneError
        If tools that move against one another overlap at the edge of the cavity.
    """
    forced = tools.motions.forced
    if any(not np.isfinite(f.travel) for f in forced):
        return ChargeBalance(None, "tools under force: how far they close is not known beforehand")
    seeds = points[:: max(1, len(points) // MOST_SEEDS)]
    stops = np.zeros((len(tools), 3))
    for f in forced:
        stops[f.tool] = f.travel * f.direction
    found: list[tuple[float, FloatArray, Cavity]] = []
    told, resting = "", ""
    for time in closest_times(tools, end_time):
        offsets = tools.offsets(time) + stops
        try:
            cavity = _cavity(tools, seeds, time, offsets, spacing)
        except SceneError:
            told = f"no place of the charge is left free at {time:.4g} s: its volume balance is not known"
            continue
        for overlap in overlaps(tools, cavity.rim, spacing, offsets, offsets - tools.offsets(0.0)):
            if overlap.apart:
                raise SceneError(_told_overlap(overlap, time))
            resting = "; " + _told_overlap(overlap, time).removeprefix("tooling: ")
        if not cavity.closed:
            told = f"at {time:.4g} s the tools leave the cavity open: the charge has free sides"
            continue
        found.append((time, offsets, cavity))
    if not found:
        return ChargeBalance(None, told + resting)
    time, offsets, cavity = min(found, key=lambda f: f[2].volume)
    share = volume / cavity.volume
    where = f"at {time:.4g} s" if not forced else "with the tools under force at their stops"
    told = f"{where} the charge takes {share:.2%} of the closed cavity of {cavity.volume:.6g} mm^3"
    if not 0.9 * spacing < cavity.clearance < 1.1 * spacing:
        told += f" (clearances below {cavity.clearance:.3g} mm closed)"
    if share > 1.0 + BALANCE:
        told += ": too much, so that tools cannot close that far; "
        told += f"take a charge smaller by {volume - cavity.volume:.4g} mm^3 or less travel"
        less = _travel_to_spare(tools, seeds, time, offsets, spacing, volume, cavity.volume)
        told += f" (by about {less:.3g} mm)" if less else ""
    elif share < 1.0 - BALANCE:
        told += ": a short shot"
    return ChargeBalance(share, told + resting, bool(forced))


def closest_times(tools: ToolSet, end_time: float) -> list[float]:
    """Return the times, s, ascending, when each tool is farthest from where it began, and the end; each place once."""
    times = [0.0, end_time]
    while (later := tools.next_break(times[-2])) < end_time:
        times.insert(-1, later)
    paths = np.array([tools.offsets(t) for t in times])
    far = np.linalg.norm(paths - paths[0], axis=2)
    chosen = {len(times) - 1}
    for t in range(len(tools)):
        # The last of several equal ones: a tool that holds there is farthest until it leaves.
        most = far[:, t].max()
        if most > 0.0:
            chosen.add(int(np.flatnonzero(far[:, t] >= most * (1.0 - 1e-9))[-1]))
    kept: list[int] = []
    for k in sorted(chosen, reverse=True):
        if not any(np.allclose(paths[k], paths[m], atol=1e-9) for m in kept):
            kept.append(k)
    return [times[k] for k in reversed(kept)]


def _cavity(tools: ToolSet, seeds: FloatArray, time: float, offsets: FloatArray, spacing: float) -> Cavity:
    """Return the cavity about the charge, or about where a tool has carried it if nothing there is free any more."""
    carried = [offset for offset in offsets - tools.offsets(0.0) if np.any(offset)]
    for way in (np.zeros(3), *carried):
        try:
            return cavity_volume(tools, seeds + way, time, spacing=spacing, offsets=offsets)
        except SceneError as error:
            refused = error
    raise refused


def _travel_to_spare(
    tools: ToolSet, seeds: FloatArray, time: float, offsets: FloatArray, spacing: float, volume: float, least: float
) -> float:
    """Return about how much less way, mm, leaves the charge room; 0 if it is not known."""
    way = float(np.linalg.norm(offsets, axis=1).max())
    if way == 0.0:
        return 0.0
    back = min(spacing, 0.5 * way)
    try:
        wider = _cavity(tools, seeds, time, offsets * (1.0 - back / way), spacing)
    except SceneError:
        return 0.0
    gained = wider.volume - least
    return (volume - least) * back / gained if wider.closed and gained > 0.0 else 0.0


def _told_overlap(overlap: Overlap, time: float) -> str:
    """Return what to say of tools that overlap."""
    where = ", ".join(f"{v:.4g}" for v in overlap.point)
    fix = (
        "shorten `travel`, the table or `solver.end_time`" if overlap.closing else "make one of them smaller or move it"
    )
    if not overlap.apart:
        fix = "fine if the one is set into the other"
    return (
        f"tooling: '{overlap.first}' and '{overlap.second}' overlap by {overlap.depth:.4g} mm at t = {time:.4g} s "
        f"near ({where}) mm; {fix}"
    )
