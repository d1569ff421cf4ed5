"""Any product of ppmc as the object of its kind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ppmc.errors import InputFileError

if TYPE_CHECKING:
    from ppmc.api.analysis import Analysis
    from ppmc.api.charge import Charge
    from ppmc.api.flow import Flow
    from ppmc.api.voxels import Voxels


def read(path: str | Path) -> Flow | Charge | Voxels | Analysis:
    """Read a file that ppmc wrote.

    Parameters
    ----------
    path : str or Path
        A volume, orientations, a charge, a flow (or the folder in which one grows) or an analysis.

    Returns
    -------
    Flow, Charge, Voxels or Analysis
        One kind of object for each product; voxels for a volume and orientations.

    Raises
    ------
    InputFileError
        If the file is missing or damaged, or holds none of these.

    Examples
    --------
    >>> flow = ppmc.read("runs/demo/flow.vtkhdf")
    >>> flow[-1].to_pandas(), flow[-1].to_pyvista()
    """
    from ppmc.files import product_of

    path = Path(path)
    if path.is_dir():
        from ppmc.api.flow import Flow

        return Flow.read(path)
    product = product_of(path)
    if product in ("volume", "orientations"):
        from ppmc.api.voxels import Voxels

        return Voxels.read(path)
    if product == "charge":
        from ppmc.api.charge import Charge

        return Charge.read(path)
    if product == "flow":
        from ppmc.api.flow import Flow

        return Flow.read(path)
    if product == "analysis":
        from ppmc.api.analysis import Analysis

        return Analysis.read(path)
    raise InputFileError(
        f"{path}: holds '{product}'; ppmc.read takes a volume, orientations, a charge, a flow or an analysis"
    )
