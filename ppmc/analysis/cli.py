"""Command `ppmc analyze`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ppmc.command import command


@command
def analyze(
    scene: Path,
    /,
    *,
    input: Path | None = None,
    output: Path | None = None,
    volume: Path | None = None,
    orientations: Path | None = None,
    charge: Path | None = None,
    moulded: Path | None = None,
    compare: Annotated[list[Path] | None, Parameter(negative="")] = None,
    seeds: Annotated[list[Path] | None, Parameter(negative="")] = None,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Average A and N over regions and paths, draw figures, and write one self-contained report.

    Reads a flow, a charge or an orientations file. Beside the output appear report.html (pictures inside, needs no
    network), tables/, figures/ and analysis.json. Lengths are in mm, times in s, forces in the report in N.

    Parameters
    ----------
    scene : Path
        Scene file; its section `analysis` names regions and paths (without it: the whole file, 20 slices along x1).
    input : Path, optional
        Flow, charge or orientations file; default the last of these in runs/<name>.
    output : Path, optional
        Analysis file to write; default runs/<name>/analysis.vtkhdf.
    volume : Path, optional
        Phantom volume, whose true directions CT is compared with; default volume.vtkhdf beside the input, if there.
    orientations : Path, optional
        Voxel orientations, overlaid in the plots; default orientations.vtkhdf beside the input, if there.
    charge : Path, optional
        Charge, overlaid too; default none, as a flow's first frame shows it.
    moulded : Path, optional
        Orientations measured in the moulded part (in tool coordinates), set beside the flow's last state.
    compare : list of Path, optional
        Flows of other runs, overlaid and compared with the input; repeat the option for more.
    seeds : list of Path, optional
        Flows of the same case with other seeds, joined with the input into mean and spread; repeat for more.
    force : bool
        Replace an output, or a report beside it, that ppmc did not write.

    Examples
    --------
    ppmc analyze configs/demo.yaml

    ppmc analyze configs/demo.yaml --input runs/demo/charge.vtkhdf --output look/analysis.vtkhdf

    ppmc analyze configs/bracket.yaml --seeds runs/seed2/flow.vtkhdf --seeds runs/seed3/flow.vtkhdf
    """
    from ppmc.errors import InputFileError
    from ppmc.files.lock import Claim, locked
    from ppmc.scene import load_scene, run_paths

    loaded = load_scene(scene)
    paths = run_paths(loaded)
    if input is None:
        found = [path for path in (paths.flow, paths.charge, paths.orientations) if path.exists()]
        if not found:
            raise InputFileError(
                f"{paths.directory}: holds no flow, charge or orientations file; run the earlier stages or give --input"
            )
        input = found[0]
    volume = volume or _beside(input, "volume.vtkhdf")
    orientations = orientations or _beside(input, "orientations.vtkhdf")
    output = output or paths.analysis
    with locked([Claim(output)]):
        from ppmc.analysis.stage import run

        written = run(
            loaded,
            input=input,
            output=output,
            volume=volume,
            orientations=orientations,
            charge=charge,
            moulded=moulded,
            compare=compare or (),
            seeds=seeds or (),
            force=force,
        )
    print(f"{written}\n{written.parent / 'report.html'}")


def _beside(input: Path, name: str) -> Path | None:
    """Return a file of that name in the input's folder, if there is one and it is not the input itself."""
    path = input.parent / name
    return path if path.exists() and path.absolute() != input.absolute() else None
