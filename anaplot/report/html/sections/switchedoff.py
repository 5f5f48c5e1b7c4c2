"""What is switched off, and the protocol of re-measurements out of the journals."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from anaplot.report.columns import counted
from anaplot.report.document import (
    Answer,
    Column,
    Document,
    Line,
    Table,
    Values,
    named,
    say,
)
from anaplot.report.html.parts import Captioned, HtmlBlock, Section
from anaplot.report.html.times import time_column, utc
from anaplot.report.places import at_places

__all__ = ["protocol_blocks", "switched_off_section"]

_KINDS = {
    "measured": "measured",
    "remeasured": "measured again",
    "renamed": "renamed",
    "off": "switched off",
    "on": "switched on",
    "added": "points added",
    "oriented": "inner orientations accepted",
    "accepted": "models accepted",
    "reopened": "models reopened",
    "undone": "taken back",
}
_FIRST = ("measured", "added", "oriented")  # nothing was there before: no change of anything


def switched_off_section(answer: Answer) -> Section:
    """Return the section of what persons have switched off.

    Parameters
    ----------
    answer
        What `adjust --json` prints, its tables still tables.
    """
    off: Table = answer["off"]
    blocks: list[HtmlBlock] = []
    if len(off):
        reasons = Counter(row["reason"] or "no reason given" for row in off.records())
        words = [say("{} ({})", why, count) for why, count in reasons.most_common()]
        blocks += [
            say("{} switched off: {}", counted(len(off), "row is", "rows are"), named(words, 12)),
            Captioned(off, say("Rows that are switched off, and the residuals they would have")),
        ]
    else:
        blocks.append(say("Nothing is switched off."))
    return Section("off", "Switched off, and why", tuple(blocks))


def protocol_blocks(log: Document | None, folder: str = "BLOCK") -> tuple[HtmlBlock, ...]:
    """Return how much was measured, when and by whom, and everything that was changed after that.

    Parameters
    ----------
    log
        The document of `log`; None: there is no journal.
    folder
        As the command line names the block.
    """
    blocks: list[HtmlBlock] = []
    if log is None:
        blocks.append(say("The block has no journal: it was not measured in a session."))
    elif not len(log.tables[0]):
        blocks.append(say("Nothing is journalled yet."))
    else:
        found = log.tables[0]
        blocks += _summary(found)
        again = _again(found)
        if len(again):
            words = "What was measured again, switched, renamed, accepted or reopened, in order"
            blocks.append(Captioned(again, say(words)))
        else:
            blocks.append(say("Nothing was measured again, switched, renamed, or accepted."))
        left = len(found) - len(again)
        if left:
            blocks.append(
                say(
                    "{} of what was measured for the first time and of inner orientations not "
                    "repeated here: `anaplot log {}` has every change, with --csv as a table",
                    counted(left, "row is", "rows are"),
                    folder,
                )
            )
    return tuple(blocks)


def _again(log: Table) -> Table:
    """Return the rows of a log that change what was there before; times in UTC."""
    rows = [k for k, what in enumerate(_values(log, "what")) if what not in _FIRST]
    cells = [at_places(values, rows) for values in log.values]
    some = [
        (_column(column), values)
        for column, values in zip(log.columns, cells, strict=True)
        if any(value is not None for value in values)
    ]
    columns, left = tuple(column for column, _ in some), tuple(values for _, values in some)
    return replace(log, columns=columns, source=lambda: left)


def _column(column: Column) -> Column:
    """Return a column of the protocol: in it every row was done again, none stands out for that."""
    if column.key == "time":
        return time_column("TIME")
    # two numbers stand in one line
    return replace(column, look=None, align=">" if column.parts else column.align)


def _values(log: Table, key: str) -> Values:
    return log.values[[column.key for column in log.columns].index(key)]


def _summary(log: Table) -> list[Line]:
    kinds = Counter(_values(log, "what"))
    done = [say("{} {}", kinds[what], words) for what, words in _KINDS.items() if what in kinds]
    who = list(dict.fromkeys(one or "nobody named" for one in _values(log, "who")))
    times = _values(log, "time")
    return [
        say("From {} to {} UTC, by {}.", utc(times[0]), utc(times[-1]), named(who, 12)),
        say("{}.", named(done)),
    ]
