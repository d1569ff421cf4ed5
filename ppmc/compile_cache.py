"""The door to numba: compiled kernels kept in a cache folder keyed by the sources they came from.

Numba's own cache looks at the file a kernel stands in, not at the helpers it inlines from other modules, so an
edited helper would go on being used in its old form. Here the cache folder's name holds a digest of every ppmc
source and of the numba and numpy versions: an edit anywhere opens a new folder.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

KEPT_FOLDERS = 4
FRESH_SECONDS = 24 * 3600.0


def _source_digest() -> str:
    """Return a digest of all ppmc sources and of the compiler's version."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for name in ("numba", "llvmlite", "numpy"):
        digest.update(f"{name}={version(name)};".encode())
    for source in sorted(root.rglob("*.py")):
        digest.update(source.relative_to(root).as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    """Return the folder that holds one cache folder for each state of the sources."""
    base = os.environ.get("XDG_CACHE_HOME")
    if base:
        return Path(base) / "ppmc" / "kernels"
    try:
        return Path.home() / ".cache" / "ppmc" / "kernels"
    except RuntimeError:
        import tempfile

        return Path(tempfile.gettempdir()) / f"ppmc-kernels-{os.getuid()}"


def _open_cache() -> None:
    """Point numba to the folder of this source state, and drop folders long out of use."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    root = _cache_root()
    folder = root / _source_digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        old = sorted((f for f in root.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime, reverse=True)
        for stale in old[KEPT_FOLDERS:]:
            if time.time() - stale.stat().st_mtime > FRESH_SECONDS:
                shutil.rmtree(stale, ignore_errors=True)
    except OSError:
        # A read-only home is no reason to stop: kernels are then compiled anew in each process.
        import tempfile

        folder = Path(tempfile.mkdtemp(prefix="ppmc-kernels-"))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


_open_cache()

import numba  # noqa: E402  (must come after NUMBA_CACHE_DIR is set)

from ppmc.errors import SceneError  # noqa: E402

prange = numba.prange


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


def njit(*args: Any, **options: Any) -> Callable[..., Any]:
    """Compile a kernel: `numba.njit` with the cache on and NumPy's division rules.

    Division by zero yields inf as in NumPy; the check that Python's rule needs would stop the loops from being
    vectorised (measured factor nine on the structure tensor's eigenvalues).
    """
    options.setdefault("cache", True)
    options.setdefault("error_model", "numpy")
    if args and callable(args[0]):
        return numba.njit(**options)(args[0])
    return numba.njit(*args, **options)
