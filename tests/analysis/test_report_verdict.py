"""The verdict at the top of the report: passed, broken, or not known."""

from __future__ import annotations

from pathlib import Path

from ppmc.analysis.report.html import Document
from ppmc.analysis.report.verdict import verdict_table
from ppmc.analysis.stage import run
from ppmc.files.verdict import Finding, Verdict
from ppmc.scene import parse_scene

from .conftest import Chain

KEPT = Finding("cover", 0.9, 0.5, "at least", "1", "because", 0.2, "ram")
BROKEN = Finding("depth", 0.05, 0.02, "at most", "spacings", "since", 0.3, None, 17, (1.0, 2.0, 3.0))


def page_of(verdict: Verdict | None) -> str:
    page = Document("title")
    page.section("Verdict")
    verdict_table(page, verdict)
    return page.html()


def test_what_was_broken_is_a_note_and_a_marked_row() -> None:
    page = page_of(Verdict((KEPT, BROKEN)))
    assert '<p class="note">NOT PASSED: 1 of 2 limits not kept — depth: 0.05 spacings' in page
    assert '<td class="bad">NO</td>' in page and '<td class="good">yes</td>' in page
    assert "t = 0.3 s, particle 17, (1, 2, 3) mm" in page and "tool &#x27;ram&#x27;, t = 0.2 s" in page


def test_what_passed_is_no_note() -> None:
    page = page_of(Verdict((KEPT,)))
    assert "The flow passed: all 1 limits kept." in page
    assert 'class="note"' not in page


def test_a_flow_without_a_verdict_says_so_in_its_report(chain: Chain, tmp_path: Path) -> None:
    scene = parse_scene("name: bare\nanalysis: {views: []}\n")
    run(scene, input=chain.flow, output=tmp_path / "analysis.vtkhdf")
    assert "The flow file carries no verdict" in (tmp_path / "report.html").read_text()
