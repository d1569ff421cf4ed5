"""The verdict of a run, as files keep it: each limit with the value found, and where it was found.

It lies among the facts of a flow history (``/ppmc/extra``, key ``verdict``). The stage that computes it decides on the
limits; this module only says how they are written, read and told.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ppmc.errors import InputFileError
from ppmc.files.guard import open_guarded
from ppmc.files.text import read_json

KEY = "verdict"
FORCE_ESTIMATE = "force_estimate"  # beside it, where a press force may be no more than an upper bound
BOUNDS = ("at most", "at least")


@dataclass(frozen=True)
class Finding:
    """One limit, and what a run made of it.

    Attributes
    ----------
    name : str
        What was measured, in words.
    value : float or None
        Worst value of the run; None where there was nothing to measure.
    limit : float
        Bound that the value had to keep.
    bound : str
        ``"at most"`` or ``"at least"``.
    unit : str
        Unit of value and limit, ``"1"`` for none.
    reason : str
        Why the limit is where it is.
    time : float or None
        When the value was found, s; None where it belongs to the whole run.
    tool : str or None
        The tool that it is about.
    particle : int or None
        Number of the particle in the charge.
    position : tuple of float or None
        Where that particle was then, x1, x2, x3, mm.
    """

    name: str
    value: float | None
    limit: float
    bound: str
    unit: str
    reason: str
    time: float | None = None
    tool: str | None = None
    particle: int | None = None
    position: tuple[float, float, float] | None = None

    @property
    def kept(self) -> bool:
        """Whether the limit was kept; a value that was never measured breaks none."""
        if self.value is None:
            return True
        return self.value <= self.limit if self.bound == "at most" else self.value >= self.limit

    @property
    def place(self) -> str:
        """Where and when, in words; empty if that is not known."""
        parts = [] if self.tool is None else [f"tool '{self.tool}'"]
        parts += [] if self.time is None else [f"t = {self.time:.6g} s"]
        if self.particle is not None:
            parts.append(f"particle {self.particle}")
        if self.position is not None:
            parts.append("({}) mm".format(", ".join(f"{x:.4g}" for x in self.position)))
        return ", ".join(parts)

    def told(self) -> str:
        """Return the finding as one line."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        value = "not measured" if self.value is None else f"{self.value:.4g}{unit}"
        place = f"; {self.place}" if self.place else ""
        return f"{self.name}: {value}, {self.bound} {self.limit:.4g}{unit}{place}"


@dataclass(frozen=True)
class Verdict:
    """All limits of a run.

    Attributes
    ----------
    findings : tuple of Finding
    """

    findings: tuple[Finding, ...]

    @property
    def broken(self) -> tuple[Finding, ...]:
        """The limits that were not kept."""
        return tuple(finding for finding in self.findings if not finding.kept)

    @property
    def passed(self) -> bool:
        """Whether all were."""
        return not self.broken

    @property
    def headline(self) -> str:
        """The verdict in one line."""
        if self.passed:
            return f"passed: all {len(self.findings)} limits kept"
        return f"NOT PASSED: {len(self.broken)} of {len(self.findings)} limits not kept"

    def lines(self) -> list[str]:
        """Return the headline, and a line for each limit that was not kept."""
        return [self.headline, *(f"  {finding.told()}" for finding in self.broken)]

    def as_facts(self) -> dict[str, Any]:
        """Return the verdict as JSON can hold it."""
        return {"passed": self.passed, "findings": [asdict(finding) for finding in self.findings]}


def read_verdict(extra: Mapping[str, Any], path: Path) -> Verdict | None:
    """Return the verdict among the facts of a file, None if it has none.

    Raises
    ------
    InputFileError
        If it is not what :meth:`Verdict.as_facts` gives.
    """
    facts = extra.get(KEY)
    if facts is None:
        return None
    try:
        findings = tuple(_finding(item) for item in facts["findings"])
    except (LookupError, TypeError, ValueError) as error:
        raise InputFileError(f"{path}: /ppmc/extra holds a verdict that cannot be read ({error})") from None
    return Verdict(findings)


def verdict_of(path: Path) -> Verdict | None:
    """Return the verdict of a flow history, None if it has none: it is still growing, or of an older version.

    Raises
    ------
    InputFileError
        If the file is missing, damaged or no flow history.
    """
    with open_guarded(path, "flow") as file:
        return read_verdict(read_json(file["ppmc"], "extra"), path)


def _finding(item: Mapping[str, Any]) -> Finding:
    """Return a finding from its facts."""
    numbers: dict[str, float | None] = {}
    for name in ("value", "time"):
        numbers[name] = None if item[name] is None else float(item[name])
    position = item["position"]
    if item["bound"] not in BOUNDS or not math.isfinite(float(item["limit"])):
        raise ValueError(f"'{item['name']}' is {item['bound']} {item['limit']}")
    return Finding(
        name=str(item["name"]),
        value=numbers["value"],
        limit=float(item["limit"]),
        bound=str(item["bound"]),
        unit=str(item["unit"]),
        reason=str(item["reason"]),
        time=numbers["time"],
        tool=None if item["tool"] is None else str(item["tool"]),
        particle=None if item["particle"] is None else int(item["particle"]),
        position=None if position is None else (float(position[0]), float(position[1]), float(position[2])),
    )
