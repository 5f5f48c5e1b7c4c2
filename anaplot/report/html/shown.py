"""Tables of which a page shows a part."""

from __future__ import annotations

from dataclasses import replace

from anaplot.report.document import Table

__all__ = ["first_rows"]


def first_rows(table: Table, count: int) -> Table:
    """Return the first rows of a table."""
    return replace(table, source=lambda: tuple(values[:count] for values in table.values))
