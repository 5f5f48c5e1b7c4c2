"""A file of movements that displacements between epochs are tested against."""

from __future__ import annotations

from pathlib import Path

from anaplot.photogrammetry.givenmovement import GivenMovement
from anaplot.textfiles.csvtable import CsvColumns, read_csv
from anaplot.textfiles.kinds import METRES, NAME, Blank, Number
from anaplot.textfiles.wording import place

__all__ = ["read_given_movement"]

_EPOCH = Number(1.0, 1000.0)


def read_given_movement(path: Path) -> tuple[GivenMovement, ...]:
    """Read movements: columns point, dX, dY, dZ [m], and, of more than two epochs, from and to.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line: a row twice; one of from and to alone;
        epochs that do not follow each other.
    """
    table = read_csv(
        path,
        {"point": NAME, "dX": METRES, "dY": METRES, "dZ": METRES},
        {"from": Blank(_EPOCH), "to": Blank(_EPOCH)},
    )
    if not len(table):
        raise table.fail(None, None, "no rows")
    out = []
    columns = (table[name] for name in ("point", "from", "to", "dX", "dY", "dZ"))
    for row, (point, start, end, x, y, z) in enumerate(zip(*columns, strict=True)):
        first, second = (_number(table, row, *named) for named in (("from", start), ("to", end)))
        if (first is None) != (second is None):
            raise table.fail(row, None, "from and to go together")
        if first is not None and second is not None and not first < second:
            raise table.fail(row, "to", f"{second} is no later epoch than {first}")
        out.append(GivenMovement(point, first, second, (x, y, z), place(path, table.line(row))))
    table.refuse_twice("point", "from", "to")
    return tuple(out)


def _number(table: CsvColumns, row: int, column: str, value: float | None) -> int | None:
    if value is not None and value != int(value):
        raise table.fail(row, column, f"epochs are numbered 1, 2, 3: there is no {value:g}")
    return None if value is None else int(value)
