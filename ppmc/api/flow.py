"""A flow history, in memory or in its file, as a sequence of frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, overload

from ppmc.errors import InputFileError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import pyvista as pv
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from ppmc.files import Provenance, SeriesFile
    from ppmc.files.verdict import Verdict
    from ppmc.particles import Particles


class Flow(Sequence["Particles"]):
    """A flow history: ``flow[k]`` is a frame, ``flow[-1]`` the last one.

    A frame of a file is read, and verified, when it is asked for; nothing stays open.

    Attributes
    ----------
    series : SeriesFile
        Times, fields and tables, as the flow file holds them.
    """

    def __init__(self, series: SeriesFile) -> None:
        self.series = series

    @classmethod
    def read(cls, path: str | Path) -> Flow:
        """Read a flow file, or the folder ``<stem>.partial`` in which one grows.

        Raises
        ------
        InputFileError
            If the file is missing, damaged, without a frame or no flow.
        """
        from ppmc.files import load_series

        return cls(load_series(Path(path), "flow"))

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.series.times)

    @overload
    def __getitem__(self, frame: int) -> Particles: ...
    @overload
    def __getitem__(self, frame: slice) -> list[Particles]: ...
    def __getitem__(self, frame: int | slice) -> Particles | list[Particles]:
        """Return a frame, or several.

        Raises
        ------
        IndexError
            If there is no such frame.
        InputFileError
            If the file has been damaged or replaced since it was read.
        """
        from ppmc.particles import flow_particles

        if isinstance(frame, slice):
            return [self[k] for k in range(*frame.indices(len(self)))]
        if not -len(self) <= frame < len(self):
            raise IndexError(f"{self.series.path}: has {len(self)} frames, frame {frame} was asked for")
        return flow_particles(self.series, frame)

    def __iter__(self) -> Iterator[Particles]:
        """Yield the frames one after the other; only one of them is in memory if the flow is in a file."""
        for k in range(len(self)):
            yield self[k]

    def __repr__(self) -> str:
        """Return the flow in one line."""
        verdict = "" if self.verdict is None else f", verdict {self.verdict.headline}"
        return f"Flow({self.series.n:,} particles, {len(self)} frames to t = {self.times[-1]:.6g} s{verdict})"

    @property
    def path(self) -> Path | None:
        """Its file, None if it is in memory."""
        return self.series.path if self.series.path.exists() else None

    @property
    def times(self) -> np.ndarray:
        """Times of the frames, shape (frames,), s."""
        return self.series.times

    @property
    def press_force(self) -> np.ndarray:
        """Force with which the moving tools press along their motion at each frame, shape (frames,), uN (Pa mm^2)."""
        return self._numbers("press_force")

    @property
    def A(self) -> np.ndarray:  # noqa: N802
        """Fibre orientation tensors ``<p p>`` of the whole, shape (frames, 3, 3) (J, section II.A)."""
        return self._tensors("fibre_direction")

    @property
    def N(self) -> np.ndarray:  # noqa: N802
        """Normal orientation tensors ``<r r>`` of the whole, shape (frames, 3, 3) (J, section II.A).

        Raises
        ------
        InputFileError
            If normals were not transported.
        """
        return self._tensors("platelet_normal")

    @property
    def steps(self) -> pd.DataFrame:
        """The table with a row a step: time (s), forces (uN) and moments (uN mm) of each tool, errors and measures.

        Empty while the flow grows. Its columns are those of :class:`ppmc.solver.run.history.History`.
        """
        import pandas as pd

        history = self.series.history
        first = [name for name in ("time", "step") if name in history]
        return pd.DataFrame({name: history[name] for name in [*first, *sorted(set(history) - set(first))]})

    @property
    def tools(self) -> tuple[str, ...]:
        """Names of the tools, in the order in which tables have them."""
        return tuple(self.series.extra.get("tools", ()))

    @property
    def verdict(self) -> Verdict | None:
        """Whether the run kept its limits, and which it broke; None while the flow grows."""
        from ppmc.files.verdict import read_verdict

        return read_verdict(self.series.extra, self.series.path)

    @property
    def provenance(self) -> Provenance:
        """Where it comes from: scene, inputs, version."""
        return self.series.provenance

    def to_pandas(self) -> pd.DataFrame:
        """Return a table with a row a frame: time (s), press force (uN), A11 … A33 and, if known, N11 … N33."""
        import pandas as pd

        columns = {"time": self.times, **self.series.scalars}
        for name, field in (("A", "fibre_direction"), ("N", "platelet_normal")):
            if field in self.series.names:
                tensors = self._tensors(field)
                columns |= {f"{name}{i + 1}{j + 1}": tensors[:, i, j] for i in range(3) for j in range(i, 3)}
        return pd.DataFrame(columns)

    def to_pyvista(self, frame: int = -1) -> pv.PolyData:
        """Return a frame as a PyVista mesh, see :meth:`ppmc.particles.Particles.to_pyvista`."""
        return self[frame].to_pyvista()

    def plot(
        self, name: str = "fibre_direction", *, frame: int = -1, cut: tuple[ArrayLike, ArrayLike] | None = None,
        save: str | Path | None = None,
    ) -> Figure:  # fmt: skip
        """Draw a frame off screen, by PyVista where VTK can draw and by matplotlib where it cannot.

        Parameters
        ----------
        name : str
            A view of the report (``fibre_direction``, ``platelet_normal``, ``dominant_direction``, ``iso_surface``,
            ``platelets``, ``maps``), or any field of the frame: a scalar, or the length of a vector.
        frame : int
            Negative counts from the end.
        cut : (point, normal), optional
            Plane that opens the part, mm; what lies on the normal's side is left out.
        save : str or Path, optional
            Picture to write as well, in the format of its ending.

        Returns
        -------
        matplotlib.figure.Figure
            Shown by notebooks as it is.

        Raises
        ------
        SceneError
            If there is no such view or field.
        """
        from ppmc.api.plot import plot

        return plot(self[frame], name, cut, save)

    def write(self, output: str | Path, *, force: bool = False) -> Path:
        """Write the flow file, as the command would have.

        Parameters
        ----------
        output : str or Path
            The file.
        force : bool
            Replace a file that is no flow of ppmc.

        Raises
        ------
        StorageError
            If it cannot be written.
        """
        from ppmc.files import check_output, is_product, write_series
        from ppmc.files.lock import Claim, locked

        output = Path(output)
        with locked([Claim(output)]):
            check_output(output, [self.path], is_own=is_product("flow"), force=force)
            return write_series(self.series, output)

    def _numbers(self, name: str) -> np.ndarray:
        """Return a number of each frame."""
        if name not in self.series.scalars:
            raise InputFileError(f"{self.series.path}: holds no {name}")
        return self.series.scalars[name]

    def _tensors(self, name: str) -> np.ndarray:
        """Return the orientation tensors of a direction at all frames."""
        import numpy as np

        from ppmc.orientation import orientation_tensor

        if name not in self.series.names:
            raise InputFileError(f"{self.series.path}: carries no {name}")
        volume = self.series.static["volume"]
        frames = (self.series.frame(k, [name])[name] for k in range(len(self)))
        return np.array([orientation_tensor(directions, volume) for directions in frames])
