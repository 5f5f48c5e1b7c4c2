"""A document's tables as CSV, each whole or not at all."""

from __future__ import annotations

import csv
import io
from typing import Any

from anaplot.report.document import Table, Values, is_array

__all__ = ["csv_text"]


def csv_text(table: Table) -> str:
    """Return a table with a heading of its keys.

    What does not exist is an empty cell, true and false are 1 and 0; a vector has a column for each
    component, and the items of a list stand in one cell with blanks between them.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    columns = dict(table.components())
    writer.writerow(columns)
    writer.writerows(zip(*map(_cells, columns.values()), strict=True))
    return text.getvalue()


def _cells(values: Values) -> list[Any]:
    if is_array(values):
        import numpy as np

        if values.dtype.kind == "b":
            values = values.astype(int)
        elif values.dtype.kind == "f" and np.isfinite(values).all():
            plain: list[Any] = values.tolist()
            return plain
        values = values.tolist()
    return [_cell(value) for value in values]


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return None if value != value else value
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return value
