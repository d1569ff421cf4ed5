"""The table with a row a step: kept for the result, mirrored live in a CSV file."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ppmc.solver.particles.state import ParticleState
from ppmc.solver.step.measures import OutsideMeasure, PackingMeasure, worst_volume_ratio
from ppmc.solver.step.model import Place, StepReport

FIRST_COLUMNS = b"time,step,iterations,"
"""How the table of a run begins, and few other files."""


def table_path(output: Path) -> Path:
    """Return where the live table of a run's steps is."""
    return output.with_name(f"{output.stem}.steps.csv")


@dataclass(frozen=True)
class StepMeasures:
    """What is measured at the end of a step, beside the report of its solve.

    Attributes
    ----------
    packing : PackingMeasure
    outside : OutsideMeasure
    press_force : float
        Of the moving tools along their motion, uN.
    cover, closing : ndarray, shape (tools,)
        Area of the charge that covers each tool, mm^2; speed with which it closes on the charge, mm/s.
    released : Place
        Last particle that let go of the tool that had kept least of its cover.
    """

    packing: PackingMeasure
    outside: OutsideMeasure
    press_force: float
    cover: np.ndarray
    closing: np.ndarray
    released: Place


def place_columns(name: str) -> tuple[str, str, str, str]:
    """Columns of a place: number of a particle, -1 for none, and where it is, mm."""
    return f"{name}_particle", f"{name}_x1", f"{name}_x2", f"{name}_x3"


def tool_columns(tools: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of the tools, after all others."""
    forces = tuple(f"force_{tool}_{axis}" for tool in tools for axis in "xyz")
    moments = tuple(f"moment_{tool}_{axis}" for tool in tools for axis in "xyz")
    cover = tuple(f"cover_{tool}" for tool in tools)
    return (*forces, *moments, *cover, *(f"closing_{tool}" for tool in tools))


class History:
    """Rows of scalars, one a step.

    Attributes
    ----------
    columns : tuple of str
    rows : list of list of float
    path : Path or None
        The CSV file, if there is one: rewritten at the start so that a resumed run has no row twice.
    """

    def __init__(self, tools: tuple[str, ...], path: Path | None, rows: np.ndarray | None = None) -> None:
        self.columns = (
            "time", "step", "iterations", "passes", "estimated_error", "unconverged", "contacts",
            "penetration", *place_columns("penetration"), "dissipation", "zero_energy_share", "driven_share",
            "mean_volume_ratio_error", "max_volume_ratio_error", *place_columns("volume_ratio"),
            "packing_low", "packing_high", "packing_worst", *place_columns("packing"),
            "outside", *place_columns("outside"), *place_columns("released"),
            "press_force", *tool_columns(tools),
        )  # fmt: skip
        self.rows = [] if rows is None else rows.tolist()
        self.path = path
        if path is not None:
            with path.open("w", newline="") as handle:
                writer = csv.writer(handle)
                writer.writerow(self.columns)
                writer.writerows(self.rows)

    def add(self, time: float, report: StepReport, state: ParticleState, measures: StepMeasures) -> None:
        """Add the row of a step that ended at `time`."""
        mean_error, largest_error, worst = worst_volume_ratio(state)
        packing, outside = measures.packing, measures.outside
        row = [
            time, report.time_step, report.iterations, report.passes, report.estimated_error, report.unconverged,
            report.contacts, report.penetration, *_cells(report.deepest), report.dissipation,
            report.zero_energy_share, report.driven_share, mean_error, largest_error, *_cells(worst), packing.low,
            packing.high, packing.worst, *_cells(packing.at), outside.count, *_cells(outside.at),
            *_cells(measures.released), measures.press_force, *report.tool_force.ravel().tolist(),
            *report.tool_moment.ravel().tolist(), *measures.cover.tolist(), *measures.closing.tolist(),
        ]  # fmt: skip
        # Floats throughout, as a run that goes on from a checkpoint has them: its table is the same to the byte.
        self.rows.append([float(value) for value in row])
        if self.path is not None:
            with self.path.open("a", newline="") as handle:
                csv.writer(handle).writerow(self.rows[-1])

    def table(self) -> np.ndarray:
        """All rows, shape (steps, columns)."""
        return np.array(self.rows, dtype=np.float64).reshape(-1, len(self.columns))

    def by_column(self) -> dict[str, np.ndarray]:
        """Columns by name, shape (steps,) each."""
        return dict(zip(self.columns, self.table().T.copy(), strict=True))

    def total(self, column: str) -> float:
        """Sum of a column over all steps."""
        at = self.columns.index(column)
        return sum(row[at] for row in self.rows)

    def last_place(self, name: str) -> Place:
        """Return the place of that name in the last row."""
        if not self.rows:
            return Place()
        at = self.columns.index(f"{name}_particle")
        particle, x1, x2, x3 = self.rows[-1][at : at + 4]
        return Place(int(particle), (x1, x2, x3))


def _cells(place: Place) -> tuple[float, ...]:
    return float(place.particle), *place.position
