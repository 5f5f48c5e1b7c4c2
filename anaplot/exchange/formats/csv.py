"""Results as CSV: a folder with photos.csv, points.csv, image_points.csv and what else there is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anaplot.exchange.formats.door import Exported, Exporting
from anaplot.exchange.formats.resulttables import result_tables
from anaplot.textfiles.csvtable import csv_text
from anaplot.textfiles.wholefile import all_or_nothing, create_whole, make_folder

__all__ = ["write"]


def write(exporting: Exporting, target: Path) -> Exported:
    """Write the tables, as `adjust --to` has them; what does not exist is an empty cell."""
    tables, notes = result_tables(exporting)
    files = []
    with all_or_nothing():
        make_folder(target)
        for table in tables:
            names = [column.name for column in table.columns]
            rows = zip(*(map(_cell, column.values) for column in table.columns), strict=True)
            path = target / f"{table.name}.csv"
            create_whole(path, csv_text(names, rows).encode())
            files.append(path)
    return Exported(tuple(files), notes)


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else value
