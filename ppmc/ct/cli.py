"""Commands `ppmc phantom` and `ppmc ct`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ppmc.command import command


@command
def ct(
    scene: Path,
    /,
    *,
    input: Path | None = None,
    output: Path | None = None,
    resume: bool = False,
    part: str | None = None,
    figures: Path | None = None,
    suggest: bool = False,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Find fibre direction p, platelet normal r and their certainty at every voxel of a CT volume.

    p is the direction of least grey-value change in a small flat window, r that of greatest change in a larger one.
    Lengths in the scene are in mm unless it gives a unit; windows follow from voxel size and platelet thickness
    unless given.

    Parameters
    ----------
    scene : Path
        Scene file with a section `ct`.
    input : Path, optional
        Volume: .vtkhdf, .h5, .tif, .zarr, .mhd, .nrrd, .nii, .dcm, .npy, raw, or a folder of slices (TIFF, PNG, JPEG,
        BMP, DICOM); default `ct: source: path` of the scene, else runs/<name>/volume.vtkhdf.
    output : Path, optional
        Orientations file to write; default runs/<name>/orientations.vtkhdf.
    resume : bool
        Keep finished tiles in the folder <output>.parts until all are done, and use those found there.
    part : str, optional
        Compute only a share of the tiles, such as 2/8 for the second of eight, and leave them in <output>.parts;
        when all shares are done, --resume gathers them. For jobs on several machines.
    figures : Path, optional
        Folder for pictures of the result: sections, angles, pole figures, tensors through the thickness, glyphs.
    suggest : bool
        Only look at the volume and print sigma, windows and noise level that suit it, as a section for the scene.
    force : bool
        Replace an output that holds no orientations of ppmc.

    Examples
    --------
    ppmc ct configs/demo.yaml

    ppmc ct scan.yaml --input slices/ --output orientations.vtkhdf --figures figures

    ppmc ct scan.yaml --suggest
    """
    from ppmc.scene import load_scene
    from ppmc.scene.paths import run_paths

    loaded = load_scene(scene)
    paths = run_paths(loaded)
    if input is None and loaded.require("ct").source.path is None:
        input = paths.volume
    if suggest:
        from ppmc.ct.stage import suggest as advice

        print("\n".join(advice(loaded, input=input)))
        return
    share = share_of(part) if part else None
    output = output or paths.orientations
    from ppmc.files.lock import Claim, locked

    with locked([Claim(output, shared=share is not None)]):
        from ppmc.ct import stage

        written = stage.run(loaded, input=input, output=output, resume=resume, part=share, force=force, tell=print)
    print(written)
    if figures is not None and share is None:
        from ppmc.ct.figures import draw

        for path in draw(written, figures, force=force):
            print(path)


def share_of(text: str) -> tuple[int, int]:
    """Return (2, 8) for "2/8"."""
    from ppmc.errors import SceneError

    try:
        number, count = (int(value) for value in text.split("/"))
    except ValueError:
        number, count = 0, 0
    if not 1 <= number <= count:
        raise SceneError(f"--part {text}: write the share and the number of shares, such as 2/8")
    return number, count


@command
def phantom(
    scene: Path, /, *, output: Path | None = None, force: Annotated[bool, Parameter(negative="")] = False
) -> None:
    """Make a synthetic CT volume of a platelet preform, with its true p, r and platelet ids in the same file.

    Parameters
    ----------
    scene : Path
        Scene file with a section `phantom`; its `seed` decides every random draw.
    output : Path, optional
        Volume file to write; default runs/<name>/volume.vtkhdf.
    force : bool
        Replace an output that is no volume of ppmc.

    Examples
    --------
    ppmc phantom configs/demo.yaml
    """
    from ppmc.files.lock import Claim, locked
    from ppmc.scene import load_scene
    from ppmc.scene.paths import run_paths

    loaded = load_scene(scene)
    output = output or run_paths(loaded).volume
    with locked([Claim(output)]):
        from ppmc.ct.stage import make_phantom

        print(make_phantom(loaded, output, force=force))
