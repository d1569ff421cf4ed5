"""Command `ppmc charge`."""

from __future__ import annotations

from pathlib import Path

from ppmc.command import command


@command
def charge(scene: Path, /, *, input: Path | None = None, output: Path | None = None) -> None:
    """Fill the charge's domain with particles and give each its fibre direction and platelet normal.

    The domain is a box, cylinder, extrusion or closed surface; orientations come from CT (the nearest valid voxel,
    never interpolated) or from the scene. Lengths are in mm unless the scene gives a unit.

    Parameters
    ----------
    scene : Path
        Scene file with a section `charge`.
    input : Path, optional
        Orientations file, for `orientation: {source: ct}`; default runs/<name>/orientations.vtkhdf.
    output : Path, optional
        Charge file to write; default runs/<name>/charge.vtkhdf.

    Examples
    --------
    ppmc charge configs/demo.yaml

    ppmc charge configs/demo.yaml --input scan/orientations.vtkhdf --output charge.vtkhdf
    """
    from ppmc.charge.report import lines
    from ppmc.charge.stage import run
    from ppmc.scene import load_scene
    from ppmc.scene.paths import run_paths

    loaded = load_scene(scene)
    paths = run_paths(loaded)
    section = loaded.require("charge")
    if input is None and section.orientation.source == "ct":
        input = paths.orientations
    written = run(loaded, input=input, output=output or paths.charge)
    print("\n".join(lines(written)))
