"""The verdict of the flow, at the top of the report."""

from __future__ import annotations

from ppmc.analysis.report.html import Document
from ppmc.files.verdict import Finding, Verdict


def verdict_table(page: Document, verdict: Verdict | None) -> None:
    """Add what the flow says about itself: whether it can be believed, and each limit with its worst value."""
    if verdict is None:
        page.note(
            "The flow file carries no verdict: its run has not come to its end, or an older version wrote it. Nothing "
            "says whether its limits were kept."
        )
        return
    if verdict.passed:
        page.text(f"The flow {verdict.headline}.")
    else:
        page.note(f"{verdict.headline} — {'; '.join(finding.told() for finding in verdict.broken)}.")
    page.table(
        ("limit", "kept", "worst value", "bound", "unit", "where", "why this bound"),
        [_row(finding) for finding in verdict.findings],
        "What ppmc solve measured in every step, and the worst of it. Every step is in the flow file under "
        "ppmc/history.",
    )


def _row(finding: Finding) -> list[object]:
    kept = ("yes", "good") if finding.kept else ("NO", "bad")
    unit = "–" if finding.unit == "1" else finding.unit
    value = "not measured" if finding.value is None else f"{finding.value:.4g}"
    return [
        finding.name, kept, value, f"{finding.bound} {finding.limit:.4g}", unit, finding.place or "–", finding.reason,
    ]  # fmt: skip
