"""One container for everything that has a place and directions: a charge, a frame of a flow, voxels, points of a file.

Also what can be averaged: each row is some material, with its volume as the weight.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ppmc.errors import InputFileError
from ppmc.orientation import orientation_tensor

if TYPE_CHECKING:
    import pandas as pd
    import pyvista as pv

    from ppmc.files import ParticleFile, SeriesFile


@dataclass(frozen=True)
class Particles:
    """Points that carry volume and, where known, directions.

    Every array of `fields` is also an attribute: ``frame.velocity`` is ``frame.fields["velocity"]``, with full tensors
    of shape (n, 3, 3) where the file has nine components.

    Parameters
    ----------
    label : str
        Name of the source as it appears in tables and legends, e.g. ``"flow"`` or ``"CT"``.
    positions : ndarray, shape (n, 3)
        mm, columns x1, x2, x3.
    volume : ndarray, shape (n,)
        mm³; the weight of every average.
    fibre_direction, platelet_normal : ndarray, shape (n, 3), optional
        Unit vectors p and r; ``None`` when the source does not carry them. A row that is zero or not finite is
        "unknown" and is left out of the averages (and counted).
    platelet_id : ndarray, shape (n,), optional
        -1 = none.
    time : float, optional
        s; ``None`` for sources without time.
    fields : dict
        Every other per-point array the source offers, by its name on disk.

    Raises
    ------
    InputFileError
        If the arrays are not of one length.
    """

    label: str
    positions: np.ndarray
    volume: np.ndarray
    fibre_direction: np.ndarray | None = None
    platelet_normal: np.ndarray | None = None
    platelet_id: np.ndarray | None = None
    time: float | None = None
    fields: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.positions)
        if self.positions.shape != (n, 3):
            raise InputFileError(f"{self.label}: positions have shape {self.positions.shape}, expected (n, 3)")
        for name in ("volume", "fibre_direction", "platelet_normal", "platelet_id"):
            values = getattr(self, name)
            if values is not None and len(values) != n:
                raise InputFileError(f"{self.label}: {name} has {len(values)} rows, positions have {n}")

    def __len__(self) -> int:
        return len(self.positions)

    def __repr__(self) -> str:
        """Return the points in one line; arrays would fill pages."""
        return f"Particles({self.title}: {len(self):,} points, {', '.join(self.arrays())})"

    def __getattr__(self, name: str) -> np.ndarray:
        """Return a field by its name on disk, a tensor as (n, 3, 3)."""
        fields = self.__dict__.get("fields", {})
        if name not in fields:
            known = ", ".join(sorted(fields)) or "none"
            raise AttributeError(f"particles of '{self.__dict__.get('label')}' have no field '{name}'; fields: {known}")
        values = np.asarray(fields[name])
        return values.reshape(-1, 3, 3) if values.ndim == 2 and values.shape[1] == 9 else values

    def __dir__(self) -> list[str]:
        """Name the fields too, for editors that complete."""
        return [*super().__dir__(), *self.fields]

    @property
    def p(self) -> np.ndarray:
        """Fibre directions p, shape (n, 3).

        Raises
        ------
        InputFileError
            If none are known.
        """
        return self._known("fibre_direction")

    @property
    def r(self) -> np.ndarray:
        """Platelet normals r, shape (n, 3).

        Raises
        ------
        InputFileError
            If none are known.
        """
        return self._known("platelet_normal")

    def _known(self, name: str) -> np.ndarray:
        """Return a direction that must be there."""
        directions = getattr(self, name)
        if directions is None:
            raise InputFileError(f"{self.title}: carries no {name}")
        return np.asarray(directions)

    @property
    def A(self) -> np.ndarray:  # noqa: N802
        """Fibre orientation tensor ``<p p>``, shape (3, 3), of the whole, weighted with volume (J, section II.A).

        Raises
        ------
        InputFileError
            If no fibre directions are known.
        """
        return self._tensor(self.p)

    @property
    def N(self) -> np.ndarray:  # noqa: N802
        """Normal orientation tensor ``<r r>``, shape (3, 3), of the whole, weighted with volume (J, section II.A).

        Raises
        ------
        InputFileError
            If no platelet normals are known.
        """
        return self._tensor(self.r)

    @property
    def J(self) -> np.ndarray:  # noqa: N802
        """Volume ratio det F since the start, shape (n,), of a frame of a flow."""
        return self.__getattr__("volume_ratio")

    @property
    def F(self) -> np.ndarray:  # noqa: N802
        """Deformation gradient since the start, shape (n, 3, 3), of a frame of a flow."""
        return self.__getattr__("deformation_gradient")

    def _tensor(self, directions: np.ndarray) -> np.ndarray:
        """Return the average dyad of directions, rows without one left out."""
        known = np.isfinite(directions).all(axis=1) & (directions != 0).any(axis=1)
        if known.all():
            return np.asarray(orientation_tensor(directions, self.volume))
        return np.asarray(orientation_tensor(directions[known], self.volume[known]))

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all arrays by their names on disk, positions and unknown directions apart."""
        named: dict[str, Any] = {
            "volume": self.volume, "fibre_direction": self.fibre_direction, "platelet_normal": self.platelet_normal,
            "platelet_id": self.platelet_id,
        }  # fmt: skip
        return {name: values for name, values in named.items() if values is not None} | self.fields

    def to_pandas(self) -> pd.DataFrame:
        """Return a table with a row a point: x1, x2, x3 (mm), then every array.

        A vector takes columns ``name_1`` to ``name_3``, a tensor ``name_11`` to ``name_33``; the time (s), where there
        is one, is ``table.attrs["time"]``.
        """
        import pandas as pd

        columns = {f"x{k + 1}": self.positions[:, k] for k in range(3)}
        for name, values in self.arrays().items():
            if values.ndim == 1:
                columns[name] = values
                continue
            width = values.shape[1]
            ends = [f"{a}{b}" for a in "123" for b in "123"] if width == 9 else [str(k + 1) for k in range(width)]
            columns |= {f"{name}_{end}": values[:, k] for k, end in enumerate(ends)}
        table = pd.DataFrame(columns)
        if self.time is not None:
            table.attrs["time"] = self.time
        return table

    def to_pyvista(self) -> pv.PolyData:
        """Return the points (mm) as a PyVista mesh of vertices with every array; the time (s) is ``TimeValue``."""
        import pyvista as pv

        mesh = pv.PolyData(np.ascontiguousarray(self.positions, dtype=np.float64))
        for name, values in self.arrays().items():
            mesh.point_data[name] = values
        if self.time is not None:
            mesh.field_data["TimeValue"] = [self.time]
        return mesh

    @property
    def title(self) -> str:
        """Label with the time, as legends and captions show it."""
        return self.label if self.time is None else f"{self.label}, t = {self.time:.4g} s"

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates of the points, mm; NaN when there is none."""
        if not len(self):
            return np.full(3, np.nan), np.full(3, np.nan)
        return self.positions.min(axis=0), self.positions.max(axis=0)

    @property
    def spacing(self) -> float:
        """Typical distance of neighbours: the cube root of the mean volume, mm."""
        return float(np.cbrt(self.volume.mean())) if len(self) else float("nan")

    def select(self, mask: np.ndarray) -> Particles:
        """Return the points where ``mask`` (boolean, or indices) holds."""
        return replace(
            self,
            positions=self.positions[mask],
            volume=self.volume[mask],
            fibre_direction=None if self.fibre_direction is None else self.fibre_direction[mask],
            platelet_normal=None if self.platelet_normal is None else self.platelet_normal[mask],
            platelet_id=None if self.platelet_id is None else self.platelet_id[mask],
            fields={name: values[mask] for name, values in self.fields.items()},
        )

    def rotated(self, rotation: np.ndarray) -> Particles:
        """Return the same material after the rigid rotation ``x -> rotation @ x`` (positions, p and r)."""

        def turn(v: np.ndarray | None) -> np.ndarray | None:
            return None if v is None else v @ rotation.T

        return replace(
            self,
            positions=self.positions @ rotation.T,
            fibre_direction=turn(self.fibre_direction),
            platelet_normal=turn(self.platelet_normal),
        )


def join(parts: list[Particles], label: str | None = None) -> Particles:
    """Concatenate sources; a direction is kept only when every part carries it."""
    if not parts:
        raise InputFileError("nothing to join: no samples given")

    def stack(name: str) -> np.ndarray | None:
        values = [getattr(part, name) for part in parts]
        return None if any(v is None for v in values) else np.concatenate(values)

    shared = set.intersection(*(set(part.fields) for part in parts))
    return Particles(
        label=label or parts[0].label,
        positions=np.concatenate([part.positions for part in parts]),
        volume=np.concatenate([part.volume for part in parts]),
        fibre_direction=stack("fibre_direction"),
        platelet_normal=stack("platelet_normal"),
        platelet_id=stack("platelet_id"),
        time=parts[0].time,
        fields={name: np.concatenate([part.fields[name] for part in parts]) for name in sorted(shared)},
    )


def charge_particles(file: ParticleFile, label: str = "charge") -> Particles:
    """Return the particles of a charge."""
    own = ("volume", "fibre_direction", "platelet_normal", "platelet_id")
    f = file.fields
    rest = {name: values for name, values in f.items() if name not in own}
    return Particles(
        label, file.positions, f["volume"], f["fibre_direction"], f["platelet_normal"], f["platelet_id"], None, rest
    )


def flow_particles(file: SeriesFile, frame: int, label: str = "flow") -> Particles:
    """Return one frame of a flow history; the weight is the volume at the start, which the material carries along.

    Raises
    ------
    InputFileError
        If there is no such frame, or it is damaged.
    """
    values = file.frame(frame)
    fields = {name: v for name, v in values.items() if name not in ("position", "fibre_direction", "platelet_normal")}
    fields["reference_position"] = file.static["reference_position"]
    normal = values.get("platelet_normal")
    if normal is None and "in_plane_direction" in values:
        # r = p x q is implied by the two directions that every platelet must carry (J section II.A).
        normal = np.cross(values["fibre_direction"], values["in_plane_direction"])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    return Particles(
        label, values["position"], file.static["volume"].astype(float), values["fibre_direction"], normal,
        file.static.get("platelet_id"), float(file.times[frame]), fields,
    )  # fmt: skip
