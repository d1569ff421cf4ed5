"""Rules of the house: who may import whom, what stays light, what every stage offers."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / "ppmc"
STAGES = ("ct", "charge", "solver", "analysis")
CORE = ("scene", "files", "orientation", "geometry")
HEAVY = ("numba", "scipy", "pandas", "pyvista", "vtk", "matplotlib", "skimage", "meshio")


def imports(path: Path) -> Iterator[str]:
    """Yield every module that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def parts_of_ppmc(path: Path) -> set[str]:
    return {m.split(".")[1] for m in imports(path) if m.startswith("ppmc.")}


@pytest.mark.parametrize("stage", STAGES)
def test_stages_do_not_import_each_other(stage: str) -> None:
    files = list((ROOT / stage).rglob("*.py"))
    assert files
    for path in files:
        others = parts_of_ppmc(path) & (set(STAGES) - {stage} | {"chain", "cli"})
        assert not others, f"{path.relative_to(ROOT)} imports {others}"


@pytest.mark.parametrize("part", CORE)
def test_core_does_not_import_stages(part: str) -> None:
    for path in (ROOT / part).rglob("*.py"):
        others = parts_of_ppmc(path) & {*STAGES, "chain", "cli"}
        assert not others, f"{path.relative_to(ROOT)} imports {others}"


def test_the_import_scan_sees_imports() -> None:
    assert "ppmc.command_end" in set(imports(ROOT / "cli.py"))
    assert "ppmc.chain" in set(imports(ROOT / "cli.py"))


@pytest.mark.parametrize(
    "command", [(), ("ct",), ("phantom",), ("charge",), ("solve",), ("analyze",), ("run",), ("info",)]
)
def test_help_imports_nothing_heavy(command: tuple[str, ...]) -> None:
    code = f"""
import sys
sys.argv = ["ppmc", *{command!r}, "--help"]
from ppmc.cli import main
try:
    main()
except SystemExit as stop:
    assert stop.code in (0, None), stop.code
heavy = [m for m in {HEAVY!r} if m in sys.modules]
assert not heavy, heavy
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    if command:
        assert "Examples" in done.stdout or "ppmc " + command[0] in done.stdout
    else:
        for name in ("ct", "charge", "solve", "analyze", "run", "info", "check", "phantom"):
            assert name in done.stdout


def test_no_module_imports_numba_except_by_the_door() -> None:
    for path in ROOT.rglob("*.py"):
        if path.name != "compile_cache.py":
            direct = [m for m in imports(path) if m.split(".")[0] == "numba"]
            assert not direct, f"{path.relative_to(ROOT)}: use ppmc.compile_cache"
