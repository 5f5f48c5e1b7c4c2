"""Tables of any program: columns by their titles or numbers, stated or guessed and told."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Final

from anaplot.errors import InputError
from anaplot.exchange.formats.door import Note
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines, value_of
from anaplot.textfiles.decimalcomma import parted_by_blanks, with_point
from anaplot.textfiles.wording import hint, place, plain, quoted, reason

__all__ = ["ColumnTable", "commas_told", "open_columns", "plain_title"]

_MAX_COLUMNS: Final = 200
_MAX_LINE: Final = 100_000  # characters of a row
_UNIT: Final = re.compile(r"[\[(].{0,40}$")


@dataclass
class ColumnTable:
    """The rows of a table, and where in them something stands.

    Attributes
    ----------
    titles
        Of each column of ours that the table has, what the file calls it.
    stated
        Which of them a person named; the others are guessed.
    aside
        Titles of columns that are not read.
    headed
        Whether the file has a header.
    rows
        Each line with its fields, in the order of `titles`; read when it is asked for.
    commas
        How many numbers with a decimal comma there were.
    """

    titles: Mapping[str, str]
    stated: frozenset[str]
    aside: tuple[str, ...]
    headed: bool
    rows: Iterator[tuple[SourceLine, list[str]]]
    separator: str | None
    commas: int = 0

    def number(self, line: SourceLine, text: str, what: str) -> float:
        """Return a finite number, also one with a decimal comma; raises InputError."""
        pointed = None if self.separator == "," else with_point(text)
        self.commas += pointed is not None
        return line.number_of(text if pointed is None else pointed, what)

    def notes(self) -> tuple[Note, ...]:
        """Return which column was taken for what."""
        shown = [
            f"{ours} = {title}" + ("" if ours in self.stated else " (guessed)")
            for ours, title in self.titles.items()
        ]
        found = [Note("assumed", None, f"columns: {', '.join(shown)}")]
        if self.aside:
            found.append(Note("dropped", len(self.aside), "columns that are not read", self.aside))
        return (*found, *commas_told(self.commas))


def commas_told(count: int) -> tuple[Note, ...]:
    """Return that so many numbers have a decimal comma; nothing where none has."""
    return (Note("assumed", count, "numbers have a decimal comma"),) if count else ()


def open_columns(
    path: Path,
    usual: Mapping[str, tuple[str, ...]],
    needed: tuple[str, ...],
    bare: Mapping[int, tuple[str, ...]],
    stated: Mapping[str, str] | None,
) -> ColumnTable:
    """Look at a table's first row and say where its columns are.

    Parameters
    ----------
    path
        Text; fields are separated by tabs, semicolons, commas or blanks, the first of these that
        the first row has; a comma within a number does not count where blanks stand between all
        numbers. Lines that begin with # are comments. The first row is a header when none of its
        fields is a number.
    usual
        The columns of ours, each with usual titles as `plain_title` has them, best first.
    needed
        Those that must be there.
    bare
        Columns in their order where there is no header and none is stated, by their count.
    stated
        Titles, or numbers from 1 on, of columns by our name; None: nobody can state any.

    Raises
    ------
    InputError
        An unknown or missing column, too many columns, an empty table.
    """
    can_state = stated is not None
    stated = stated or {}
    for ours in stated:
        if ours not in usual:
            raise InputError(f"--column {plain(ours, 60)}: no such column{hint(ours, usual)}")
    # of two columns none is a number: "IMG 1,20 mm" is a photo and its camera
    lines = _rows(path, decimals=max(bare) > 2)
    first = next(lines, None)
    if first is None:
        raise InputError(f"{place(path)}: no row")
    line, separator, fields = first
    if len(fields) > _MAX_COLUMNS:
        raise line.fail(f"{len(fields)} columns, more than {_MAX_COLUMNS} are not read")
    headed = not any(_is_number(field) for field in fields)
    found = _stated(line, fields if headed else [], len(fields), stated)
    if headed:
        found |= _guessed(line, fields, usual, found)
        # a list of words alone: what looks like titles is its first row
        headed = bool(found) or can_state or len(fields) not in bare
    if not headed and not stated:
        order = bare.get(len(fields))
        if order is None:
            counts = ", ".join(map(" ".join, bare.values()))
            raise line.fail(
                f"no header, and {len(fields)} columns (known without one: {counts})"
                + (": say which is which, --column x=3" if can_state else "")
            )
        found = {ours: index for index, ours in enumerate(order)}
    missing = next((ours for ours in needed if ours not in found), None)
    if missing is not None:
        heads = ", ".join(quoted(field) for field in fields[:8])
        raise line.fail(f"no column for {missing} among {heads}: --column {missing}=TITLE")
    found = {ours: found[ours] for ours in usual if ours in found}
    titles = {ours: quoted(fields[k]) if headed else f"column {k + 1}" for ours, k in found.items()}
    used = set(found.values())
    aside = [fields[k] if headed else f"column {k + 1}" for k in range(len(fields))]
    rest = lines if headed else chain((first,), lines)
    return ColumnTable(
        titles,
        frozenset(stated),
        tuple(name for k, name in enumerate(aside) if k not in used),
        headed,
        _picked(rest, len(fields), tuple(found.values())),
        separator,
    )


def plain_title(title: str) -> str:
    """Return a title's letters and digits, small and without a unit in brackets."""
    return "".join(sign for sign in _UNIT.sub("", title.strip().lower()) if sign.isalnum())


def _rows(path: Path, *, decimals: bool) -> Iterator[tuple[SourceLine, str | None, list[str]]]:
    separator: str | None = None
    first = True
    for line in source_lines(path):
        if not line.text.strip() or line.text.lstrip().startswith("#"):
            continue
        if len(line.text) > _MAX_LINE:
            raise line.fail(f"longer than {_MAX_LINE} characters")
        if first:
            first = False
            separator = next((mark for mark in "\t;," if mark in line.text), None)
            if separator == "," and decimals and parted_by_blanks(line.text):
                separator = None
        yield line, separator, _fields(line, separator)


def _fields(line: SourceLine, separator: str | None) -> list[str]:
    if separator is None and '"' not in line.text:
        return line.text.split()
    try:
        # blanks that separate may be several; a quoted name may hold one
        text = line.text if separator is not None else " ".join(line.text.split())
        row = next(csv.reader([text], delimiter=separator or " ", strict=True))
    except csv.Error as error:
        raise line.fail(f"not a row: {reason(error)}") from None
    return [field.strip() for field in row]


def _is_number(text: str) -> bool:
    return value_of(text.replace(",", ".")) is not None


def _stated(
    line: SourceLine, fields: list[str], count: int, stated: Mapping[str, str]
) -> dict[str, int]:
    found: dict[str, int] = {}
    for ours, theirs in stated.items():
        same = [k for k, field in enumerate(fields) if field == theirs]
        same = same or [k for k, field in enumerate(fields) if field.lower() == theirs.lower()]
        if len(same) > 1:
            raise line.fail(f"column {quoted(theirs)} twice")
        if same:
            found[ours] = same[0]
        elif theirs.isascii() and theirs.isdecimal() and len(theirs) < 5:
            if not 1 <= int(theirs) <= count:
                raise line.fail(f"--column {ours}={theirs}: there are {count} columns")
            found[ours] = int(theirs) - 1
        else:
            what = hint(theirs, fields) if fields else " (no header: columns have numbers)"
            raise line.fail(f"no column {quoted(theirs)}{what}")
    taken: dict[int, str] = {}
    for ours, k in found.items():
        other = taken.setdefault(k, ours)
        if other != ours:
            raise line.fail(f"column {k + 1} is stated for {other} and for {ours}")
    return found


def _guessed(
    line: SourceLine,
    fields: list[str],
    usual: Mapping[str, tuple[str, ...]],
    found: Mapping[str, int],
) -> dict[str, int]:
    """Return columns that were not stated by their usual titles; the best title of each."""
    taken = set(found.values())
    plain_ones = [plain_title(field) for field in fields]
    out: dict[str, int] = {}
    for ours, titles in usual.items():
        if ours in found:
            continue
        for title in titles:
            at = [k for k, name in enumerate(plain_ones) if name == title and k not in taken]
            if len(at) > 1:
                raise line.fail(f"column {quoted(fields[at[0]])} twice: --column {ours}=NUMBER")
            if at:
                out[ours] = at[0]
                taken.add(at[0])
                break
    return out


def _picked(
    rows: Iterator[tuple[SourceLine, str | None, list[str]]], count: int, places: tuple[int, ...]
) -> Iterator[tuple[SourceLine, list[str]]]:
    for line, _, fields in rows:
        if len(fields) != count and (len(fields) < count or any(fields[count:])):
            raise line.fail(f"{len(fields)} fields, the first row has {count}")
        yield line, [fields[k] for k in places]
