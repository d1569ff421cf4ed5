from __future__ import annotations

import pytest

from ppmc.analysis.report.html import Document, number


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.0000"), (0.12345, "0.1235"), (-2.5e-5, "-2.5e-05"), (3.14159, "3.1416"), (42.123, "42.12"),
        (19074.0, "19\u202f074.0"), (2.5e9, "2.500e+09"), (float("inf"), "∞"), (float("-inf"), "-∞"),
    ],
)  # fmt: skip
def test_numbers(value: float, text: str) -> None:
    assert number(value) == text


def test_nothing_of_a_user_becomes_markup() -> None:
    page = Document("<b>title</b>", "a & b")
    page.section("<i>")
    page.note("<script>alert(1)</script>")
    page.table(("a<", "b"), [["<td>", float("nan")], [("<", "bad"), 1234]], "<caption>")
    page.picture(b"png", '"><script>', "x")
    page.details("<s>", "</pre><script>")
    text = page.html("<footer>")
    assert "<script" not in text and "<i>" not in text and "<b>" not in text
    assert 'class="none">none' in text and "1\u202f234" in text
