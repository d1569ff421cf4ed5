"""The door to numba: compiled kernels kept in a cache folder keyed by the sources they came from.

Numba's own cache looks at the file a kernel stands in, not at the helpers it inlines from other modules, so an
edited helper would go on being used in its old form. Here each module's kernels have a folder of their own whose name
holds a digest of that module, of every ppmc module it imports, directly or not, and of the compiler: an edit that
could matter opens a new folder, and an edit elsewhere compiles nothing anew.
"""

from __future__ import annotations

import ast
import errno
import hashlib
import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ppmc.errors import SceneError

# Waiting threads sleep instead of spinning: on a shared machine a spinning thread takes the core from the one it waits
# for, and a small solve then costs several times its work.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # read by numba when it is loaded

import numba
from numba.extending import intrinsic

KEPT_FOLDERS = 3
FRESH_SECONDS = 24 * 3600.0
PACKAGE = Path(__file__).parent

prange = numba.prange


def njit(*args: Any, **options: Any) -> Callable[..., Any]:
    """Compile a kernel: `numba.njit` with the cache on and NumPy's division rules.

    Division by zero yields inf as in NumPy; the check that Python's rule needs would stop the loops from being
    vectorised (measured factor nine on the structure tensor's eigenvalues).
    """
    options.setdefault("cache", True)
    options.setdefault("error_model", "numpy")
    if args and callable(args[0]):
        return _compiled(args[0], options)
    return lambda function: _compiled(function, options, *args)


def _compiled(function: Callable[..., Any], options: dict[str, Any], *signatures: Any) -> Callable[..., Any]:
    """Hand a function to numba, its cache in the folder of its module."""
    given = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    if not given and options["cache"]:
        folder = _folder_of(function.__module__)
        options = options | {"cache": folder is not None}
        numba.config.CACHE_DIR = folder or ""  # type: ignore[attr-defined]
    try:
        return numba.njit(*signatures, **options)(function)
    finally:
        numba.config.CACHE_DIR = given  # type: ignore[attr-defined]


@intrinsic
def fma(context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return ``a * b + c`` of float32 numbers, rounded once: for kernels whose bits must not depend on the compiler.

    Where ``fastmath`` allows contraction, the compiler decides which product it joins to which sum, and may decide
    differently in a loop's body and in its remainder.
    """
    number = numba.types.float32

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return number(number, number, number), generate


def use_threads(count: int) -> None:
    """Let kernels use `count` threads; results do not depend on it.

    Raises
    ------
    SceneError
        If the machine does not have as many.
    """
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if not 1 <= count <= most:
        raise SceneError(f"--threads must be between 1 and {most} here, not {count}")
    numba.set_num_threads(count)


@cache
def _folder_of(module: str) -> str | None:
    """Return the cache folder of a module's kernels, None if there is no safe place; drop those long out of use."""
    root = _cache_root()
    if root is None:
        return None
    folder = root / f"{module}-{_digest_of(module)}"
    try:
        _make_own(folder)
        os.utime(folder)
        states = sorted(root.glob(f"{module}-*"), key=lambda f: f.stat().st_mtime, reverse=True)
        for stale in states[KEPT_FOLDERS:]:
            if time.time() - stale.stat().st_mtime > FRESH_SECONDS:
                shutil.rmtree(stale, ignore_errors=True)
    except OSError:
        return None
    return str(folder)


@cache
def _cache_root() -> Path | None:
    """Return the folder of all modules' kernels; None, said once, if none can be kept or trusted.

    Kernels are then compiled anew in each process: a read-only home is no reason to stop, and a folder that others can
    write to is none to load programs from.
    """
    try:
        base = os.environ.get("XDG_CACHE_HOME")
        given = Path(base) if base and Path(base).is_absolute() else Path.home() / ".cache"
        root = given / "ppmc" / "kernels"
        _make_own(root)
        for parent in root.resolve().parents:
            found = parent.stat()
            open_to_all = found.st_mode & stat.S_IWOTH and not found.st_mode & stat.S_ISVTX
            if found.st_uid not in (0, os.geteuid()) or open_to_all:
                raise PermissionError(errno.EPERM, "could be exchanged by other users", str(parent))
        with tempfile.TemporaryFile(dir=root):
            return root
    except (OSError, RuntimeError) as error:
        reason = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) else str(error)
        print(f"ppmc: compiled kernels cannot be kept ({reason}); every start takes longer", file=sys.stderr)
        return None


def _make_own(folder: Path) -> None:
    """Make a folder that nobody else can write to, or make sure that an existing one is.

    Kernels in it are loaded as pickles: whoever can write there runs programs in our name.

    Raises
    ------
    OSError
        If it is another user's, no folder, or cannot be made.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
        raise PermissionError(errno.EPERM, "is not a folder of this user", str(folder))
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        folder.chmod(stat.S_IMODE(found.st_mode) & ~(stat.S_IWGRP | stat.S_IWOTH))


def _digest_of(module: str) -> str:
    """Return a digest of a module, of all ppmc modules that it needs, and of the compiler."""
    digest = hashlib.sha256()
    for name in ("numba", "llvmlite", "numpy"):
        digest.update(f"{name}={version(name)};".encode())
    found: set[Path] = set()
    waiting = [source for source in [_source_of(module)] if source is not None]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting += _needs(source)
    for source in sorted(found):
        digest.update(source.relative_to(PACKAGE).as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _source_of(module: str) -> Path | None:
    """Return the file of a ppmc module, None if the name is no module of ppmc."""
    base = PACKAGE.joinpath(*module.split(".")[1:])
    for candidate in (base.with_suffix(".py"), base / "__init__.py"):
        if module.split(".")[0] == "ppmc" and candidate.is_file():
            return candidate
    return None


def _is_for_types(node: ast.AST) -> bool:
    """Tell whether a node is ``if TYPE_CHECKING:``, without an else."""
    return (
        isinstance(node, ast.If)
        and isinstance(node.test, ast.Name)
        and node.test.id == "TYPE_CHECKING"
        and not node.orelse
    )


@cache
def _needs(source: Path) -> tuple[Path, ...]:
    """Return the files of the ppmc modules that a file imports; imported names may be modules too."""
    wanted: list[str] = []
    tree = ast.parse(source.read_bytes())
    # What only type checkers import decides nothing, and leads from anywhere to everywhere.
    unseen = {inner for node in ast.walk(tree) if _is_for_types(node) for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if node in unseen:
            continue
        if isinstance(node, ast.Import):
            wanted += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            wanted += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(path for path in map(_source_of, wanted) if path is not None)
