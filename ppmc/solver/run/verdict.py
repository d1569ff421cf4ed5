"""The verdict: what a run must have kept for its result to mean something, as a function of its table of steps.

Each limit has a value of the table, its worst step, a reason, and where there is one a particle. What a limit asks is
not that a step went well but that the answer can be believed: whether the charge kept its volume and its place between
the tools, and whether tools did the work. Nothing here looks at a state, so that a run that was killed and went on says
the same, and anyone can judge a file again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ppmc.files.verdict import Finding, Verdict
from ppmc.solver.run.coverage import LET_GO, Coverage, least_force
from ppmc.solver.step.model import Place

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Limits:
    """Bounds that a run must keep; each has its reason in :data:`REASONS`."""

    mean_volume_error: float = 0.01
    largest_volume_error: float = 0.1
    packing_low: float = 0.9
    packing_high: float = 1.1
    packing_worst: float = 0.3
    unconverged: float = 0.0
    penetration: float = 0.02
    coverage: float = 0.5
    force_balance: float = 0.2
    driven_share: float = 0.5
    zero_energy_share: float = 0.5
    outside: float = 0.0


REASONS = {
    "mean_volume_error": "one per cent, what K = 33 eta11 x closing rate leaves of the pressure (A5, theory)",
    "largest_volume_error": "a tenth: ten times what the mean may be; the pressure there is as far off",
    "packing_low": "errors of a tenth are more than the correction of packing still counts",
    "packing_high": "errors of a tenth are more than the correction of packing still counts",
    "packing_worst": "a plane free surface reads .71: farther off inside, and there is a hole, or as much too much",
    "unconverged": "a solve that gave up has velocities and touching faces of unknown error",
    "penetration": "two per cent of a spacing: four of a wall layer's half-width, and so of its share of the volume",
    "coverage": "a charge that is pressed spreads: where half of what covered a closing tool has left it, it tips over",
    "force_balance": "nothing but tools acts on the charge: where a fifth of their force is not balanced, it is noise",
    "driven_share": "less than half: the correction of packing and stored pressure move the charge, not the tools",
    "zero_energy_share": "half: particles would resist by what velocity gradients do not see as much as by viscosity",
    "outside": "a centre in a tool, or without three neighbours: nothing that it carries means anything",
}  # fmt: skip
LIMITS = Limits()


def judge(
    history: Columns, tools: Sequence[str], spacing: float, bulk_modulus: float, limits: Limits = LIMITS
) -> Verdict:  # fmt: skip
    """Judge a run.

    Parameters
    ----------
    history : mapping of str to ndarray, shape (steps,)
        Columns of the table of steps, see :class:`ppmc.solver.run.history.History`.
    tools : sequence of str
        Names of the tools, in the order of the scene.
    spacing : float
        Mean distance of particles at the start, mm.
    bulk_modulus : float
        K, Pa.
    limits : Limits

    Returns
    -------
    Verdict
        A finding for each limit, in the order of :class:`Limits`.
    """
    h, force = history, least_force(bulk_modulus, spacing)
    deviation = np.abs(h["packing_worst"] - 1.0)
    findings = [
        _worst(h, "mean_volume_error", "mean |J - 1|", h["mean_volume_ratio_error"], limits),
        _worst(h, "largest_volume_error", "largest |J - 1|", h["max_volume_ratio_error"], limits, at="volume_ratio"),
        _worst(h, "packing_low", "packing inside, 5 %", h["packing_low"], limits, least=True),
        _worst(h, "packing_high", "packing inside, 95 %", h["packing_high"], limits),
        _worst(h, "packing_worst", "packing inside, farthest from 1", deviation, limits, at="packing"),
        _unconverged(h, limits),
        _worst(
            h, "penetration", "penetration", h["penetration"] / spacing, limits, at="penetration", unit="spacings"
        ),
        _covered(h, tools, force, limits),
        _balanced(h, tools, force, limits),
        _driven(h, force * spacing, limits),
        _zero_energy(h, force * spacing, limits),
        _worst(h, "outside", "particles outside", h["outside"], limits, at="outside"),
    ]  # fmt: skip
    return Verdict(tuple(findings))


def coverage(history: Columns, tools: Sequence[str], force: float) -> np.ndarray:
    """Share of its most cover that each tool has after each step, shape (steps, tools); NaN where it is not judged.

    A tool counts where it closes on the charge and has borne more than `force`, Pa mm^2; see
    :mod:`ppmc.solver.run.coverage`.
    """
    return follow(history, tools, force)[1]


def follow(history: Columns, tools: Sequence[str], force: float) -> tuple[Coverage, np.ndarray]:
    """Return the record of what has covered each tool, after all steps, and :func:`coverage`."""
    n = len(history["time"])
    cover = np.array([history[f"cover_{tool}"] for tool in tools]).reshape(len(tools), n).T
    closing = np.array([history[f"closing_{tool}"] for tool in tools]).reshape(len(tools), n).T
    record, out = Coverage(len(tools), force), np.full((n, len(tools)), np.nan)
    durations = np.diff(history["time"], prepend=0.0)
    for k in range(n):
        record.add(float(history["time"][k]), cover[k], forces(history, tools, k), closing[k], float(durations[k]))
        out[k] = record.share(cover[k], closing[k])
    return record, out


def forces(history: Columns, tools: Sequence[str], step: int) -> np.ndarray:
    """Forces on the tools in a step, shape (tools, 3), Pa mm^2."""
    return np.array([[history[f"force_{tool}_{axis}"][step] for axis in "xyz"] for tool in tools]).reshape(-1, 3)


def _finding(
    name: str, told: str, value: float | None, limits: Limits, *, least: bool = False, unit: str = "1",
    time: float | None = None, tool: str | None = None, particle: int | None = None,
    position: tuple[float, float, float] | None = None,
) -> Finding:  # fmt: skip
    bound = "at least" if least else "at most"
    return Finding(told, value, getattr(limits, name), bound, unit, REASONS[name], time, tool, particle, position)


def _worst(
    h: Columns, name: str, told: str, values: np.ndarray, limits: Limits, *, at: str = "", least: bool = False,
    unit: str = "1",
) -> Finding:  # fmt: skip
    """Return the finding of the worst step of a column, with its place if it has one."""
    known = np.flatnonzero(~np.isnan(values))
    if len(known) == 0:
        return _finding(name, told, None, limits, least=least, unit=unit)
    step = int(known[np.argmin(values[known]) if least else np.argmax(values[known])])
    value = float(values[step])
    # Nothing went wrong nowhere.
    if value == 0.0 and not least:
        return _finding(name, told, value, limits, unit=unit)
    particle, position = _place(h, at, step) if at else (None, None)
    return _finding(
        name, told, value, limits, least=least, unit=unit, time=float(h["time"][step]), particle=particle,
        position=position,
    )  # fmt: skip


def _place(h: Columns, at: str, step: int) -> tuple[int | None, tuple[float, float, float] | None]:
    particle = int(h[f"{at}_particle"][step])
    if particle < 0:
        return None, None
    x1, x2, x3 = (float(h[f"{at}_x{axis}"][step]) for axis in (1, 2, 3))
    return particle, (x1, x2, x3)


def _unconverged(h: Columns, limits: Limits) -> Finding:
    """Return how many solves gave up, and when the first did."""
    failed = np.flatnonzero(h["unconverged"] > 0.0)
    time = float(h["time"][failed[0]]) if len(failed) else None
    return _finding("unconverged", "unconverged solves", float(h["unconverged"].sum()), limits, time=time)


def _driven(h: Columns, least_work: float, limits: Limits) -> Finding:
    """Return the share of the whole run's strain that tools and inertia drive, and the step that spoilt it most.

    The strain of a step goes with the root of what it dissipates; a step's own share says little where next to nothing
    flows, as while tools rest, and its share of the work hides a charge that collapses at no resistance.
    """
    work = _work(h, least_work)
    durations = np.diff(h["time"], prepend=0.0)
    return _share(h, "driven_share", "flow driven by tools", np.sqrt(work * durations), limits, least=True)


def _zero_energy(h: Columns, least_work: float, limits: Limits) -> Finding:
    """Return the share of the whole run's work that zero-energy control took, and the step in which it took most."""
    return _share(h, "zero_energy_share", "work of zero-energy control", _work(h, least_work), limits)


def _work(h: Columns, least_work: float) -> np.ndarray:
    """Work dissipated in each step, shape (steps,), uN mm; none if all of it is not more than round-off."""
    work = np.maximum(h["dissipation"], 0.0) * np.diff(h["time"], prepend=0.0)
    return work if float(work.sum()) > least_work else np.zeros_like(work)


def _share(
    h: Columns, name: str, told: str, weights: np.ndarray, limits: Limits, *, least: bool = False
) -> Finding:  # fmt: skip
    """Return the mean of a column of shares, and the step that counts most towards what it should not be."""
    total = float(weights.sum())
    if not total > 0.0:
        return _finding(name, told, None, limits, least=least)
    spoilt = weights * (1.0 - h[name] if least else h[name])
    worst = int(np.argmax(spoilt))
    time = float(h["time"][worst]) if spoilt[worst] > 0.0 else None
    return _finding(name, told, float(np.sum(weights * h[name])) / total, limits, least=least, time=time)


def _covered(h: Columns, tools: Sequence[str], force: float, limits: Limits) -> Finding:
    """Return the least coverage of a tool that closes on the charge."""
    told = "cover kept by a closing tool"
    shares = coverage(h, tools, force)
    if not np.any(~np.isnan(shares)):
        return _finding("coverage", told, None, limits, least=True)
    step, tool = np.unravel_index(int(np.nanargmin(shares)), shares.shape)
    particle, position = _place(h, "released", int(step))
    return _finding(
        "coverage", told, float(shares[step, tool]), limits, least=True, time=float(h["time"][step]),
        tool=tools[int(tool)], particle=particle, position=position,
    )  # fmt: skip


def _balanced(h: Columns, tools: Sequence[str], least_force: float, limits: Limits) -> Finding:
    """Return the part of the tools' impulse in the whole run that is not balanced, and the step that adds most to it.

    What tools exert must add up to nothing, for inertia is none or scaled to be negligible. With stiff fibres reactions
    scatter; single steps of small forces say little, the run's sum says whether its forces mean anything.
    """
    told = "tools' forces out of balance"
    steps, durations = len(h["time"]), np.diff(h["time"], prepend=0.0)
    each = np.array([[h[f"force_{tool}_{axis}"] for axis in "xyz"] for tool in tools]).reshape(len(tools), 3, steps)
    exerted = durations * 0.5 * np.linalg.norm(each, axis=1).sum(axis=0)
    left = durations * np.linalg.norm(each.sum(axis=0), axis=0)
    if not float(exerted.sum()) > least_force * float(durations.sum()):
        return _finding("force_balance", told, None, limits)
    worst = int(np.argmax(left))
    time = float(h["time"][worst]) if left[worst] > 0.0 else None
    return _finding("force_balance", told, float(left.sum() / exerted.sum()), limits, time=time)


def let_go(record: Coverage, tools: Sequence[str], spacing: float, released: Place) -> str | None:
    """Return what to say if closing tools have lost the charge, None while they have not.

    Parameters
    ----------
    record : Coverage
    tools : sequence of str
        Names.
    spacing : float
        mm.
    released : Place
        Where the last contact was let go.
    """
    lost = record.lost(spacing)
    if len(lost) == 0:
        return None
    names = " and ".join(f"'{tools[int(k)]}'" for k in lost)
    since, way = float(record.since[lost].min()), float(record.way[lost].max())
    where = ""
    if released.particle >= 0:
        where = ", particle {} last at ({:.4g}, {:.4g}, {:.4g}) mm".format(released.particle, *released.position)
    return (
        f"the charge has let go of {names}: since t = {since:.6g} s less than {LET_GO:.0%} of what covered them is "
        f"left{where}, while the tools closed by {way:.3g} mm more; such a charge leans and tips over: wall friction, "
        "side walls, less height for its width or solver.ambient_pressure hold it back"
    )
