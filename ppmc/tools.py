"""Tools for :func:`ppmc.solve`: every shape of a scene's section ``tooling``, with motion and wall law.

A tool is a solid; material stays outside of it. With ``inside=True`` a shape is turned round: the material is then kept
inside, in a cavity or a hole. Lengths are mm, or text or quantities with a unit. Each function raises
:class:`ppmc.errors.SceneError` with the key, the value and the remedy if its arguments make no tool.

>>> import ppmc
>>> ram = ppmc.tools.plane((0, 0, 6), (0, 0, -1), motion=ppmc.tools.velocity((0, 0, -3), travel=3), name="ram")
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ppmc.api.quantities import Quantity, Vector
from ppmc.errors import SceneError
from ppmc.scene.loader import make_section
from ppmc.scene.sections import tooling

if TYPE_CHECKING:
    from ppmc.scene.base import Section

T = TypeVar("T", bound="Section")

__all__ = [
    "Tool",
    "box",
    "cylinder",
    "extrusion",
    "force",
    "mesh",
    "named",
    "plane",
    "revolution",
    "rotation",
    "rounded_box",
    "table",
    "velocity",
]  # fmt: skip


@dataclass(frozen=True)
class Tool:
    """One tool.

    Attributes
    ----------
    section : Section
        Its validated description: shape, motion and wall law, as in a scene.
    name : str or None
        Name in tables of forces and in messages; ``tool_1``, ``tool_2`` … in the order of a list if None.
    """

    section: tooling.ToolBase
    name: str | None = None


def velocity(vector: Vector, *, start: Quantity = 0.0, travel: Quantity | None = None) -> tooling.VelocityMotion:
    """Return a motion at a constant velocity.

    Parameters
    ----------
    vector : three quantities
        Velocity, mm/s.
    start : quantity
        Time at which the tool begins to move, s.
    travel : quantity, optional
        Distance after which it stops, mm; it never stops if left out.
    """
    return _section(tooling.VelocityMotion, "velocity", velocity=vector, start=start, travel=travel)


def table(times: Sequence[Any], displacements: Sequence[Any]) -> tooling.TableMotion:
    """Return a motion along displacements at given times, linear between them.

    Parameters
    ----------
    times : sequence of k quantities
        Ascending, s.
    displacements : sequence of k vectors
        From the drawn position, mm.
    """
    return _section(tooling.TableMotion, "table", times=times, displacements=displacements)


def force(
    magnitude: Quantity, direction: Vector, *, max_speed: Quantity, travel: Quantity | None = None
) -> tooling.ForceMotion:
    """Return a motion under a force, as fast as the material lets it.

    Parameters
    ----------
    magnitude : quantity
        uN (Pa mm^2); better text with a unit, ``"500 N"``.
    direction : three floats
        Along which the tool is pushed and may move.
    max_speed : quantity
        Never exceeded, mm/s.
    travel : quantity, optional
        Distance to the stop, mm; none if left out.
    """
    return _section(
        tooling.ForceMotion, "force", force=magnitude, direction=direction, max_speed=max_speed, travel=travel
    )


def rotation(axis: Vector, angle: Quantity) -> tooling.Rotation:
    """Return a right-handed turn about `axis` by `angle`, degrees."""
    return _section(tooling.Rotation, "rotation", axis=axis, angle=angle)


def plane(
    point: Vector, normal: Vector, *, motion: Any = None, wall: Any = None, name: str | None = None
) -> Tool:  # fmt: skip
    """Return a half-space.

    Parameters
    ----------
    point : three quantities
        A point on the plane, mm.
    normal : three floats
        Out of the tool, towards the material.
    motion : motion, optional
        Of :func:`velocity`, :func:`table` or :func:`force`, or a mapping as in a scene; fixed if left out.
    wall : str or wall law
        ``"slip"`` (if left out), ``"no_slip"``, ``{"friction": "0.5 Pa*s/mm"}`` (Navier), or another as in a scene.
    name : str, optional
        Name of the tool.
    """
    return _tool(tooling.PlaneTool, "plane", name, point=point, normal=normal, motion=motion, wall=wall)


def box(
    center: Vector, size: Vector, *, rotation: Any = None, inside: bool = False, motion: Any = None,
    wall: Any = None, name: str | None = None,
) -> Tool:  # fmt: skip
    """Return a block, or with `inside` a box-shaped cavity.

    Parameters
    ----------
    center, size : three quantities
        Centre and full side lengths, mm.
    rotation : Rotation, optional
        Turn about the centre, of :func:`rotation`.
    inside : bool
        Keep the material inside.
    motion, wall, name
        As of :func:`plane`.
    """
    return _tool(
        tooling.BoxTool, "box", name, center=center, size=size, rotation=rotation, inside=inside, motion=motion,
        wall=wall,
    )  # fmt: skip


def rounded_box(
    center: Vector, size: Vector, edge_radius: Quantity, *, rotation: Any = None, inside: bool = False,
    motion: Any = None, wall: Any = None, name: str | None = None,
) -> Tool:  # fmt: skip
    """Return a block with rounded edges and corners, or with `inside` a cavity with fillets.

    Parameters
    ----------
    center, size : three quantities
        Centre and full side lengths over the flat faces, mm.
    edge_radius : quantity
        Of all edges and corners, mm; at most half the shortest side.
    rotation, inside, motion, wall, name
        As of :func:`box`.
    """
    return _tool(
        tooling.RoundedBoxTool, "rounded_box", name, center=center, size=size, edge_radius=edge_radius,
        rotation=rotation, inside=inside, motion=motion, wall=wall,
    )  # fmt: skip


def cylinder(
    center: Vector, axis: Vector, radius: Quantity, *, length: Quantity | None = None, edge_radius: Quantity = 0.0,
    inside: bool = False, motion: Any = None, wall: Any = None, name: str | None = None,
) -> Tool:  # fmt: skip
    """Return a round pin, or with `inside` a round hole.

    Parameters
    ----------
    center : three quantities
        Middle of the axis, mm.
    axis : three floats
        Direction of the axis.
    radius : quantity
        mm.
    length : quantity, optional
        Between the flat ends, mm; without it there are no ends.
    edge_radius : quantity
        Rounding of the end edges, mm.
    inside, motion, wall, name
        As of :func:`box`.
    """
    return _tool(
        tooling.CylinderTool, "cylinder", name, center=center, axis=axis, radius=radius, length=length,
        edge_radius=edge_radius, inside=inside, motion=motion, wall=wall,
    )  # fmt: skip


def extrusion(
    profile: Sequence[Any], *, axis: Vector, first_axis: Vector, origin: Vector = (0.0, 0.0, 0.0),
    length: Quantity | None = None, corner_radii: Any = 0.0, inside: bool = False, motion: Any = None,
    wall: Any = None, name: str | None = None,
) -> Tool:  # fmt: skip
    """Return an outline swept along a straight axis.

    Parameters
    ----------
    profile : sequence of k pairs of quantities
        Corners of the closed outline, mm, in either sense.
    axis, first_axis : three floats
        Direction of the sweep, and of the outline's first coordinate, normal to it.
    origin : three quantities
        Where the outline's (0, 0) lies at the start of the sweep, mm.
    length : quantity, optional
        Of the sweep, mm; without it there are no ends.
    corner_radii : quantity or k quantities
        Fillets, mm.
    inside, motion, wall, name
        As of :func:`box`.
    """
    return _tool(
        tooling.ExtrusionTool, "extrusion", name, profile=profile, axis=axis, first_axis=first_axis, origin=origin,
        length=length, corner_radii=corner_radii, inside=inside, motion=motion, wall=wall,
    )  # fmt: skip


def revolution(
    profile: Sequence[Any], *, axis: Vector, origin: Vector = (0.0, 0.0, 0.0), spine: Quantity = 0.0,
    spine_axis: Vector = (1.0, 0.0, 0.0), corner_radii: Any = 0.0, inside: bool = False, motion: Any = None,
    wall: Any = None, name: str | None = None,
) -> Tool:  # fmt: skip
    """Return an outline turned about an axis, or swept round a straight spine (a stadium plan).

    Parameters
    ----------
    profile : sequence of k pairs of quantities
        Distance from the axis and height along it of the outline's corners, mm.
    axis : three floats
        Direction of the heights.
    origin : three quantities
        Where the axis meets height zero (middle of the spine), mm.
    spine : quantity
        Length of the spine, mm; 0 is a body of revolution.
    spine_axis : three floats
        Direction of the spine, normal to `axis`.
    corner_radii : quantity or k quantities
        Fillets, mm.
    inside, motion, wall, name
        As of :func:`box`.
    """
    return _tool(
        tooling.RevolutionTool, "revolution", name, profile=profile, axis=axis, origin=origin, spine=spine,
        spine_axis=spine_axis, corner_radii=corner_radii, inside=inside, motion=motion, wall=wall,
    )  # fmt: skip


def mesh(
    file: str | Path, *, unit: str | None = None, scale: float = 1.0, origin: Vector = (0.0, 0.0, 0.0),
    rotation: Any = None, grid_spacing: Quantity | None = None, inside: bool = False, motion: Any = None,
    wall: Any = None, name: str | None = None,
) -> Tool:  # fmt: skip
    """Return a closed triangle mesh from an STL, OBJ, PLY or VTU file.

    Parameters
    ----------
    file : str or Path
        Relative to the working directory; read when the tool is used.
    unit : str, optional
        Of the coordinates: mm (default), m, cm, um or inch.
    scale : float
        Further factor.
    origin : three quantities
        Where the file's origin is put, mm.
    rotation : Rotation, optional
        Turn about the file's origin before that.
    grid_spacing : quantity, optional
        Of the distance grid, mm; 1/150 of the longest side by default.
    inside, motion, wall, name
        As of :func:`box`.
    """
    return _tool(
        tooling.MeshTool, "mesh", name, file=Path(file), unit=unit, scale=scale, origin=origin, rotation=rotation,
        grid_spacing=grid_spacing, inside=inside, motion=motion, wall=wall,
    )  # fmt: skip


def named(tools: Mapping[str, Tool] | Iterable[Tool]) -> dict[str, Any]:
    """Return tools as a scene's section ``tooling``: sections by name.

    Parameters
    ----------
    tools : mapping of str to Tool, or iterable of Tool
        A mapping's names go before those that tools carry.

    Raises
    ------
    SceneError
        If two tools have one name, or something is no tool.
    """
    pairs = tools.items() if isinstance(tools, Mapping) else ((None, tool) for tool in tools)
    out: dict[str, Any] = {}
    for number, (given, tool) in enumerate(pairs, 1):
        if not isinstance(tool, Tool):
            raise SceneError(f"tools: {tool!r} is no tool; make one with ppmc.tools, such as ppmc.tools.plane(...)")
        name = given or tool.name or f"tool_{number}"
        if name in out:
            raise SceneError(f"tools: two are named '{name}'; give each a name of its own")
        out[name] = tool.section
    return out


def _section(model: type[T], name: str, **values: Any) -> T:
    return make_section(model, f"ppmc.tools.{name}", _given(values))


def _tool(model: type[tooling.ToolBase], shape: str, name: str | None, **values: Any) -> Tool:
    return Tool(make_section(model, f"ppmc.tools.{shape}", {"shape": shape, **_given(values)}), name)


def _given(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values without those left out, so that a shape knows what was given."""
    return {key: value for key, value in values.items() if value is not None and value is not False}
