"""The CT stage as a function call: a grey volume in, fibre directions and platelet normals out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ppmc.api.quantities import Quantity
from ppmc.api.session import session
from ppmc.api.voxels import Voxels
from ppmc.errors import SceneError
from ppmc.scene.loader import make_section

if TYPE_CHECKING:
    import numpy as np

    from ppmc.ct.volume import Volume
    from ppmc.scene import Scene


def orient(
    volume: str | Path | np.ndarray | Voxels, *, voxel_size: Quantity | tuple[Quantity, ...] | None = None,
    mask: np.ndarray | None = None, output: str | Path | None = None, force: bool = False, progress: bool = False,
    name: str = "ct", **keys: Any,
) -> Voxels:  # fmt: skip
    """Find fibre directions and platelet normals in a CT volume.

    Parameters
    ----------
    volume : str, Path, ndarray of shape (nz, ny, nx), or Voxels
        File or folder of any kind that ``ppmc ct`` reads, or grey values.
    voxel_size : quantity, or three (x, y, z), optional
        mm; needed unless the file states it.
    mask : ndarray of shape (nz, ny, nx), or mapping, optional
        Not zero inside the specimen, for an array; or a scene's ``ct.mask``, such as ``{"segment": True}``.
    output : str or Path, optional
        Orientations file to write, as ``ppmc ct`` does, tile by tile; kept in memory if left out. Of a file only.
    force : bool
        With `output`: replace a file that holds no orientations of ppmc.
    progress : bool
        Show how far the work has come.
    name : str
        Name of the scene that the orientations carry.
    **keys
        Other keys of a scene's section ``ct``: `sigma`, `fibre_window`, `platelet_thickness`, `stride` …

    Returns
    -------
    Voxels
        `fibre_direction`, `platelet_normal`, `confidence` and the other fields of the contract ``orientations``.

    Raises
    ------
    SceneError
        If a value makes no sense, the voxel size is not known, or windows do not fit volume or memory.
    InputFileError
        If the volume is missing, damaged, or holds values that are no grey values.
    StorageError
        If the output cannot be written.

    Notes
    -----
    The structure tensor: J, section III.A; the theory page has the formulas.

    Examples
    --------
    >>> found = ppmc.orient("scan.tif", voxel_size="50 um", platelet_thickness="0.14 mm")
    >>> found.A
    """
    if isinstance(mask, Mapping):
        keys["mask"], mask = mask, None
    source = dict(keys.pop("source", {}))
    if isinstance(volume, str | Path):
        source["path"] = str(volume)
    if voxel_size is not None:
        source["voxel_size"] = voxel_size
    whole = {"name": name, "ct": {**{k: v for k, v in keys.items() if v is not None}, "source": source}}
    from ppmc.scene import Scene

    scene = make_section(Scene, "ppmc.orient", whole)
    with session(progress):
        if output is not None:
            return _in_file(scene, volume, mask, Path(output), force)
        return _in_memory(scene, volume, mask)


def _in_file(scene: Scene, volume: Any, mask: np.ndarray | None, output: Path, force: bool) -> Voxels:
    """Measure as the command does, and open the file."""
    from ppmc.ct import stage

    path = volume.path if isinstance(volume, Voxels) else volume
    if not isinstance(path, str | Path) or mask is not None:
        raise SceneError(
            "ppmc.orient: `output` is for a volume in a file; write what is found in an array with Voxels.write"
        )
    return Voxels.read(stage.run(scene, input=Path(path), output=output, force=force))


def _in_memory(scene: Scene, volume: Any, mask: np.ndarray | None) -> Voxels:
    """Measure, and keep what is found."""
    from ppmc.ct import stage
    from ppmc.files import MemoryVoxels, Provenance

    path = volume.path if isinstance(volume, Voxels) else volume
    if isinstance(path, str | Path):
        if mask is not None:
            raise SceneError("ppmc.orient: `mask` goes with an array; for a file give mask={'path': ...} in the keys")
        mask_path = stage.mask_path(scene)
        with stage.opened(scene, Path(path), mask_path) as given:
            found = stage.measure(scene, given)
        origin = stage.origin(scene, Path(path))
    else:
        found = stage.measure(scene, stage.specimen_of(scene.require("ct"), _volume_of(volume, mask)))
        origin = Provenance.collect("ppmc.ct", scene, ("ct",))
    return Voxels.in_memory(MemoryVoxels("orientations", found.fields, grid=found.grid, provenance=origin))


def _volume_of(given: Any, mask: np.ndarray | None) -> Volume:
    """Return an array of grey values as a volume."""
    import numpy as np

    from ppmc.ct.volume import Volume

    place: dict[str, Any] = {}
    if isinstance(given, Voxels):
        grid = given.grid
        place = {"spacing": grid.spacing, "origin": grid.origin, "direction": grid.direction}
        mask = given["mask"] if mask is None and "mask" in given.names else mask
        given = given["grey"]
    grey = np.asarray(given)
    if grey.ndim != 3 or grey.dtype.kind not in "uif" or not grey.size:
        raise SceneError(
            f"ppmc.orient: volume: an array of shape {grey.shape} and type {grey.dtype} is no grey volume; give a file "
            "or numbers of shape (nz, ny, nx)"
        )
    if mask is not None and np.shape(mask) != grey.shape:
        raise SceneError(f"ppmc.orient: mask has shape {np.shape(mask)}, the volume {grey.shape}; they must be equal")
    inside = None if mask is None else np.asarray(np.asarray(mask) != 0, np.uint8)
    read_mask = None if inside is None else lambda box: inside[box]
    nz, ny, nx = grey.shape
    return Volume(
        Path("volume in memory"), (nz, ny, nx), grey.dtype, lambda box: grey[box], read_mask=read_mask, **place
    )
