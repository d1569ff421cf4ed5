"""How a charge's volume compares to that of the cavity that the tools leave at the end."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import NDArray

from ppmc.errors import SceneError
from ppmc.geometry.cavity import cavity_volume
from ppmc.geometry.toolset import ToolSet

# The cavity is looked for from so many points of the charge.
MOST_SEEDS = 2000
# A charge and a closed cavity that differ by less are equal.
BALANCE = 0.005


@dataclass(frozen=True)
class ChargeBalance:
    """Volume of a charge against that of the closed cavity.

    Attributes
    ----------
    share : float or None
        Charge over cavity; None where there is no closed cavity to compare with.
    told : str
        The same in words, with what to do about it.
    """

    share: float | None
    told: str

    @property
    def off(self) -> bool:
        """Whether charge and cavity are known to differ."""
        return self.share is not None and abs(self.share - 1.0) > BALANCE


def charge_balance(tools: ToolSet, points: NDArray, end_time: float, volume: float) -> ChargeBalance:
    """Compare a charge with the cavity at the end.

    Parameters
    ----------
    tools : ToolSet
    points : ndarray, shape (n, 3)
        Places in the charge, mm.
    end_time : float
        s.
    volume : float
        Of the charge, mm^3.
    """
    if tools.motions.forced:
        return ChargeBalance(None, "tools under force: how far they close is not known beforehand")
    try:
        cavity = cavity_volume(tools, points[:: max(1, len(points) // MOST_SEEDS)], end_time)
    except SceneError:
        told = f"no place of the charge is left free at {end_time:.4g} s: its volume balance is not known"
        return ChargeBalance(None, told)
    if not cavity.closed:
        return ChargeBalance(None, f"at {end_time:.4g} s the tools leave the cavity open: the charge has free sides")
    share = volume / cavity.volume
    told = f"at {end_time:.4g} s the charge takes {share:.2%} of the closed cavity of {cavity.volume:.6g} mm^3"
    if share > 1.0 + BALANCE:
        told += ": too much, so that tools cannot close that far; take a smaller charge or less travel"
    elif share < 1.0 - BALANCE:
        told += ": a short shot"
    return ChargeBalance(share, told)
