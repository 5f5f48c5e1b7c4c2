"""How tests of hypotheses are written: a line of cells each, and a mapping for programs."""

from __future__ import annotations

from typing import Any

from anaplot.adjustment.hypothesis import FTest
from anaplot.bundle.hypotheses.verdict import Verdict
from anaplot.report.document import Line, say

__all__ = ["TEST_HEAD", "labelled", "probability", "verdict_cells", "verdict_json"]

TEST_HEAD = f"{'b':>5}{'r':>7}{'T':>10}{'critical':>10}{'P':>9}"


def probability(value: float) -> str:
    """Return a probability in at most seven characters."""
    if value <= 0.0:
        return "<1e-300"
    return f"{value:.4f}" if value >= 1e-4 else f"{value:.0e}"


def verdict_cells(test: FTest | None) -> Line:
    """Return the cells of a test under `TEST_HEAD`."""
    if test is None:
        return say("{}", " " * len(TEST_HEAD))
    return say(
        "{:5c}{:7c}{:10.3c}{:10.3c}{:9c}",
        test.dimension,
        "known" if test.redundancy is None else test.redundancy,
        test.statistic,
        test.critical,
        probability(test.significance),
    )


def labelled(label: str, width: int) -> Line:
    """Return the label at the left of a line."""
    return say("  {:<{width}}", label, width=width)


def _test_json(test: FTest | None) -> dict[str, Any] | None:
    return None if test is None else {**test._asdict(), "rejected": test.rejected}


def verdict_json(verdict: Verdict | None) -> dict[str, Any] | None:
    """Return a test with the estimated and with the known sigma; None without one."""
    if verdict is None:
        return None
    return {
        "rejected": verdict.rejected,
        "estimated": _test_json(verdict.estimated),
        "known": _test_json(verdict.known),
    }
