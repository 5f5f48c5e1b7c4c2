"""image_points.csv written again: what has not changed stands there as it stood.

A person's file has its own line ends, order of columns and digits. Only fields that say something
else are written, and rows that are new; a column that is missing for them is added.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from anaplot.textfiles.csvlines import CsvLine, CsvLines, cell_value, cells_of, with_value

__all__ = ["Written", "rewritten"]

# columns that may be missing, and what a blank field of them says
_MAY_MISS = {"sigma_um": "", "model": "", "use": "xy", "reason": ""}
_SWITCHES = ("reason", "use")


class Written(NamedTuple):
    """Rows as the fields that say them.

    Attributes
    ----------
    names
        Of the columns: photo, point, both coordinates, and those that may be missing.
    rows
        The fields of every row.
    """

    names: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


def rewritten(text: str, old: Written, new: Written) -> str:
    """Return the text of a file with other rows.

    Columns that are added stand where nobody puts them: `reason,use` at the end where both are,
    one of them alone at the beginning. By that they are known, and left out again, once nothing
    stands in them any more.

    Parameters
    ----------
    text
        The file as it is.
    old, new
        What its rows say, and what they are to say; the same columns in both.
    """
    lines = CsvLines.of(text)
    header = cells_of(lines.header.text)
    names = list(map(cell_value, header))
    first, last = _added(names, new)
    places = {name: k for k, name in enumerate((*first, *names, *last))}
    whole: str | None = None
    photo, point, model = (new.names.index(name) for name in ("photo", "point", "model"))
    known = {(row[photo], row[point], row[model]): k for k, row in enumerate(old.rows)}
    out: list[CsvLine] = []
    for row in new.rows:
        k = known.get((row[photo], row[point], row[model]))
        said = ("",) * len(row) if k is None else old.rows[k]
        line = CsvLine("", "", lines.end) if k is None else lines.rows[k]
        if said == row:
            # blank fields of columns that are added
            more = line._replace(text=f"{',' * len(first)}{line.text}{',' * len(last)}")
            out.append(more if first or last else line)
            continue
        cells = [""] * len(names) if k is None else cells_of(line.text)
        cells = [*("" for _ in first), *cells, *("" for _ in last)]
        for name, value, was in zip(new.names, row, said, strict=True):
            if value != was and name in places:
                text_of = value
                if name == "use" and value == "xy":
                    whole = _word_for_whole(lines, names) if whole is None else whole
                    text_of = whole
                cells[places[name]] = with_value(cells[places[name]], text_of)
        out.append(line._replace(text=",".join(cells)))
    return lines.with_rows(*_without_blank_columns(",".join((*first, *header, *last)), out))


def _added(names: Sequence[str], new: Written) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the columns that are missing: those that come first, and those that come last."""
    missing = [
        name
        for name, blank in _MAY_MISS.items()
        if name not in names and any(row[new.names.index(name)] != blank for row in new.rows)
    ]
    switches = tuple(name for name in _SWITCHES if name in missing)
    others = tuple(name for name in missing if name not in switches)
    return (switches, others) if len(switches) == 1 else ((), (*others, *switches))


def _word_for_whole(lines: CsvLines, names: Sequence[str]) -> str:
    """Return what most rows have as use that count whole: a blank field, or the word."""
    if "use" not in names:
        return ""
    at = names.index("use")
    values = Counter(cell_value(cells_of(line.text)[at]) for line in lines.rows)
    return "xy" if values["xy"] > values[""] else ""


def _without_blank_columns(header: str, rows: list[CsvLine]) -> tuple[str, list[CsvLine]]:
    """Leave out the columns that were added, where nothing stands in them any more."""
    names = header.split(",")
    if tuple(names[-2:]) == _SWITCHES:
        if all(line.text.endswith(",,") for line in rows):
            return header[: -len(",reason,use")], [
                line._replace(text=line.text[:-2]) for line in rows
            ]
    elif names[0] in _SWITCHES and all(line.text.startswith(",") for line in rows):
        return header[len(names[0]) + 1 :], [line._replace(text=line.text[1:]) for line in rows]
    return header, rows
