"""Who measured which photo: a CSV file with photo,operator."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from anaplot.textfiles.csvtable import CsvTable
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import hint, quoted

__all__ = ["read_operators"]


def read_operators(path: Path, photos: Collection[str]) -> dict[str, str]:
    """Read the operators of photos.

    Parameters
    ----------
    path
        The file: columns photo and operator.
    photos
        Names of the photos there are.

    Returns
    -------
    dict
        Operator by photo, in file order.

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line.
    """
    found: dict[str, str] = {}
    lines: dict[str, int] = {}
    with CsvTable(path, ("photo", "operator"), ()) as table:
        column = table.columns
        for line, row in table:
            for name in ("photo", "operator"):
                fault = name_fault(row[column[name]])
                if fault is not None:
                    raise table.fail(line, f"{name} {quoted(row[column[name]])} {fault}")
            photo = row[column["photo"]]
            if photo not in photos:
                raise table.fail(
                    line,
                    f"unknown photo {quoted(photo)}{hint(photo, photos)}",
                )
            if photo in found:
                raise table.fail(
                    line, f"photo {quoted(photo)} stands in line {lines[photo]} already"
                )
            found[photo], lines[photo] = row[column["operator"]], line
        if not found:
            raise table.fail(None, "no rows")
    return found
