"""The kernel cache: keyed by all sources, kept out of the way."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

CODE = "import ppmc.compile_cache, os; print(os.environ['NUMBA_CACHE_DIR'])"


def cache_dir(package: Path, env: dict[str, str]) -> str:
    import os

    base = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=package, env=base | env, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_an_edit_anywhere_opens_a_new_folder(tmp_path: Path) -> None:
    package = tmp_path / "src" / "ppmc"
    (package / "solver").mkdir(parents=True)
    source = Path(__file__).parents[2] / "ppmc"
    for name in ("__init__.py", "compile_cache.py", "errors.py"):
        (package / name).write_text((source / name).read_text())
    helper = package / "solver" / "helper.py"
    helper.write_text("x = 1\n")
    env = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(package.parent)}
    first = cache_dir(package.parent, env)
    assert first.startswith(str(tmp_path / "cache"))
    assert cache_dir(package.parent, env) == first
    helper.write_text("x = 2\n")
    assert cache_dir(package.parent, env) != first


def test_division_by_zero_follows_numpy() -> None:
    from ppmc.compile_cache import njit

    @njit(cache=False)
    def divide(a: float, b: float) -> float:
        return a / b

    assert divide(1.0, 0.0) == float("inf")
