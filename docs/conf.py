"""Sphinx configuration; the pages on files and scenes are generated from the tables that the code itself uses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ppmc import __version__
from ppmc.files.fields import AXES, FIELDS, MADE_BY, UNITS

project = "ppmc"
author = "The ppmc developers"
release = version = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
nb_execution_mode = "cache"
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
exclude_patterns = ["_build", "conf.py"]
html_theme = "furo"
html_title = f"ppmc {release}"

GENERATED = Path(__file__).parent / "_generated"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def write_field_tables() -> None:
    """Write the contract of every product as a page."""
    lines = ["# File contracts", "", f"Units: {UNITS}.", "", f"Order: {AXES}.", ""]
    for product, fields in FIELDS.items():
        lines += [f"## {product}", "", f"Made by `{MADE_BY[product]}`; one value a {fields[0].where}.", ""]
        head = ("field", "type", "components", "unit", "meaning", "required", "changes in time")
        lines += [_row(head), _row(["---"] * len(head))]
        for f in fields:
            moving = "no" if f.static or product not in ("flow", "analysis") else "yes"
            meaning = f.doc.replace("|", "/")
            required = "yes" if f.required else "no"
            lines.append(_row((f"`{f.name}`", f.dtype, str(f.components), f.unit, meaning, required, moving)))
        lines.append("")
    GENERATED.mkdir(exist_ok=True)
    (GENERATED / "files.md").write_text("\n".join(lines), encoding="utf-8")


write_field_tables()
