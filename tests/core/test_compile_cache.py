"""The kernel cache: keyed by the sources that matter, kept out of the way."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CODE = "import ppmc.solver.kernel as k; print(k.twice(4.0)); print(k.twice.stats.cache_path)"
HITS = "import ppmc.solver.kernel as k; k.twice(4.0); print(len(k.twice.stats.cache_hits), k.twice.stats.cache_path)"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of the same name with one kernel, its helper, and a module it does not need."""
    package = tmp_path / "src" / "ppmc"
    (package / "solver").mkdir(parents=True)
    source = Path(__file__).parents[2] / "ppmc"
    for name in ("__init__.py", "compile_cache.py", "errors.py"):
        (package / name).write_text((source / name).read_text())
    (package / "solver" / "__init__.py").write_text("")
    (package / "solver" / "other.py").write_text("x = 1\n")
    (package / "solver" / "constants.py").write_text("FACTOR = 2.0\n")
    (package / "solver" / "helper.py").write_text(
        "from ppmc.compile_cache import njit\nfrom ppmc.solver import constants\nF = constants.FACTOR\n"
        "@njit\ndef times(x):\n    return F * x\n"
    )
    (package / "solver" / "kernel.py").write_text(
        "from ppmc.compile_cache import njit\nfrom ppmc.solver.helper import (\n    times,\n)\n"
        "@njit\ndef twice(x):\n    return times(x)\n"
    )
    return package


def run(package: Path, code: str = CODE, cache: Path | None = None, **processor: str) -> tuple[float, str]:
    given = ("NUMBA_CACHE_DIR", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
    env = {k: v for k, v in os.environ.items() if k not in given} | processor
    env |= {"XDG_CACHE_HOME": str(cache or package.parents[1] / "cache"), "PYTHONPATH": str(package.parent)}
    env["PYTHONDONTWRITEBYTECODE"] = "1"  # an edit of the same size in the same second would be overlooked
    done = subprocess.run([sys.executable, "-c", code], cwd=package.parent, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    value, path = done.stdout.split()
    return float(value), path


def test_an_edit_that_matters_compiles_anew(package: Path) -> None:
    value, first = run(package)
    assert value == 8.0 and first.startswith(str(package.parents[1] / "cache"))
    (package / "solver" / "other.py").write_text("x = 2\n")
    assert run(package) == (8.0, first)
    # A constant two imports away: numba alone would go on with the old value.
    (package / "solver" / "constants.py").write_text("FACTOR = 3.0\n")
    value, second = run(package)
    assert value == 12.0 and second != first


def test_each_processor_has_kernels_of_its_own(package: Path) -> None:
    """A home that several machines share must not hand one the instructions of another."""
    baseline = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    hits, folder = run(package, HITS)
    assert (hits, run(package, HITS)[0]) == (0, 1)
    assert run(package, HITS, **baseline) == (0, folder)
    assert run(package, HITS, **baseline) == (1, folder)
    assert run(package, HITS) == (1, folder)


@pytest.mark.parametrize("who", ["another user", "everybody"])
def test_a_folder_that_others_can_write_to_is_not_read(package: Path, tmp_path: Path, who: str) -> None:
    """Cached kernels are pickles: whoever writes them runs programs in our name."""
    cache = tmp_path / "shared"
    (cache / "ppmc" / "kernels").mkdir(parents=True)
    if who == "everybody":
        cache.chmod(0o777)
    elif os.geteuid() == 0:
        os.chown(cache / "ppmc" / "kernels", 12345, 12345)
    else:
        pytest.skip("only root can give a folder away")
    value, path = run(package, cache=cache)
    assert value == 8.0 and path == "None"
    assert not list((cache / "ppmc" / "kernels").iterdir())


def test_a_folder_open_to_a_group_is_closed(package: Path, tmp_path: Path) -> None:
    (tmp_path / "cache" / "ppmc" / "kernels").mkdir(parents=True)
    (tmp_path / "cache" / "ppmc" / "kernels").chmod(0o777)
    value, path = run(package, cache=tmp_path / "cache")
    assert value == 8.0 and path.startswith(str(tmp_path / "cache"))
    assert all(p.stat().st_mode & 0o022 == 0 for p in (tmp_path / "cache" / "ppmc" / "kernels").iterdir())
    assert (tmp_path / "cache" / "ppmc" / "kernels").stat().st_mode & 0o022 == 0


def test_division_by_zero_follows_numpy() -> None:
    from ppmc.compile_cache import njit

    @njit(cache=False)
    def divide(a: float, b: float) -> float:
        return a / b

    assert divide(1.0, 0.0) == float("inf")


def test_every_kernel_module_is_found() -> None:
    from ppmc.compile_cache import PACKAGE, _digest_of, _needs, _source_of

    assert _source_of("numpy") is None and _source_of("ppmc.errors") == PACKAGE / "errors.py"
    assert PACKAGE / "errors.py" in _needs(PACKAGE / "compile_cache.py")
    assert len({_digest_of("ppmc.errors"), _digest_of("ppmc.compile_cache")}) == 2
