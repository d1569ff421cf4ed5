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
CORE = ("scene", "files", "orientation", "geometry", "materials", "walls")
CLIENTS = {"chain", "cli", "api", "tools"}  # what knows all stages, and what is for users alone
LAWS = ("materials", "walls")  # sections of scenes and laws of the solver in one file each
# Rooms of a part from the ground up: each builds on those before it only, and the part's own files on all of them.
ROOMS = {
    "geometry": ("surfaces", "tools", "cavity", "parts", "abaqus"),
    "charge": ("exchange", "orientations", "domains", "platelets", "figures"),
    "solver": ("particles", "walls", "sph", "linear", "step", "grid", "run", "forecast"),
    "analysis": ("averages", "flow", "mesh", "figures", "report"),
}
MOST_FILES = 12  # of a room, so that one sees at a glance what is in it
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
        others = parts_of_ppmc(path) & (set(STAGES) - {stage} | CLIENTS)
        assert not others, f"{path.relative_to(ROOT)} imports {others}"


@pytest.mark.parametrize("part", CORE)
def test_core_does_not_import_stages(part: str) -> None:
    for path in (ROOT / part).rglob("*.py"):
        others = parts_of_ppmc(path) & {*STAGES, *CLIENTS}
        assert not others, f"{path.relative_to(ROOT)} imports {others}"


@pytest.mark.parametrize("part", LAWS)
def test_laws_need_nothing_but_the_units_of_scenes(part: str) -> None:
    for path in (ROOT / part).rglob("*.py"):
        others = {m for m in imports(path) if m.startswith("ppmc.") and not m.startswith(f"ppmc.{part}")}
        assert all(m.startswith(("ppmc.scene.base", "ppmc.scene.units")) for m in others), f"{path.name}: {others}"


@pytest.mark.parametrize("part", ROOMS)
def test_rooms_build_on_the_rooms_below(part: str) -> None:
    rooms = ROOMS[part]
    assert {d.name for d in (ROOT / part).iterdir() if (d / "__init__.py").exists()} == set(rooms)
    for floor, room in enumerate(rooms):
        for path in (ROOT / part / room).rglob("*.py"):
            names = [m.split(".") for m in imports(path) if m.startswith(f"ppmc.{part}.")]
            above = {".".join(m[1:]) for m in names if m[2] in rooms[floor + 1 :]}
            assert not above, f"{path.relative_to(ROOT)} imports {above}"


@pytest.mark.parametrize("part", [*ROOMS, *LAWS])
def test_no_room_is_crowded(part: str) -> None:
    for folder in [ROOT / part, *(d for d in (ROOT / part).rglob("*") if d.is_dir())]:
        files = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        assert len(files) <= MOST_FILES, f"{folder.relative_to(ROOT)} has {len(files)} files"


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


@pytest.mark.parametrize("part", ROOMS)
def test_the_page_on_architecture_names_the_rooms_in_their_order(part: str) -> None:
    page = (ROOT.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith(f"| `{part}` |"))
    assert row.split("|")[2].replace("`", "").replace(" ", "").split(",") == list(ROOMS[part])
