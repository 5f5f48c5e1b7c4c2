"""`anaplot log`: who changed what, when, from the journal."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from datetime import datetime
from functools import partial

from anaplot.aliases import Progress
from anaplot.report.document import Document, Later, Table, name, number, say
from anaplot.report.journalnote import SessionFiles, with_journal_notes
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.report.streams import complain
from anaplot.session.changes import Change
from anaplot.station.sessionlog import SessionLog

__all__ = ["local_time", "log_document", "run_log"]


def local_time(time: str) -> str:
    """Return a time of the journal as the clock on the wall, with its zone."""
    return datetime.fromisoformat(time).astimezone().isoformat(sep=" ", timespec="seconds")


def _xy(value: tuple[float, float] | None) -> str:
    return "" if value is None else f"{value[0]:.4f} {value[1]:.4f}"


def _again(what: str) -> bool:
    # a first measurement is no change of anything: a long log shows what was done again
    return what not in ("measured", "oriented")


_POINT = name("point", "POINT", 5, none="")
# stands where anything was renamed
_NAME = name("name", "IS NOW", 6, none="")
_CHANGES = (
    name("time", "TIME", 25, form=local_time, gap=0),
    name("who", "WHO", 3, none=""),
    name("what", "WHAT", 10, look=_again),
    name("model", "MODEL", 5, none=""),
    name("photo", "PHOTO", 5, none=""),
    _POINT,
    name("axis", "AXIS", 4, none=""),
    replace(name("old", "OLD [mm]", 8, form=_xy, none=""), parts=("x", "y")),
    replace(name("new", "NEW [mm]", 8, form=_xy, none=""), parts=("x", "y")),
    name("reason", "REASON", 6, none=""),
    number("w_before", "w BEFORE", 2, 10),
    number("w_after", "AFTER", 2, 8),
)


def run_log(options: argparse.Namespace) -> int:
    """Print the changes of a block and return the exit code.

    Raises
    ------
    InputError
        The journal cannot be read, or does not fit its block.
    """
    output = Output.of(options)
    output.check({"is read": (options.session,)})
    with working("reading the journal"):
        files = SessionFiles(options.session)
        log = SessionLog(options.session)
        found = log_document(log.read(), partial(working, "computing w"))
        found = with_journal_notes(found, files.note(log))
    for remark in log.remarks:
        complain(f"note: {remark}")
    output.show(found)
    return 0


def _silent() -> AbstractContextManager[Progress]:
    return nullcontext(lambda what, fraction: None)


def log_document(
    changes: Sequence[Change], working: Callable[[], AbstractContextManager[Progress]] = _silent
) -> Document:
    """Return the document of changes, the oldest first.

    Parameters
    ----------
    changes
        All of them.
    working
        Shows how far the computation of w has come: of many changes few are shown, and only for
        these it is done, when they are.
    """
    renamed = any(one.name for one in changes)
    rows = [
        (
            one.time,
            one.who or None,
            one.what,
            one.model or None,
            one.photo or None,
            one.point or None,
            *((one.name or None,) if renamed else ()),
            one.axis or None,
            one.old,
            one.new,
            one.reason or None,
        )
        for one in changes
    ]
    at = _CHANGES.index(_POINT) + 1
    columns = (*_CHANGES[:at], *((_NAME,) if renamed else ()), *_CHANGES[at:])
    known = tuple(zip(*rows, strict=True)) or ((),) * (len(columns) - 2)
    w = (_sizes(changes, which, working) for which in range(2))
    found = Table("changes", columns, (*known, *w))
    if not rows:
        return Document({"changes": found}, (say("nothing is journalled yet"),), (found,))
    return Document({"changes": found}, (found,), (found,))


def _sizes(
    changes: Sequence[Change], which: int, working: Callable[[], AbstractContextManager[Progress]]
) -> Later[float | None]:
    def values(places: Sequence[int]) -> list[float | None]:
        found = []
        with working() as tell:
            for k in places:
                tell("computing w", (k + 1) / len(changes))
                found.append(changes[k].w.both[which])
        return found

    return Later(len(changes), values)
