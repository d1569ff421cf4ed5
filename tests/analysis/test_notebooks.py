"""Every notebook of the docs runs and keeps its own promises (each ends in assertions)."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
SLOW = {"ct_validation"}  # compiles the kernels of the CT stage


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(path.stem, marks=pytest.mark.slow if path.stem in SLOW else ())
        for path in sorted(FOLDER.glob("*.py"))
    ],
)
def test_notebook(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(FOLDER / f"{name}.py"))


def test_index_lists_every_notebook() -> None:
    listed = (FOLDER / "index.md").read_text().splitlines()
    assert {path.stem for path in FOLDER.glob("*.py")} <= set(listed)
