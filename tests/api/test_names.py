"""What ``import ppmc`` costs, and that every public name is there, documented and typed."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import ppmc

HEAVY = ("numpy", "numba", "scipy", "pandas", "pyvista", "vtk", "matplotlib", "h5py", "pydantic", "pint", "skimage")


def loaded(code: str) -> set[str]:
    """Return the modules that a fresh process has loaded after some code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


def test_importing_loads_nothing_heavy() -> None:
    found = loaded("import ppmc; dir(ppmc)")
    assert not found & set(HEAVY)
    assert {name for name in found if name.startswith("ppmc.")} == set()


def test_describing_a_squeeze_compiles_nothing() -> None:
    code = """
import ppmc
ppmc.tools.plane((0, 0, 0), (0, 0, 1)), ppmc.PlanarRandom(seed=1), ppmc.materials.Newtonian(shear_viscosity=1)
ppmc.solve, ppmc.Charge, ppmc.read"""
    assert not loaded(code) & {"numba", "scipy", "pandas", "pyvista", "vtk", "matplotlib", "h5py", "skimage"}


def test_every_public_name_is_there_for_users_and_editors() -> None:
    tree = ast.parse(Path(str(ppmc.__file__)).read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))  # what type checkers read
    typed = {alias.asname or alias.name for node in block.body for alias in node.names}  # type: ignore[attr-defined]
    assert typed == set(ppmc.__all__) - {"__version__"} == set(ppmc._HOMES)
    assert (Path(str(ppmc.__file__)).parent / "py.typed").exists()
    with pytest.raises(AttributeError, match="no attribute 'slove'"):
        _ = ppmc.slove


@pytest.mark.parametrize("name", sorted(set(ppmc.__all__) - {"__version__"}))
def test_every_public_name_is_documented(name: str) -> None:
    value = getattr(ppmc, name)
    assert inspect.getdoc(value)
    members = vars(value) if inspect.ismodule(value) else vars(value) if inspect.isclass(value) else {}
    for inner, member in members.items():
        if inner.startswith("_") or not (inspect.isfunction(member) or isinstance(member, property | classmethod)):
            continue
        if inspect.isfunction(member) and not member.__module__.startswith("ppmc"):
            continue
        assert inspect.getdoc(member), f"{name}.{inner}"
    if inspect.isfunction(value):
        text = inspect.getdoc(value) or ""
        assert all(f"\n{part}\n---" in text for part in ("Parameters", "Returns", "Raises", "Examples"))
        for parameter in inspect.signature(value).parameters:
            assert parameter in text, f"{name}({parameter})"
