"""Charges: particles with their platelet frames, from a box or another shape, a CT measurement, arrays or a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ppmc.api.orientations import Orientation
from ppmc.api.quantities import Vector
from ppmc.api.session import session
from ppmc.errors import SceneError
from ppmc.scene.loader import make_section

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import pyvista as pv
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from ppmc.files import ParticleFile, Provenance
    from ppmc.particles import Particles
    from ppmc.tools import Tool


class Charge:
    """Particles of a charge before moulding, and their platelet frames.

    Made by :meth:`box`, :meth:`fill`, :meth:`draped`, :meth:`from_arrays` or :meth:`read`. All that is made is what
    ``ppmc charge`` would write from the same values, bit for bit.

    Attributes
    ----------
    contents : ParticleFile
        Positions, fields and facts, as a charge file holds them.
    path : Path or None
        File that it was read from.
    """

    def __init__(self, contents: ParticleFile, path: Path | None = None) -> None:
        self.contents = contents
        self.path = path

    @classmethod
    def box(
        cls, size: Vector, *, spacing: Any, orientation: Orientation, origin: Vector = (0.0, 0.0, 0.0),
        layers: int | None = None,
    ) -> Charge:  # fmt: skip
        """Fill a box with edges along the axes.

        Parameters
        ----------
        size : three quantities
            Edge lengths, mm.
        spacing : quantity, or three
            Distance between particles, mm; adjusted so that a whole number fits.
        orientation : Orientation
            Where directions come from, such as ``ppmc.PlanarRandom(seed=1)``.
        origin : three quantities
            Corner of least x1, x2, x3, mm.
        layers : int, optional
            Layers along x3, in place of the third spacing.

        Raises
        ------
        SceneError
            If the values make no charge, with the key and the value.
        InputFileError
            If a file of the orientation is missing or broken.

        Examples
        --------
        >>> charge = ppmc.Charge.box((12, 12, "6 mm"), spacing=0.75, orientation=ppmc.PlanarRandom(seed=1))
        """
        domain = {"shape": "box", "origin": origin, "size": size}
        return cls._made("box", domain, spacing, orientation, layers)

    @classmethod
    def fill(
        cls, shape: Tool, *, spacing: Any, orientation: Orientation, layers: int | None = None
    ) -> Charge:  # fmt: skip
        """Fill a shape of :mod:`ppmc.tools`, taken as a solid: all but the plane and the sharp-edged box.

        Parameters
        ----------
        shape : Tool
            Such as ``ppmc.tools.cylinder(...)``, without motion, wall law and `inside`.
        spacing, orientation, layers
            As of :meth:`box`.

        Raises
        ------
        SceneError, InputFileError
            As :meth:`box`; if the shape has no ends; if its mesh is no closed surface.

        Notes
        -----
        Particles lie on a lattice; their volumes add up to that of the shape.
        """
        section = getattr(shape, "section", None)
        if section is None:
            raise SceneError(f"ppmc.Charge.fill: {shape!r} is no shape; take one of ppmc.tools, or ppmc.Charge.box")
        domain = {name: getattr(section, name) for name in section.model_fields_set}
        return cls._made("fill", domain, spacing, orientation, layers)

    @classmethod
    def draped(
        cls, size: Vector, on: Tool, *, spacing: Any, orientation: Orientation, layers: int | None = None,
        centre: Vector = (0.0, 0.0, 0.0), down: Vector = (0.0, 0.0, -1.0), along: Vector = (1.0, 0.0, 0.0),
        poisson_ratio: float = 0.3,
    ) -> Charge:  # fmt: skip
        """Lay a flat sheet onto a tool; directions are those of the sheet (x1 along it, x2 across) and turn with it.

        Parameters
        ----------
        size : three quantities
            Length, width and thickness of the sheet, mm.
        on : Tool
            The tool, at its drawn position.
        spacing, orientation, layers
            As of :meth:`box`.
        centre : three quantities
            A point of the line on which the sheet's middle comes down, mm.
        down, along : three floats
            Direction in which it is laid down, and of its length.
        poisson_ratio : float
            Of the quasi-isotropic sheet in its plane.

        Raises
        ------
        SceneError, InputFileError
            As :meth:`box`.
        """
        from ppmc.tools import named

        tools = named([on])
        domain = {
            "shape": "draped", "tool": next(iter(tools)), "size": size, "centre": centre, "down": down, "along": along,
            "poisson_ratio": poisson_ratio,
        }  # fmt: skip
        return cls._made("draped", domain, spacing, orientation, layers, tools)

    @classmethod
    def from_arrays(
        cls, positions: ArrayLike, fibre_direction: ArrayLike, platelet_normal: ArrayLike, volume: ArrayLike | float, *,
        platelet_id: ArrayLike | None = None, spacing: Any = None,
    ) -> Charge:  # fmt: skip
        """Take particles from arrays.

        Parameters
        ----------
        positions : array_like, shape (n, 3)
            mm.
        fibre_direction, platelet_normal : array_like, shape (n, 3), or (3,) for all alike
            p and r, of unit length and perpendicular within one per cent; both are then made exact.
        volume : array_like, shape (n,), or float for all alike
            mm^3.
        platelet_id : array_like of int, shape (n,), optional
            Platelets, -1 for none.
        spacing : quantity, or three, optional
            Of the lattice, mm; the cube root of the mean volume if left out.

        Raises
        ------
        InputFileError
            If shapes do not go together, a value is not finite, a volume not positive, or directions are neither of
            unit length nor perpendicular; naming the first particle at fault.
        """
        from ppmc.charge.stage import given_particles

        return cls(given_particles(positions, fibre_direction, platelet_normal, volume, platelet_id, _spacing(spacing)))

    @classmethod
    def read(cls, path: str | Path) -> Charge:
        """Read a charge file.

        Raises
        ------
        InputFileError
            If the file is missing, damaged or no charge.
        """
        from ppmc.files import read_particles

        return cls(read_particles(Path(path), "charge"), Path(path))

    @classmethod
    def _made(
        cls, way: str, domain: dict[str, Any], spacing: Any, orientation: Orientation, layers: int | None,
        tools: dict[str, Any] | None = None,
    ) -> Charge:  # fmt: skip
        """Make a charge as the stage does, from a scene of its own."""
        from dataclasses import replace

        from ppmc.charge.stage import charge_origin, fill
        from ppmc.scene import Scene

        if not isinstance(orientation, Orientation):
            raise SceneError(
                f"ppmc.Charge.{way}: orientation: {orientation!r} is none; take one such as ppmc.PlanarRandom(seed=1)"
            )
        section = {"domain": domain, "spacing": spacing, "layers": layers, "orientation": orientation.section()}
        tooling = {**(tools or {}), **orientation.tools}
        for name, tool in (tools or {}).items():
            if tooling[name] != tool:
                raise SceneError(
                    f"ppmc.Charge.{way}: the tool of the sheet and that of the orientation are both named '{name}'; "
                    "give each a name of its own"
                )
        whole = {"name": "charge", "seed": orientation.seed, "charge": section, "tooling": tooling or None}
        scene = make_section(Scene, f"ppmc.Charge.{way}", whole)
        with session(), orientation.opened(scene.require("charge")) as sources:
            made = fill(scene, sources)
        origin = charge_origin(scene, *orientation.files, orientation.digests)
        return cls(replace(made, provenance=origin))

    def __len__(self) -> int:
        """Return the number of particles."""
        return len(self.contents.positions)

    def __repr__(self) -> str:
        """Return the charge in one line."""
        return f"Charge({len(self):,} particles, {self.total_volume:.6g} mm^3)"

    @property
    def particles(self) -> Particles:
        """The particles, with all fields, as NumPy arrays, and as tables and meshes."""
        from ppmc.particles import charge_particles

        return charge_particles(self.contents)

    @property
    def positions(self) -> np.ndarray:
        """Positions, shape (n, 3), mm."""
        return self.contents.positions

    @property
    def fibre_direction(self) -> np.ndarray:
        """Fibre directions p, shape (n, 3)."""
        return self.contents.fields["fibre_direction"]

    @property
    def platelet_normal(self) -> np.ndarray:
        """Platelet normals r, shape (n, 3)."""
        return self.contents.fields["platelet_normal"]

    @property
    def volume(self) -> np.ndarray:
        """Volumes, shape (n,), mm^3."""
        return self.contents.fields["volume"]

    @property
    def platelet_id(self) -> np.ndarray:
        """Platelet of each particle, shape (n,), -1 for none."""
        return self.contents.fields["platelet_id"]

    @property
    def total_volume(self) -> float:
        """Volume of the whole, mm^3."""
        return float(self.volume.sum())

    @property
    def A(self) -> np.ndarray:  # noqa: N802
        """Fibre orientation tensor ``<p p>``, shape (3, 3) (J, section II.A)."""
        return self.particles.A

    @property
    def N(self) -> np.ndarray:  # noqa: N802
        """Normal orientation tensor ``<r r>``, shape (3, 3) (J, section II.A)."""
        return self.particles.N

    @property
    def facts(self) -> dict[str, Any]:
        """Spacing, layers, and how the frames came about, as the charge file keeps them."""
        return self.contents.extra

    @property
    def provenance(self) -> Provenance:
        """Where it comes from: scene, inputs, seed, version."""
        return self.contents.provenance

    def to_pandas(self) -> pd.DataFrame:
        """Return a table with a row a particle, see :meth:`ppmc.particles.Particles.to_pandas`."""
        return self.particles.to_pandas()

    def to_pyvista(self) -> pv.PolyData:
        """Return the particles as a PyVista mesh, see :meth:`ppmc.particles.Particles.to_pyvista`."""
        return self.particles.to_pyvista()

    def plot(
        self, name: str = "fibre_direction", *, cut: tuple[ArrayLike, ArrayLike] | None = None,
        save: str | Path | None = None,
    ) -> Figure:  # fmt: skip
        """Draw a view off screen, see :meth:`ppmc.Flow.plot`."""
        from ppmc.api.plot import plot

        return plot(self.particles, name, cut, save)

    def write(self, output: str | Path, *, force: bool = False) -> Path:
        """Write the charge file that ``ppmc charge`` writes.

        Parameters
        ----------
        output : str or Path
            The file.
        force : bool
            Replace a file that is no charge of ppmc.

        Raises
        ------
        StorageError
            If it cannot be written.
        """
        from ppmc.charge.stage import write

        return write(self.contents, Path(output), force=force)


def _spacing(given: Any) -> list[float] | None:
    """Return a lattice spacing in mm."""
    if given is None:
        return None
    from ppmc.scene.base import Section
    from ppmc.scene.sections.charge import Spacing

    class Lattice(Section):
        spacing: Spacing

    return list(make_section(Lattice, "ppmc.Charge.from_arrays", {"spacing": given}).spacing)
