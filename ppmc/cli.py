"""The ``ppmc`` command: the stages' commands under one name, errors as one message with their exit code.

The stages' command modules are light; each imports its stage only when it runs.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter

from ppmc import __version__
from ppmc.analysis.cli import analyze
from ppmc.charge.cli import charge
from ppmc.command import command
from ppmc.command_end import exit_code_of, left_with
from ppmc.ct.cli import ct, phantom
from ppmc.geometry.parts.cli import part
from ppmc.interrupts import hold_streams, install
from ppmc.solver.cli import solve

USAGE_ERROR = 2

app = App(
    name="ppmc",
    help=" ".join(
        (
            "Predict fibre orientation in compression-moulded prepreg platelets.\n\n"
            "Four stages exchange files: ct (CT volume to orientations), charge (particles), solve (moulding flow) and",
            "analyze (tensors, figures, report). A scene, one YAML file, describes them all; 'ppmc run SCENE' walks",
            "the chain. Units are mm, s, g, Pa; scenes may write '6 mm' or '1.31 GPa'.\n\n"
            "Exit codes: 0 done, 2 usage or scene, 3 bad input file, 4 numerical failure or, with --strict, a broken",
            "limit of the verdict, 5 storage, 75 stopped with a checkpoint, 130 Ctrl-C.",
        )
    ),
    version=f"ppmc {__version__}",
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
)

app.command(phantom)
app.command(ct)
app.command(charge)
app.command(solve)
app.command(part)
app.command(analyze)


@app.command
@command
def run(
    scene: Path,
    /,
    *,
    workdir: Path | None = None,
    force: bool = False,
    until: str | None = None,
    only: str | None = None,
    restart: bool = False,
    strict: bool = False,
) -> None:
    """Walk the whole chain of a scene; stages whose inputs and section are unchanged are skipped.

    Parameters
    ----------
    scene : Path
        Scene file (YAML).
    workdir : Path, optional
        Folder of the results; default runs/<scene name>.
    force : bool
        Run every stage anew, even if nothing changed, and replace outputs that ppmc did not write.
    until : str, optional
        Last stage to run: phantom, ct, charge, solve or analyze; default all.
    only : str, optional
        The one stage to run; the files it reads must be there.
    restart : bool
        Let an unfinished flow start over; without it a run of another scene is refused.
    strict : bool
        End with exit code 4 if the flow broke a limit of its verdict; all files are written all the same.

    Examples
    --------
    ppmc run configs/demo.yaml

    ppmc run configs/squeeze.yaml --workdir results/squeeze --force
    """
    from ppmc.chain import run_chain
    from ppmc.scene import load_scene

    run_chain(load_scene(scene), workdir=workdir, force=force, until=until, only=only, restart=restart, strict=strict)


@app.command
@command
def info(file: Path, /) -> None:
    """Explain a ppmc file: what it holds, units, times, and where it comes from.

    Parameters
    ----------
    file : Path
        Any .vtkhdf file that a stage wrote, or a checkpoint.

    Examples
    --------
    ppmc info runs/demo/flow.vtkhdf
    """
    from ppmc.files.describe import describe_file

    print(describe_file(file))


@app.command
@command
def check(path: Path, /) -> None:
    """Check a scene (schema and physics) or a file (every value and digest); nothing is changed.

    Parameters
    ----------
    path : Path
        A scene (.yaml, .yml) or a ppmc file.

    Examples
    --------
    ppmc check configs/demo.yaml

    ppmc check runs/demo/charge.vtkhdf
    """
    if path.suffix in (".yaml", ".yml"):
        from ppmc.chain import check_scene
        from ppmc.scene import load_scene

        print("\n".join(check_scene(load_scene(path))))
    else:
        from ppmc.files.describe import verify_file

        lines = verify_file(path)
        print("\n".join(lines))
        print(f"{path}: sound, {len(lines)} datasets verified")


@app.command
@command
def schema(
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Print the JSON schema of scenes, with which editors complete and check them.

    Parameters
    ----------
    output : Path, optional
        File to write; default standard output.
    force : bool
        Replace a file that is no JSON schema.

    Examples
    --------
    ppmc schema --output configs/schema/scene.schema.json
    """
    from ppmc.scene import scene_json_schema

    text = json.dumps(scene_json_schema(), indent=1) + "\n"
    if output is None:
        print(text, end="")
        return
    from ppmc.files.storage import check_output, is_text_with, whole_file

    check_output(output, is_own=is_text_with(b'"$schema"'), force=force)
    with whole_file(output) as temporary:
        temporary.write_text(text, encoding="utf-8")


def main() -> None:
    """Run the command line and leave with its exit code."""
    hold_streams()
    install()
    left_with(lambda: run_command(None))


def run_command(arguments: list[str] | None) -> int:
    """Return the exit code of a command line that nothing stopped."""
    try:
        result: Any = app(arguments, exit_on_error=False, result_action="return_value")
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except CycloptsError:
        return USAGE_ERROR  # cyclopts has printed it


def _run(arguments: list[str] | None) -> int:
    """Return the exit code of a command line."""
    return exit_code_of(lambda: run_command(arguments))


if __name__ == "__main__":
    main()
