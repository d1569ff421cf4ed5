"""The analysis stage as a function call, and analysis files: A and N over regions and paths, as tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ppmc.api.charge import Charge
from ppmc.api.flow import Flow
from ppmc.api.session import session
from ppmc.api.voxels import Voxels
from ppmc.errors import InputFileError, SceneError
from ppmc.scene.loader import make_section

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import pyvista as pv

    from ppmc.files import Provenance, SeriesFile
    from ppmc.scene import Scene


class Analysis:
    """Tensors over regions and paths, and every table of the report.

    Attributes
    ----------
    series : SeriesFile
        Tensors of the input, a frame a time step, as the analysis file holds them.
    tables : dict of str to DataFrame
        Tables by name (``regions``, ``paths``, ``fourth_order``, ``kinematics`` …), as in the folder ``tables``.
    """

    def __init__(self, series: SeriesFile, tables: dict[str, pd.DataFrame]) -> None:
        self.series = series
        self.tables = tables

    @classmethod
    def read(cls, path: str | Path) -> Analysis:
        """Read an analysis file, and the tables in the folder ``tables`` beside it that belong to it.

        Raises
        ------
        InputFileError
            If the file is missing, damaged or no analysis.
        """
        import pandas as pd

        from ppmc.files import file_digest, load_series

        path = Path(path)
        series = load_series(path, "analysis")
        tables = {}
        for name, noted in series.extra.get("files", {}).items():
            beside = path.parent / name
            # Tables of another analysis, or changed ones, are not those of this file.
            if beside.suffix == ".csv" and beside.is_file() and file_digest(beside) == noted:
                tables[beside.stem] = pd.read_csv(beside)
        return cls(series, tables)

    def __repr__(self) -> str:
        """Return the analysis in one line."""
        return f"Analysis({self.series.n} regions, {len(self.times)} frames, tables {', '.join(self.tables) or 'none'})"

    @property
    def path(self) -> Path | None:
        """Its file, None if it is in memory."""
        return self.series.path if self.series.path.exists() else None

    @property
    def times(self) -> np.ndarray:
        """Times, shape (frames,), s."""
        return self.series.times

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions, those along paths among them, in the order of :attr:`A`."""
        return tuple(self.series.extra.get("region_names", ()))

    @property
    def A(self) -> np.ndarray:  # noqa: N802
        """Fibre orientation tensors, shape (frames, regions, 3, 3); NaN where a region holds no fibre."""
        return self._tensors("fibre_tensor")

    @property
    def N(self) -> np.ndarray:  # noqa: N802
        """Normal orientation tensors, shape (frames, regions, 3, 3); NaN where a region holds no normal."""
        return self._tensors("normal_tensor")

    @property
    def provenance(self) -> Provenance:
        """Where it comes from."""
        return self.series.provenance

    def to_pandas(self, table: str = "regions") -> pd.DataFrame:
        """Return a table by name.

        Raises
        ------
        InputFileError
            If there is none of that name; naming those there are.
        """
        if table not in self.tables:
            known = ", ".join(self.tables) or "none"
            raise InputFileError(f"{self.series.path}: has no table '{table}'; it has {known}")
        return self.tables[table]

    def to_pyvista(self, frame: int = -1) -> pv.PolyData:
        """Return the regions' centres (mm) as a PyVista mesh, with the tensors (XX, YY, ZZ, XY, YZ, XZ) at a frame."""
        import pyvista as pv

        values = self.series.frame(frame)
        mesh = pv.PolyData(values.pop("position"))
        for name, array in {**self.series.static, **values}.items():
            mesh.point_data[name] = array
        mesh.field_data["TimeValue"] = [float(self.times[frame])]
        return mesh

    def _tensors(self, name: str) -> np.ndarray:
        import numpy as np

        from ppmc.orientation import from_six

        return np.array([from_six(self.series.frame(k, [name])[name]) for k in range(len(self.times))])


def analyze(
    input: Flow | Charge | Voxels | str | Path, *, regions: Mapping[str, Any] | None = None,
    paths: Mapping[str, Any] | None = None, output: str | Path | None = None, force: bool = False,
    progress: bool = False, name: str = "analysis", **keys: Any,
) -> Analysis:  # fmt: skip
    """Average a flow, a charge or orientations over regions and along paths.

    Parameters
    ----------
    input : Flow, Charge, Voxels, str or Path
        What to analyse, or its file.
    regions, paths : mapping of str to mapping, optional
        As in a scene's section ``analysis``: ``{"middle": {"min": (2, 2, 1), "max": (22, 14, 5)}}``, mm.
    output : str or Path, optional
        Analysis file to write, with tables, figures and ``report.html`` beside it, as ``ppmc analyze`` does. Of an
        input in a file only.
    force : bool
        With `output`: replace files that ppmc did not write.
    progress : bool
        Show how far the work has come.
    name : str
        Name of the scene, which heads the report.
    **keys
        Other keys of the section: `frames` (``"ends"`` or ``"all"``), `views`, `mesh` …

    Returns
    -------
    Analysis
        Tables as pandas frames, tensors as arrays.

    Raises
    ------
    SceneError
        If a value makes no sense, or a path cannot be laid through the material.
    InputFileError
        If a file is missing or damaged.
    StorageError
        If the results cannot be written.

    Examples
    --------
    >>> found = ppmc.analyze(flow, regions={"middle": {"min": (4, 4, 0), "max": (8, 8, 3)}}, frames="all")
    >>> found.to_pandas("regions")
    """
    if isinstance(input, str | Path):
        from ppmc.api.reading import read

        given = read(input)
        if isinstance(given, Analysis):
            raise InputFileError(f"{input}: holds 'analysis', which is not analysed again; give a flow or a charge")
        input = given
    asked = {"regions": regions, "paths": paths, **keys}
    scene = _scene(input, name, {key: value for key, value in asked.items() if value is not None})
    with session(progress):
        if output is None:
            return _in_memory(scene, input)
        return _in_file(scene, input, Path(output), force)


def _scene(input: Flow | Charge | Voxels, name: str, section: dict[str, Any]) -> Scene:
    """Return the scene of a call, with the tools that the input knows: they give local axes their normals."""
    from ppmc.scene import Scene

    tooling = input.provenance.scene.get("tooling") if input.provenance.scene else None
    return make_section(Scene, "ppmc.analyze", {"name": name, "analysis": section, "tooling": tooling})


def _in_memory(scene: Scene, input: Flow | Charge | Voxels) -> Analysis:
    """Analyse, and keep what is found."""
    from contextlib import ExitStack

    from ppmc.analysis.gather import Opened, gather
    from ppmc.analysis.output import analysis_series, result_tables
    from ppmc.files import Provenance

    with ExitStack() as stack:
        if isinstance(input, Flow):
            opened = Opened("flow", flow=input.series)
        elif isinstance(input, Charge):
            opened = Opened("charge", charge=input.contents)
        else:
            opened = Opened(input.product)
            setattr(opened, input.product, stack.enter_context(input.opened()))
        results = gather(scene, scene.require("analysis"), opened)
        origin = Provenance.collect("ppmc.analysis", scene, ("analysis", "tooling"))
        return Analysis(analysis_series(results, origin, {}), result_tables(results))


def _in_file(scene: Scene, input: Flow | Charge | Voxels, output: Path, force: bool) -> Analysis:
    """Analyse as the command does, and open the file."""
    from ppmc.analysis import stage

    if input.path is None:
        raise SceneError(
            "ppmc.analyze: `output` is for an input in a file; write it first, such as flow.write('flow.vtkhdf')"
        )
    stage.run(scene, input=input.path, output=output, force=force)
    return Analysis.read(output)
