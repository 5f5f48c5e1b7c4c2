"""image_points.csv written again: what has not changed stands there as it stood.

A person's file has its own line ends, order of columns and digits. Only fields that say something
else are written, and rows that are new; a column that is missing for them is added.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from anaplot.textfiles.csvlines import CsvLine, CsvLines, cell_value, cells_of, with_value

__all__ = ["Columns", "rewritten"]

# columns that may be missing, and what a blank field of them says
_MAY_MISS = {"sigma_um": None, "model": None, "use": "xy", "reason": None}
_KEY = ("photo", "point", "model")
_SWITCHES = ("reason", "use")


Columns = Mapping[str, Sequence[str | float | None]]
"""What rows say by columns: photo, point, both coordinates, and those that may be missing."""


def rewritten(text: str, old: Columns, new: Columns, first: int = 0) -> str:
    """Return the text of a file with other rows.

    Columns that are added stand where nobody puts them: `reason,use` at the end where both are,
    one of them alone at the beginning. By that they are known, and left out again with the last
    that stands in them; columns of a person's own in which nothing stood stay.

    Parameters
    ----------
    text
        The file as it is.
    old, new
        What its rows say, and what they are to say; the same columns in both. Rows before and
        behind those of `old` stay.
    first
        Where in the file those of `old` begin.
    """
    lines = CsvLines.of(text)
    header = cells_of(lines.header.text)
    names = list(map(cell_value, header))
    before, behind = _added(names, new)
    rows = lines.rows
    if before or behind:
        rows = [_widened(raw, len(before), len(behind)) for raw in rows]
    places = {name: k for k, name in enumerate((*before, *names, *behind))}
    sources = _sources(old, new)
    last = first + len(old["photo"])
    if isinstance(sources, range):
        changing = rows[first:last]
    else:
        fresh = "," * (len(places) - 1) + lines.end
        changing = [fresh if source is None else rows[first + source] for source in sources]
    whole: str | None = None
    for k, said_of in _changed(old, new, sources).items():
        line = CsvLine.of(changing[k])
        cells = cells_of(line.text)
        for name, value in said_of.items():
            if name not in places:
                continue
            said = "" if value is None else value if isinstance(value, str) else repr(value)
            if name == "use" and value == "xy":
                whole = _word_for_whole(lines, names) if whole is None else whole
                said = whole
            cells[places[name]] = with_value(cells[places[name]], said)
        changing[k] = line._replace(text=",".join(cells)).raw
    out = [*rows[:first], *changing, *rows[last:]]
    wider = ",".join((*before, *header, *behind))
    stood = {name for name in _SWITCHES if any(value != _MAY_MISS[name] for value in old[name])}
    return lines.with_rows(*_without_blank_columns(wider, out, stood))


def _widened(raw: str, before: int, behind: int) -> str:
    """Return a line with blank fields of columns that are added."""
    line = CsvLine.of(raw)
    return line._replace(text=f"{',' * before}{line.text}{',' * behind}").raw


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
    values = Counter(cell_value(cells_of(CsvLine.of(raw).text)[at]) for raw in lines.rows)
    return "xy" if values["xy"] > values[""] else ""


def _without_blank_columns(
    header: str, rows: list[str], stood: Collection[str]
) -> tuple[str, list[str]]:
    """Leave out the columns that were added, where something stood and nothing does any more."""
    names = header.split(",")
    if tuple(names[-2:]) == _SWITCHES:
        if stood and all(CsvLine.of(raw).text.endswith(",,") for raw in rows):
            return header[: -len(",reason,use")], [
                line._replace(text=line.text[:-2]).raw for line in map(CsvLine.of, rows)
            ]
    elif names[0] in stood and all(CsvLine.of(raw).text.startswith(",") for raw in rows):
        return header[len(names[0]) + 1 :], [
            line._replace(text=line.text[1:]).raw for line in map(CsvLine.of, rows)
        ]
    return header, rows
