"""image_points.csv written again: what has not changed stands there as it stood.

A person's file has its own line ends, order of columns and digits. Only fields that say something
else are written, and rows that are new; a column that is missing for them is added.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from anaplot.textfiles.csvlines import CsvLine, CsvLines, cell_value, cells_of, with_value

__all__ = ["Columns", "rewritten"]

# columns that may be missing, and what a blank field of them says
_MAY_MISS = {"sigma_um": None, "model": None, "use": "xy", "reason": None}
_KEY = ("photo", "point", "model")
_SWITCHES = ("reason", "use")


Columns = Mapping[str, Sequence[str | float | None]]
"""What rows say by columns: photo, point, both coordinates, and those that may be missing."""


def rewritten(text: str, old: Columns, new: Columns) -> str:
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
    sources = _sources(old, new)
    changed = _changed(old, new, sources)
    whole: str | None = None
    fresh = CsvLine("", "," * (len(names) - 1), lines.end)
    # blank fields of columns that are added
    before, behind = "," * len(first), "," * len(last)
    out: list[CsvLine] = []
    for k, source in enumerate(sources):
        line = fresh if source is None else lines.rows[source]
        if first or last:
            line = CsvLine(line.above, f"{before}{line.text}{behind}", line.end)
        if k in changed:
            cells = cells_of(line.text)
            for name, value in changed[k].items():
                if name not in places:
                    continue
                said = "" if value is None else value if isinstance(value, str) else repr(value)
                if name == "use" and value == "xy":
                    whole = _word_for_whole(lines, names) if whole is None else whole
                    said = whole
                cells[places[name]] = with_value(cells[places[name]], said)
            line = line._replace(text=",".join(cells))
        out.append(line)
    return lines.with_rows(*_without_blank_columns(",".join((*first, *header, *last)), out))


def _sources(old: Columns, new: Columns) -> Sequence[int | None]:
    """Return of each new row which old one has its photo, point and model; None: none."""
    mine, its = ([columns[name] for name in _KEY] for columns in (new, old))
    if mine == its:
        return range(len(mine[0]))
    known = {key: k for k, key in enumerate(zip(*its, strict=True))}
    return [known.get(key) for key in zip(*mine, strict=True)]


def _changed(
    old: Columns, new: Columns, sources: Sequence[int | None]
) -> dict[int, dict[str, str | float | None]]:
    """Return of the new rows that say something else, or are new, the fields that do."""
    out: dict[int, dict[str, str | float | None]] = {}
    for name, mine in new.items():
        its = old[name]
        if isinstance(sources, range) and mine == its:
            continue
        for k, (value, source) in enumerate(zip(mine, sources, strict=True)):
            if source is None or its[source] != value:
                out.setdefault(k, {})[name] = value
    return out


def _added(names: Sequence[str], new: Columns) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the columns that are missing: those that come first, and those that come last."""
    missing = [
        name
        for name, blank in _MAY_MISS.items()
        if name not in names and any(value != blank for value in new[name])
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
