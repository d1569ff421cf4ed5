"""Commands `ppmc phantom` and `ppmc ct`."""

from __future__ import annotations

from pathlib import Path

from ppmc.command import command


@command
def ct(scene: Path, /, *, input: Path | None = None, output: Path | None = None) -> None:
    """Find fibre direction p, platelet normal r and their certainty at every voxel of a CT volume.

    p is the direction of least grey-value change in a small flat window, r that of greatest change in a larger one.
    Lengths in the scene are in mm unless it gives a unit; windows follow from voxel size and platelet thickness
    unless given.

    Parameters
    ----------
    scene : Path
        Scene file with a section `ct`.
    input : Path, optional
        Volume: .vtkhdf, .h5, .tif, folder of .tif, or raw; default `ct: source: path` of the scene, else
        runs/<name>/volume.vtkhdf.
    output : Path, optional
        Orientations file to write; default runs/<name>/orientations.vtkhdf.

    Examples
    --------
    ppmc ct configs/demo.yaml

    ppmc ct scan.yaml --input slices/ --output orientations.vtkhdf
    """
    from ppmc.ct.stage import run
    from ppmc.scene import load_scene
    from ppmc.scene.paths import run_paths

    loaded = load_scene(scene)
    paths = run_paths(loaded)
    if input is None and loaded.require("ct").source.path is None:
        input = paths.volume
    print(run(loaded, input=input, output=output or paths.orientations))


@command
def phantom(scene: Path, /, *, output: Path | None = None) -> None:
    """Make a synthetic CT volume of a platelet preform, with its true p, r and platelet ids in the same file.

    Parameters
    ----------
    scene : Path
        Scene file with a section `phantom`; its `seed` decides every random draw.
    output : Path, optional
        Volume file to write; default runs/<name>/volume.vtkhdf.

    Examples
    --------
    ppmc phantom configs/demo.yaml
    """
    from ppmc.ct.stage import make_phantom
    from ppmc.scene import load_scene
    from ppmc.scene.paths import run_paths

    loaded = load_scene(scene)
    print(make_phantom(loaded, output or run_paths(loaded).volume))
