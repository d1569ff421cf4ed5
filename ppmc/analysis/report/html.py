"""A self-contained HTML page: headings, text, tables and pictures in one file that needs no network."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; max-width: 1380px; margin: 2rem auto;
padding: 0 1.2rem; }
h1 { font-size: 1.7rem; margin-bottom: .2rem; } h2 { font-size: 1.25rem; margin-top: 2.4rem; border-bottom: 1px solid
#ccc; }
h3 { font-size: 1.05rem; margin-top: 1.6rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .86rem; margin: .6rem 0; }
th, td { padding: .2rem .5rem; border-bottom: 1px solid #ddd; text-align: right; white-space: nowrap; }
th { background: #f3f5f7; position: sticky; top: 0; } th:first-child, td:first-child, td.text, th.text { text-align:
left; }
td.none { color: #8a5a00; font-style: italic; } td.bad { background: #fde9d9; } td.good { background: #e3f1fa; }
.scroll { overflow-x: auto; max-width: 100%; }
figure { margin: 1rem 0; } figure img { max-width: 100%; height: auto; }
figcaption, caption { caption-side: bottom; text-align: left; color: #444; font-size: .86rem; max-width: 70rem;
white-space: normal; padding-top: .3rem; }
nav a { margin-right: 1rem; } .note { border-left: 4px solid #E69F00; background: #fdf6e6; padding: .5rem .8rem;
margin: .6rem 0; }
pre { background: #f6f6f6; padding: .8rem; overflow-x: auto; font-size: .8rem; } footer { margin-top: 3rem; color:
#666; font-size: .8rem; }
"""


class Document:
    """A page that grows from top to bottom.

    Parameters
    ----------
    title : str
        Heading of the page.
    lead : str
        One sentence under it.
    """

    def __init__(self, title: str, lead: str = "") -> None:
        self.title = title
        self._lead = lead
        self._body: list[str] = []
        self._sections: list[tuple[str, str]] = []

    def section(self, title: str) -> None:
        """Begin a section, which the page's menu links to."""
        anchor = f"s{len(self._sections) + 1}"
        self._sections.append((anchor, title))
        self._body.append(f'<h2 id="{anchor}">{escape(title)}</h2>')

    def subsection(self, title: str) -> None:
        """Begin a part of a section."""
        self._body.append(f"<h3>{escape(title)}</h3>")

    def text(self, words: str) -> None:
        """Add a paragraph."""
        self._body.append(f"<p>{escape(words)}</p>")

    def note(self, words: str) -> None:
        """Add a paragraph that must not be overlooked."""
        self._body.append(f'<p class="note">{escape(words)}</p>')

    def table(self, columns: Sequence[str], rows: Iterable[Sequence[Any]], caption: str = "") -> None:
        """Add a table; numbers are shortened, what is missing is said to be so, (text, class) pairs are coloured."""
        rows = [list(row) for row in rows]
        words = [any(isinstance(row[k], str) for row in rows) for k in range(len(columns))]
        head = "".join(
            f'<th class="text">{escape(c)}</th>' if word else f"<th>{escape(c)}</th>"
            for c, word in zip(columns, words, strict=True)
        )
        body = "".join(f"<tr>{''.join(_cell(v) for v in row)}</tr>" for row in rows)
        foot = f"<caption>{escape(caption)}</caption>" if caption else ""
        self._body.append(
            f'<div class="scroll"><table>{foot}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
        )

    def picture(self, image: bytes, caption: str, name: str = "", kind: str = "png") -> None:
        """Add a picture (PNG unless named otherwise), kept inside the page."""
        data = base64.b64encode(image).decode("ascii")
        self._body.append(
            f'<figure id="{escape(name)}"><img alt="{escape(caption)}" src="data:image/{kind};base64,{data}">'
            f"<figcaption>{escape(caption)}</figcaption></figure>"
        )

    def details(self, summary: str, text: str) -> None:
        """Add long text that opens on a click."""
        self._body.append(f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>")

    def pairs(self, values: Mapping[str, Any]) -> None:
        """Add names and values as a two-column table."""
        self.table(("", "value"), list(values.items()))

    def html(self, footer: str = "") -> str:
        """Return the whole page."""
        menu = "".join(f'<a href="#{anchor}">{escape(title)}</a>' for anchor, title in self._sections)
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{STYLE}</style></head><body>"
            f"<h1>{escape(self.title)}</h1><p>{escape(self._lead)}</p><nav>{menu}</nav>{''.join(self._body)}"
            f"<footer>{escape(footer)}</footer></body></html>\n"
        )


def _cell(value: Any) -> str:
    style = ""
    if isinstance(value, tuple):
        value, style = value
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return '<td class="none">none</td>'
    if isinstance(value, float):
        text = number(value)
    elif isinstance(value, int) and not isinstance(value, bool):
        text = f"{value:,}".replace(",", "\u202f")
    else:
        text = str(value)
        style = style or "text"
    return f'<td class="{style}">{escape(text)}</td>' if style else f"<td>{escape(text)}</td>"


def number(value: float) -> str:
    """Return a number as a table shows it: four decimals below ten, fewer above, powers of ten far from one."""
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    size = abs(value)
    if size >= 1e6:
        return f"{value:.3e}"
    if size >= 1e3:
        return f"{value:,.1f}".replace(",", "\u202f")
    if size >= 10:
        return f"{value:.2f}"
    # Below the last decimal shown, a power of ten still tells round-off from zero.
    return f"{value:.4f}" if size >= 5e-5 or size == 0 else f"{value:.1e}"
