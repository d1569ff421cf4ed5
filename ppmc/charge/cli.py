"""Command `ppmc charge`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ppmc.command import command


@command
def charge(
    scene: Path,
    /,
    *,
    input: Path | None = None,
    output: Path | None = None,
    volume: Path | None = None,
    export: list[Path] | None = None,
    pictures: Path | None = None,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Fill the charge's domain with particles and give each its fibre direction and platelet normal.

    The domain is a box, any other solid, a closed surface, or a sheet draped over a tool. Orientations come from CT or
    a file (the nearest voxel or point, never interpolated), or are made: uniform, planar random, about the normals of
    regions or of a tool, or random platelets. Lengths are in mm unless the scene gives a unit.

    Parameters
    ----------
    scene : Path
        Scene file with a section `charge`.
    input : Path, optional
        Orientations file, for `orientation: {source: ct}`; default runs/<name>/orientations.vtkhdf.
    output : Path, optional
        Charge file to write; default runs/<name>/charge.vtkhdf.
    volume : Path, optional
        Volume file of a phantom, from which particles take the numbers of their platelets.
    export : list of Path, optional
        Further file for other programs: .csv, .npz, .vtu or Abaqus .inp; may be given several times.
    pictures : Path, optional
        Folder for pictures of the charge: top view, cuts with the tools, view in the tool.
    force : bool
        Replace outputs that ppmc did not write.

    Examples
    --------
    ppmc charge configs/demo.yaml

    ppmc charge configs/demo.yaml --input scan/orientations.vtkhdf --output charge.vtkhdf

    ppmc charge configs/demo.yaml --export charge.inp --pictures figures
    """
    from ppmc.files.lock import Claim, locked
    from ppmc.scene import load_scene
    from ppmc.scene.paths import run_paths

    loaded = load_scene(scene)
    paths = run_paths(loaded)
    section = loaded.require("charge")
    if input is None and section.orientation.source == "ct":
        input = paths.orientations
    output = output or paths.charge
    with locked([Claim(output)]):
        from ppmc.charge.report import lines
        from ppmc.charge.stage import draw, run
        from ppmc.charge.stage import export as export_charge

        written = run(loaded, input=input, output=output, volume=volume, force=force)
        print("\n".join(lines(written)))
        keep = loaded.every_named_file()
        for path in export or []:
            print(f"  exported {export_charge(written, path, keep=keep, force=force)}")
        if pictures is not None:
            for picture in draw(loaded, written, pictures, force=force):
                print(f"  drew {picture}")
