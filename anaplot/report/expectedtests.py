"""What the tests would say of errors in a planned network, as a part of its document."""

from __future__ import annotations

from dataclasses import replace

from anaplot.planning.expectedtests import ExpectedTests
from anaplot.report.document import BLANK, Answer, Block, Document, name, number, say, table

__all__ = ["with_expected_tests"]

_ERRORS = (
    name("where", "PHOTO:POINT", 12),
    name("axis", head="  "),
    number("um", "ERROR", 1, 8, unit="um"),
    number("r", "r", 3, 7),
    number("mdb_um", "MDB um", 1, 9, unit="um"),
    number("w", "w", 2, 7),
    number("power", "POWER", 3, 8),
)


def with_expected_tests(document: Document, found: ExpectedTests) -> Document:
    """Return a document that says what the tests would say of planted errors."""
    rows = table("planted", _ERRORS, found.single)
    answer: Answer = {
        "errors": rows,
        "noncentrality": found.noncentrality,
        "theta": found.theta,
        "power": found.power,
    }
    page: list[Block] = [
        BLANK,
        say("PLANTED ERRORS: what the tests say of each by itself, on average").of("heading"),
        rows,
    ]
    if found.theta is not None:
        page.append(
            say("together: lambda {noncentrality:.2f}, expected sigma0^2 {theta:.3f} (1978, "
                "Table 4)", **answer).folded(2)
        )  # fmt: skip
    if found.global_test is not None and found.power is not None:
        page.append(
            say("the global test (limit {:.3f}) notices them in {:.0f} % of the cases, and "
                "without them cries in {:.0f} %", found.global_test.critical,
                100.0 * found.power, 100.0 * found.global_test.alpha).folded(2)
        )  # fmt: skip
    return replace(
        document,
        answer=document.answer | {"planted": answer},
        page=(*document.page, *page),
        tables=(*document.tables, rows),
    )
