"""What the search for gross errors rejected, in which order, on which evidence."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from anaplot.report.adjusterrors import rejected_table
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.columns import counted
from anaplot.report.document import Table, named, say
from anaplot.report.html.parts import Captioned, HtmlBlock, Section

__all__ = ["rejected_section"]

_MOST = 30  # points that are named
_ALWAYS = ("order", "kind", "error", "sigma", "unit", "w", "r")


def rejected_section(found: BlockAdjustment) -> Section:
    """Return the section of what was rejected, step by step where control came last."""
    return Section("rejected", "Rejected observations", tuple(_blocks(found)))


def _blocks(found: BlockAdjustment) -> Iterator[HtmlBlock]:
    if found.errors is None:
        yield say("No search for gross errors was asked for; --errors odds adds one.")
        return
    steps = [("", found.errors)]
    if found.errors_without_control is not None:
        steps = [("images, without control", found.errors_without_control.images),
                 ("control", found.errors)]  # fmt: skip
    for what, findings in steps:
        of = f" of the step: {what}" if what else ""
        if findings.points:
            yield say(
                "{} left out with all rays{}: they are far apart, and too little to tell which of "
                "them, or of their control, is wrong: {}",
                counted(len(findings.points), "point is", "points are"),
                of,
                named(findings.points, _MOST),
            )
        if not findings.rejected:
            yield say("Nothing is rejected{}.", of)
            continue
        yield Captioned(
            _told(rejected_table(findings.rejected)),
            say("Rejected by {}{}, in this order", findings.findings.strategy, of),
        )
    yield say(
        "error: what the observation is off by, with its standard deviation; w and r with it in; "
        "statistic: what the strategy compared with its critical value when it went; redundancy "
        "number and weight as the strategy had them then"
    )


def _told(rejected: Table) -> Table:
    """Return the columns that say something of these rows."""
    shown = tuple(
        column.key
        for column, values in zip(rejected.columns, rejected.values, strict=True)
        if column.key in _ALWAYS or any(value is not None for value in values)
    )
    return replace(rejected, shown=shown)
