"""distances.csv and conditions.csv: what is known of points of the object together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from anaplot.photogrammetry.objectconditions import ObjectCondition, condition_fault
from anaplot.textfiles.csvtable import CsvColumns, csv_text, read_csv
from anaplot.textfiles.kinds import METRES, NAME, NUMBER, SIGMA_OR_FREE, Blank, Text, Word

__all__ = [
    "CONDITIONS_CSV",
    "DISTANCES_CSV",
    "format_distances",
    "parse_conditions",
    "parse_distances",
]

DISTANCES_CSV = "distances.csv"
CONDITIONS_CSV = "conditions.csv"

_USE = Blank(Word("control", "check", "off"))
_MOST_NAMES = 100_000  # characters of a row's points


def parse_distances(path: Path) -> tuple[ObjectCondition, ...]:
    """Read a distances.csv.

    Parameters
    ----------
    path
        The file, with columns from,to,distance,sigma and perhaps use; metres.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    table = read_csv(
        path, {"from": NAME, "to": NAME, "distance": METRES, "sigma": SIGMA_OR_FREE}, {"use": _USE}
    )
    columns = (table[name] for name in ("from", "to", "distance", "sigma", "use"))
    rows = (
        ObjectCondition("distance", (one, other), value, sigma, use or "control")
        for one, other, value, sigma, use in zip(*columns, strict=True)
    )
    return tuple(_checked(path, table, rows))


def format_distances(distances: Iterable[ObjectCondition]) -> str:
    """Return the text of a distances.csv; raises ValueError for another kind of condition."""
    rows = list(distances)
    if any(row.kind != "distance" for row in rows):
        raise ValueError("conditions that are no distances")
    return csv_text(
        ("from", "to", "distance", "sigma", "use"),
        ((*row.points, row.value, row.sigma, row.use) for row in rows),
    )


def parse_conditions(path: Path) -> tuple[ObjectCondition, ...]:
    """Read a conditions.csv.

    Parameters
    ----------
    path
        The file, with columns kind,points,value,sigma and perhaps use: kind line, plane, angle or
        equal, names of points separated by blanks, metres and radians.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    table = read_csv(
        path,
        {
            "kind": Word("line", "plane", "angle", "equal"),
            "points": Text(_MOST_NAMES, empty=False),
            "value": Blank(NUMBER),
            "sigma": SIGMA_OR_FREE,
        },
        {"use": _USE},
    )
    columns = (table[name] for name in ("kind", "points", "value", "sigma", "use"))
    rows = (
        ObjectCondition(kind, tuple(points.split()), value, sigma, use or "control")
        for kind, points, value, sigma, use in zip(*columns, strict=True)
    )
    return tuple(_checked(path, table, rows))


def _checked(
    path: Path, table: CsvColumns, rows: Iterator[ObjectCondition]
) -> Iterator[ObjectCondition]:
    """Give conditions the place that they stand in; raises InputError where one is none."""
    for row, one in enumerate(rows):
        fault = condition_fault(one.kind, one.points, one.value)
        if fault is not None:
            raise table.fail(row, None, fault)
        where = f"{path.name}:{table.line(row)}"
        yield ObjectCondition(one.kind, one.points, one.value, one.sigma, one.use, where)
