"""Verdicts of the shipped scenes, as the documentation's table: what ppmc solve says of each.

    python pipelines/benchmarks/solver_verdicts.py [SCENE ...] [--runs runs] [--output docs/benchmarks/verdicts.md]

Runs each scene's chain up to its flow into RUNS/<scene>, where stages that are unchanged are kept, and reads the
verdict from the file. Scenes without a flow there can be left out with --only-done, which computes nothing.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ppmc.chain import run_chain
from ppmc.errors import PpmcError
from ppmc.files import open_series
from ppmc.files.verdict import Verdict, read_verdict
from ppmc.scene import load_scene, run_paths

ROOT = Path(__file__).parents[2]
# Those that a workstation does in minutes; the brackets, domes and the plaque take hours.
SMALL = ("squeeze", "demo", "center_gated_disk")
HEAD = """# Solver: verdicts of the shipped scenes

What [`ppmc solve`](../guide.md) says of the scenes in `configs`; the whole table comes from

```sh
make -C pipelines verdicts
```

which runs the small ones and reads the others where `runs/` has their flow.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Path, help="scene files; default those small enough")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs")
    parser.add_argument("--output", type=Path, help="page to write; default standard output")
    parser.add_argument("--only-done", action="store_true", help="compute nothing, read the flows that are there")
    options = parser.parse_args()
    every = sorted((ROOT / "configs").glob("*.yaml"))
    scenes = options.scenes or every
    rows, limits = [], None
    for path in scenes:
        scene = load_scene(path)
        if scene.solver is None:
            continue
        name = f"`{path.stem}`"
        folder = options.runs / path.stem
        flow = run_paths(scene, folder).flow
        wanted = bool(options.scenes) or path.stem in SMALL
        try:
            if wanted and not options.only_done:
                run_chain(scene, workdir=folder, until="solve")
            if not flow.exists():
                rows.append([name, "", "", "not run here"])
                continue
            with open_series(flow, "flow") as series:
                verdict = read_verdict(series.extra, flow)
                sizes = [f"{series.n:,}", f"{series.extra.get('steps', 0):,}"]
        except PpmcError as error:
            rows.append([name, "", "", f"stopped: {error}"])
            continue
        if verdict is None:
            rows.append([name, *sizes, "no verdict in the file"])
            continue
        limits = verdict
        rows.append([name, *sizes, "passed" if verdict.passed else "**not passed**", *values(verdict)])
    page = "\n".join([HEAD, *table(rows, limits)]) + "\n"
    if options.output is None:
        print(page)
    else:
        options.output.write_text(page, encoding="utf-8")


def values(verdict: Verdict) -> list[str]:
    """Worst value of each limit, in bold where it was not kept."""
    texts = ["–" if f.value is None else f"{f.value:.3g}" for f in verdict.findings]
    return [text if f.kept else f"**{text}**" for f, text in zip(verdict.findings, texts, strict=True)]


def table(rows: list[list[str]], limits: Verdict | None) -> list[str]:
    """Lines of the table, one row a scene, and of a list of the reasons."""
    findings = () if limits is None else limits.findings
    heads = ["scene", "particles", "steps", "verdict"]
    heads += [f"{f.name}, {'≤' if f.bound == 'at most' else '≥'} {f.limit:g}" for f in findings]
    lines = [row_of([head.replace("|", "\\|") for head in heads]), row_of(["---"] * len(heads))]
    lines += [row_of([*row, *[""] * (len(heads) - len(row))]) for row in rows]
    return [*lines, "", *(f"- {f.name}: {f.reason}." for f in findings)]


def row_of(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
