"""How good something tested in micrometres is, and by which test: the same of models and plates."""

from __future__ import annotations

from typing import Any

from anaplot.adjustment.tested import TestedInMicrometres
from anaplot.report.document import Line, say

__all__ = ["sigma0_line", "test_line"]


def sigma0_line(of: TestedInMicrometres[Any]) -> Line:
    """Return the line of sigma0, a priori and estimated, and of the redundancy."""
    return say(
        "  sigma0    {0.sigma0_um:.2f|um|none}, a priori {0.apriori_um:g} um, "
        "redundancy {0.redundancy}",
        of,
    )


def test_line(of: TestedInMicrometres[Any]) -> Line:
    """Return the line of the test that flags its rows."""
    return say(
        "  test      {0.kind}, alpha {0.alpha:g}, critical value {0.critical:.2f||none}", of.test
    )
