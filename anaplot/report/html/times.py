"""Times of journals on a page: in UTC and to the second, so that they stand in one line."""

from __future__ import annotations

from datetime import UTC, datetime

from anaplot.report.document import Column

__all__ = ["time_column", "utc"]


def utc(time: str) -> str:
    """Return a time of the journal as the clock of UTC has it, without its zone."""
    return datetime.fromisoformat(time).astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S")


def time_column(title: str) -> Column:
    """Return a column of times, `time`; at the right as numbers are, which no cell parts."""
    return Column("time", f"{title} (UTC)", 21, form=utc, none="")
