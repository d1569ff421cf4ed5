"""From the scene's tools to the arrays that kernels use."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.errors import SceneError
from ppmc.geometry.points import as_points
from ppmc.geometry.surfaces.surface import ClosedSurface
from ppmc.geometry.tools.distance import nearest_tools, signed_distances
from ppmc.geometry.tools.motion import ToolMotions
from ppmc.geometry.tools.outline import outline_bounds, outline_segments
from ppmc.geometry.tools.packed import (
    BOX,
    CYLINDER,
    EXTRUSION,
    MESH,
    PLANE,
    REVOLUTION,
    SEGMENT_COLUMNS,
    ToolArrays,
)
from ppmc.scene.sections.tooling import (
    BoxTool,
    CylinderTool,
    ExtrusionTool,
    MeshTool,
    PlaneTool,
    RevolutionTool,
    Rotation,
    RoundedBoxTool,
    Tool,
)

FloatArray = NDArray[np.float64]


@dataclass
class _Packed:
    """One tool before it is joined with the others; see `ToolArrays`."""

    kind: int
    origin: FloatArray
    frame: FloatArray
    side: float = 1.0
    size: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    segments: FloatArray = field(default_factory=lambda: np.zeros((0, SEGMENT_COLUMNS)))
    box: FloatArray = field(default_factory=lambda: np.array([[-math.inf] * 3, [math.inf] * 3]))
    grid_shape: tuple[int, int, int] = (0, 0, 0)
    grid_origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    grid_spacing: float = 0.0
    grid_values: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, dtype=np.float32))
    surface: ClosedSurface | None = None


@dataclass(frozen=True)
class ToolSet:
    """All tools of a scene, ready to be asked for distances.

    Attributes
    ----------
    names : tuple of str
        Names in the scene's order; the index of a name is the tool's index everywhere.
    arrays : ToolArrays
        What kernels take.
    motions : ToolMotions
        Prescribed motions.
    tools : tuple of Tool
        The validated descriptions.
    surfaces : tuple of ClosedSurface or None
        Of each tool from a file its triangles, in the file's own axes; None for the others.
    """

    names: tuple[str, ...]
    arrays: ToolArrays
    motions: ToolMotions
    tools: tuple[Tool, ...]
    surfaces: tuple[ClosedSurface | None, ...]

    def __len__(self) -> int:
        """Return the number of tools."""
        return len(self.names)

    def offsets(self, time: float) -> FloatArray:
        """Return the prescribed displacement of every tool, shape (tools, 3), mm; zero for tools under force."""
        return self.motions.displacements(time)

    def velocities(self, time: float) -> FloatArray:
        """Return the prescribed velocity of every tool just after `time`, shape (tools, 3), mm/s."""
        return self.motions.velocities(time)

    def next_break(self, time: float) -> float:
        """Return the next time at which a prescribed velocity changes, s; infinite if none does."""
        return self.motions.next_break(time)

    def distances(self, points: ArrayLike, time: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return the distance of every tool from every point and the normals, shapes (tools, n), (tools, n, 3)."""
        phi, normals = signed_distances(self.arrays, self.offsets(time), as_points(points))
        return phi, normals

    def clearance(self, points: ArrayLike, time: float = 0.0) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return each point's distance to the nearest tool, shape (n,), mm, negative in a tool; and that tool."""
        phi, index = nearest_tools(self.arrays, self.offsets(time), as_points(points))
        return phi, index


def compile_tools(tooling: Mapping[str, Tool], directory: Path | None = None) -> ToolSet:
    """Return the tools of a scene in the form that kernels use.

    Parameters
    ----------
    tooling : mapping of str to Tool
        The scene's section ``tooling``.
    directory : Path, optional
        Folder to which mesh files are relative; the working directory if absent.

    Returns
    -------
    ToolSet
        Tools in the mapping's order.

    Raises
    ------
    SceneError
        If an outline is not simple or a fillet does not fit.
    InputFileError
        If a mesh file is missing, damaged or not a closed surface.
    """
    packed = [_pack(tool, name, directory or Path()) for name, tool in tooling.items()]
    tools = list(tooling.values())
    motions = ToolMotions([tool.motion for tool in tools])
    return ToolSet(tuple(tooling), _join(packed), motions, tuple(tools), tuple(p.surface for p in packed))


def _pack(tool: Tool, name: str, directory: Path) -> _Packed:
    """Return one tool's numbers."""
    side = -1.0 if getattr(tool, "inside", False) else 1.0
    if isinstance(tool, PlaneTool):
        return _Packed(PLANE, np.array(tool.point), _axes_about(np.array(tool.normal)))
    if isinstance(tool, BoxTool | RoundedBoxTool):
        half = 0.5 * np.array(tool.size)
        rounding = tool.edge_radius if isinstance(tool, RoundedBoxTool) else 0.0
        core = np.maximum(half - rounding, 0.0)
        return _Packed(
            BOX,
            np.array(tool.center),
            rotation_matrix(tool.rotation).T,
            side,
            (float(core[0]), float(core[1]), float(core[2]), rounding),
            box=np.stack([-half, half]),
        )
    if isinstance(tool, CylinderTool):
        half_length = math.inf if tool.length is None else 0.5 * tool.length
        reach = np.array([tool.radius, tool.radius, half_length])
        size = (tool.radius - tool.edge_radius, half_length - tool.edge_radius, 0.0, tool.edge_radius)
        return _Packed(
            CYLINDER, np.array(tool.center), _axes_about(np.array(tool.axis)), side, size, box=np.stack([-reach, reach])
        )
    if isinstance(tool, ExtrusionTool):
        return _pack_extrusion(tool, name, side)
    if isinstance(tool, RevolutionTool):
        return _pack_revolution(tool, name, side)
    return _pack_mesh(tool, name, side, directory)


def _pack_extrusion(tool: ExtrusionTool, name: str, side: float) -> _Packed:
    """Return an extrusion: outline in local x, y; sweep along local z, centred."""
    axis, first = np.array(tool.axis), np.array(tool.first_axis)
    segments = outline_segments(tool.profile, tool.corner_radii, name=f"tooling.{name}.profile")
    half_length = math.inf if tool.length is None else 0.5 * tool.length
    origin = np.array(tool.origin) + (0.0 if tool.length is None else half_length) * axis
    low, high = outline_bounds(segments)
    return _Packed(
        EXTRUSION,
        origin,
        np.stack([first, np.cross(axis, first), axis]),
        side,
        (half_length, 0.0, 0.0, 0.0),
        segments,
        np.array([[*low, -half_length], [*high, half_length]]),
    )


def _pack_revolution(tool: RevolutionTool, name: str, side: float) -> _Packed:
    """Return a body of revolution: spine along local x, axis along local z."""
    axis = np.array(tool.axis)
    segments = outline_segments(tool.profile, tool.corner_radii, axis_at_zero=True, name=f"tooling.{name}.profile")
    frame = _axes_about(axis)
    if tool.spine > 0:
        spine = np.array(tool.spine_axis)
        frame = np.stack([spine, np.cross(axis, spine), axis])
    low, high = outline_bounds(segments)
    half = 0.5 * tool.spine
    return _Packed(
        REVOLUTION,
        np.array(tool.origin),
        frame,
        side,
        (half, 0.0, 0.0, 0.0),
        segments,
        np.array([[-half - high[0], -high[0], low[1]], [half + high[0], high[0], high[1]]]),
    )


def _pack_mesh(tool: MeshTool, name: str, side: float, directory: Path) -> _Packed:
    """Return a mesh tool: its distance grid in the file's own axes, scaled to mm."""
    from ppmc.geometry.surfaces.surface import read_surface
    from ppmc.geometry.tools.distance_grid import distance_grid

    path = tool.file if tool.file.is_absolute() else directory / tool.file
    surface = read_surface(path, unit=tool.unit, scale=tool.scale)
    grid = distance_grid(surface, tool.grid_spacing)
    low, high = surface.bounds
    return _Packed(
        MESH,
        np.array(tool.origin),
        rotation_matrix(tool.rotation).T,
        side,
        box=np.stack([low, high]),
        grid_shape=grid.shape,
        grid_origin=grid.origin,
        grid_spacing=grid.spacing,
        grid_values=grid.values.ravel(),
        surface=surface,
    )


def _is_convex(packed: _Packed) -> bool:
    """Tell whether a tool is surely convex; a body of revolution is taken as not."""
    if packed.side < 0 or packed.kind in (REVOLUTION, MESH):
        return False
    if packed.kind != EXTRUSION:
        return True
    rows = packed.segments
    if (rows[:, 7] < 0).any():
        return False
    # Outside a convex outline no edge has another edge's end in front of it.
    start, end, others = rows[:, None, 0:2], rows[:, None, 2:4], rows[None, :, 0:2]
    tangent, away = end - start, others - start
    front = away[..., 0] * tangent[..., 1] - away[..., 1] * tangent[..., 0]
    return bool((front <= 1e-9 * float(np.ptp(rows[:, 0:2])) ** 2).all())


def rotation_matrix(rotation: Rotation | None) -> FloatArray:
    """Return the 3x3 matrix of a turn (columns are the turned axes); identity for none. Rodrigues' formula."""
    if rotation is None:
        return np.eye(3)
    x, y, z = rotation.axis
    angle = math.radians(rotation.angle)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)


def _axes_about(axis: FloatArray) -> FloatArray:
    """Return right-handed axes as rows, the third along `axis`, exact for the coordinate axes."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis])


def _join(packed: list[_Packed]) -> ToolArrays:
    """Return all tools in one tuple of arrays."""
    if not packed:
        raise SceneError("tooling: the scene has no tool; a squeeze needs at least two planes")
    counts = [len(p.segments) for p in packed]
    nodes = [p.grid_values.size for p in packed]
    return ToolArrays(
        kind=np.array([p.kind for p in packed], dtype=np.int64),
        side=np.array([p.side for p in packed]),
        convex=np.array([_is_convex(p) for p in packed]),
        origin=np.stack([p.origin for p in packed]).astype(float),
        frame=np.ascontiguousarray(np.stack([p.frame for p in packed])),
        size=np.array([p.size for p in packed]),
        segment_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        segments=np.ascontiguousarray(np.concatenate([p.segments for p in packed])),
        box=np.stack([p.box for p in packed]),
        grid_start=np.concatenate([[0], np.cumsum(nodes)[:-1]]).astype(np.int64),
        grid_shape=np.array([p.grid_shape for p in packed], dtype=np.int64),
        grid_origin=np.stack([p.grid_origin for p in packed]).astype(float),
        grid_spacing=np.array([p.grid_spacing for p in packed], dtype=float),
        grid_values=np.concatenate([p.grid_values for p in packed]),
    )
