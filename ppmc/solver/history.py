"""The table with a row a step: kept for the result, mirrored live in a CSV file."""

import csv
from pathlib import Path

import numpy as np

from ppmc.solver.model import StepReport
from ppmc.solver.state import ParticleState


class History:
    """Rows of scalars, one a step.

    Attributes
    ----------
    columns : tuple of str
    rows : list of list of float
    path : Path
        The CSV file, rewritten at the start so that a resumed run has no row twice.
    """

    def __init__(self, tools: tuple[str, ...], path: Path, rows: np.ndarray | None = None) -> None:
        forces = tuple(f"force_{tool}_{axis}" for tool in tools for axis in "xyz")
        moments = tuple(f"moment_{tool}_{axis}" for tool in tools for axis in "xyz")
        self.columns = (
            "time", "step", "iterations", "passes", "estimated_error", "unconverged", "contacts", "penetration",
            "dissipation", "hourglass_share", "driven_share", "mean_volume_ratio_error", "max_volume_ratio_error",
            "press_force", *forces, *moments,
        )  # fmt: skip
        self.rows = [] if rows is None else rows.tolist()
        self.path = path
        with path.open("w", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(self.columns)
            writer.writerows(self.rows)

    def add(self, time: float, report: StepReport, state: ParticleState, press_force: float) -> None:
        """Add the row of a step that ended at `time`."""
        error = np.abs(state.volume_ratio - 1.0)
        row = [
            time, report.time_step, report.iterations, report.passes, report.estimated_error, report.unconverged,
            report.contacts, report.penetration, report.dissipation, report.zero_energy_share, report.driven_share,
            float(error.mean()), float(error.max()), press_force, *report.tool_force.ravel().tolist(),
            *report.tool_moment.ravel().tolist(),
        ]  # fmt: skip
        self.rows.append([float(value) for value in row])
        with self.path.open("a", newline="") as handle:
            csv.writer(handle).writerow(row)

    def table(self) -> np.ndarray:
        """All rows, shape (steps, columns)."""
        return np.array(self.rows, dtype=np.float64).reshape(-1, len(self.columns))

    def by_column(self) -> dict[str, np.ndarray]:
        """Columns by name, shape (steps,) each."""
        return dict(zip(self.columns, self.table().T.copy(), strict=True))
