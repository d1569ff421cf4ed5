"""Command `ppmc part`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ppmc.command import command


@command
def part(
    name: Literal["pin_bracket", "double_dome", "center_gated_disk", "plaque"],
    /,
    *,
    set: list[str] | None = None,
    spacing: float = 1.0,
    output: Path | None = None,
    mesh: Path | None = None,
    mesh_size: float = 2.0,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Write the scene of a parametric part: tools with motion, charge, inspection regions, from volume balance.

    Dimensions left alone have the papers' values. The height of the bracket's hole and the length of the double dome
    are computed, so that the closed cavity holds the charge.

    Parameters
    ----------
    name : str
        The part.
    set : list of str, optional
        Dimensions to change, each key=value; a value may have a unit.
    spacing : float
        Distance between particles, mm.
    output : Path, optional
        Scene file to write; default standard output.
    mesh : Path, optional
        Structural mesh of the closed part to write too, .vtu or Abaqus .inp.
    mesh_size : float
        Element size of that mesh, mm.
    force : bool
        Replace files that this command did not write.

    Examples
    --------
    ppmc part pin_bracket --output bracket.yaml

    ppmc part pin_bracket --set hole_diameter=9.525 --set flanges=minus --mesh bracket.inp
    """
    from ppmc.errors import SceneError
    from ppmc.files import check_output, whole_file
    from ppmc.files.beside import marked_file
    from ppmc.files.storage import is_text_with
    from ppmc.geometry.parts.scene_text import make_part, scene_text

    if mesh is not None and mesh.suffix.lower() not in (".vtu", ".inp"):
        raise SceneError(f"{mesh}: a mesh is written as .vtu or .inp, not '{mesh.suffix}'")
    made = make_part(name, set or [])
    text = scene_text(made, output.stem if output is not None else name, spacing)
    if output is None:
        print(text, end="")
    else:
        check_output(output, is_own=is_text_with(b"Made by `ppmc part`"), force=force)
        with whole_file(output) as temporary:
            temporary.write_text(text, encoding="utf-8")
        print(f"{output}: charge and cavity {made.charge_volume:.6g} mm^3, stroke {made.stroke:.4g} mm")
    if mesh is not None:
        bricks = made.mesh(mesh_size)
        with marked_file(mesh, [output], force=force) as temporary:
            bricks.write(temporary, mesh.suffix)
        print(f"{mesh}: {len(bricks.bricks):,} bricks, {bricks.volumes().sum():.6g} mm^3")
