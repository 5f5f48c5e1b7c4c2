"""Results as CSV: a folder with photos.csv, points.csv, image_points.csv and what else there is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anaplot.exchange.formats.door import Exported, Exporting, ResultTable
from anaplot.exchange.formats.resulttables import result_tables
from anaplot.textfiles.csvtable import csv_text
from anaplot.textfiles.wholefile import create_folder

__all__ = ["write"]


def write(exporting: Exporting, target: Path) -> Exported:
    """Write the tables, as `adjust --to` has them; what does not exist is an empty cell."""
    tables, notes = result_tables(exporting)
    files = ((f"{table.name}.csv", _text(table).encode()) for table in tables)
    return Exported(create_folder(target, files), notes)


def _text(table: ResultTable) -> str:
    names = [column.name for column in table.columns]
    rows = zip(*(map(_cell, column.values) for column in table.columns), strict=True)
    return csv_text(names, rows)


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else value
