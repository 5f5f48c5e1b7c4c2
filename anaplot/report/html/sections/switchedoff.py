"""What is switched off, and the protocol of re-measurements out of the journals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from anaplot.report.columns import counted
from anaplot.report.document import Answer, Document, Line, Table, named, say
from anaplot.report.html.parts import Captioned, HtmlBlock, Section
from anaplot.report.logcommand import local_time

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


def protocol_blocks(log: Document | None) -> tuple[HtmlBlock, ...]:
    """Return what was measured, when, and what was done again.

    Parameters
    ----------
    log
        The document of `log`; None: there is no journal.
    """
    blocks: list[HtmlBlock] = []
    if log is None:
        blocks.append(say("The block has no journal: it was not measured in a session."))
    elif not len(log.tables[0]):
        blocks.append(say("Nothing is journalled yet."))
    else:
        found = log.tables[0]
        blocks += [*_summary(found.records()), Captioned(found, say("What was done, in order"))]
    return tuple(blocks)


def _summary(rows: Sequence[Answer]) -> list[Line]:
    kinds = Counter(row["what"] for row in rows)
    done = [say("{} {}", kinds[what], words) for what, words in _KINDS.items() if what in kinds]
    who = list(dict.fromkeys(row["who"] or "nobody named" for row in rows))
    return [
        say(
            "From {} to {}, by {}.",
            local_time(rows[0]["time"]),
            local_time(rows[-1]["time"]),
            named(who, 12),
        ),
        say("{}.", named(done)),
    ]
