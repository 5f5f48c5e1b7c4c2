"""What the records of a session's journal hold, read strictly: one kind of error, with its place.

A record's checksum says that it is as it was written, not that this program wrote it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from anaplot.errors import InputError
from anaplot.exchange.journal import JournalRecord
from anaplot.photogrammetry.block import PatternPoint
from anaplot.plotter.readings import Position
from anaplot.textfiles.kinds import (
    FLAG,
    NAME,
    NUMBER,
    Blank,
    Fields,
    Items,
    Keys,
    Kind,
    ListOf,
    Made,
    MapOf,
    Text,
    Whole,
    WrongValueError,
)
from anaplot.textfiles.wording import plain

__all__ = [
    "Heard",
    "Opened",
    "RecordedInnerTable",
    "RecordedTable",
    "Value",
    "heard_in",
    "inner_table_of",
    "opened_by",
    "refusal",
    "shift_of",
    "table_of",
]

Value = str | float | bool | None
"""One value of a recorded table's row."""

_TEXT = Text(sys.maxsize)  # a journal's lines are bounded


@dataclass(frozen=True, slots=True)
class Opened:
    """What a header, or the record that a journal was opened again, says of the session.

    Attributes
    ----------
    block_toml
        The block as it was declared, or None.
    camera_files
        The texts of its camera files, by their names.
    pattern
        Name or file of the point pattern; None in sessions of older versions.
    pattern_points
        The points of one of one's own, or None.
    profile, profile_sha256
        The device profile's name and the digest of its file; None without an instrument.
    profile_text
        The profile itself; None in sessions of version 0.1.
    rules
        By which the decoder decided what is a measurement, see `anaplot.plotter.decoder.RULES`.
    simulated
        Whether the instrument was a simulated one.
    shift
        By how much its counters were moved from the beginning [mm], or None.
    goes_on
        Whether the session before goes on, in another file.
    """

    block_toml: str | None
    camera_files: Mapping[str, str]
    pattern: str | None
    pattern_points: tuple[PatternPoint, ...] | None
    profile: str | None
    profile_sha256: str | None
    profile_text: str | None
    rules: int
    simulated: bool
    shift: Position | None = None
    goes_on: bool = False


@dataclass(frozen=True, slots=True)
class Heard:
    """One item of a line's traffic.

    Attributes
    ----------
    kind
        "in" and "out" for bytes; "decoder" for what else the decoder was told; others say what
        was lost.
    name
        The link, or what the decoder was told.
    text
        The bytes, a character each, or the text.
    when
        Its time [s].
    """

    kind: str
    name: str
    text: str
    when: float

    @property
    def data(self) -> bytes:
        """The bytes."""
        return self.text.encode("latin-1")

    def position(self) -> Position:
        """Return the four coordinates [mm] of a reference.

        Raises
        ------
        ValueError
            The text does not hold them.
        """
        values = tuple(map(float, self.text.split()))
        if len(values) != 4 or not all(map(math.isfinite, values)):
            raise ValueError
        return Position(*values)


@dataclass(frozen=True, slots=True)
class RecordedTable:
    """A model's table: name of the model, sigma0 [um] or None, and the rows' values."""

    model: str
    sigma0_um: float | None
    rows: tuple[tuple[Value, ...], ...]


@dataclass(frozen=True, slots=True)
class RecordedInnerTable:
    """An inner orientation's table: what it is of, sigma0 [um] or None, and the rows' values."""

    photo: str
    side: str
    transformation: str
    sigma0_um: float | None
    rows: tuple[tuple[Value, ...], ...]


def refusal(record: JournalRecord, message: str) -> InputError:
    """Return the error about a record: its file, its line, its kind."""
    return InputError(f"{record.file} line {record.line}: {record.kind}: {message}")


class _Value(Kind[Value]):
    """One value of a recorded table's row."""

    def of(self, value: Any) -> Value:
        """Return the value."""
        return value if value is None or isinstance(value, bool | str) else NUMBER.of(value)


def _heard(parts: tuple[str, str, str, float]) -> Heard:
    heard = Heard(*parts)
    if heard.kind in ("in", "out") and not all(letter <= "\xff" for letter in heard.text):
        raise ValueError("a character that is no byte")
    if heard.kind == "decoder" and heard.name == "reference":
        try:
            heard.position()
        except ValueError:
            raise ValueError("a reference is four numbers") from None
    return heard


_PATTERN_POINT = Made(Items(NAME, NUMBER, NUMBER, FLAG), lambda parts: PatternPoint(*parts))
_SHIFT = Made(Items(NUMBER, NUMBER, NUMBER, NUMBER), lambda parts: Position(*parts))
_OPENED: Fields = {
    "block_toml": Blank(_TEXT),
    "camera_files": MapOf(_TEXT, _TEXT),
    "pattern": Blank(_TEXT),
    "pattern_points": Blank(ListOf(_PATTERN_POINT, "pattern_points")),
    "profile": Blank(_TEXT),
    "profile_sha256": Blank(_TEXT),
    "profile_text": Blank(_TEXT),
    "rules": Whole(0, 1_000_000),
    "simulated": FLAG,
    "shift": _SHIFT,
    "goes_on": FLAG,
}
_TRAFFIC = {"items": ListOf(Made(Items(_TEXT, _TEXT, _TEXT, NUMBER), _heard), "items")}
_ROWS = ListOf(ListOf(_Value(), "values"), "rows")
_TABLE: Fields = {"model": _TEXT, "rows": _ROWS}
_INNER: Fields = {"photo": _TEXT, "side": _TEXT, "transformation": _TEXT, "rows": _ROWS}
_SIGMA0: Fields = {"sigma0_um": Blank(NUMBER)}


def opened_by(record: JournalRecord) -> Opened:
    """Return what a header or "opened" record says.

    Raises
    ------
    InputError
        A key holds something else than it should, with file and line.
    """
    unsaid = (
        "block_toml",
        "pattern",
        "pattern_points",
        "profile",
        "profile_sha256",
        "profile_text",
    )
    usual = dict.fromkeys(unsaid)
    # the first version's headers say nothing of rules
    return Opened(
        **{
            **usual,
            "camera_files": {},
            "rules": 1,
            "simulated": False,
            **_read(record, {}, _OPENED),
        }
    )


def shift_of(record: JournalRecord) -> Position | None:
    """Return by how much a "referenced" record says that counters are moved [mm] now.

    None where they count as they did before.

    Raises
    ------
    InputError
        It says something else, with file and line.
    """
    shift: Position | None = _read(record, {}, {"shift": _SHIFT}).get("shift")
    return shift


def heard_in(record: JournalRecord) -> tuple[Heard, ...]:
    """Return the traffic of a record, in order.

    Raises
    ------
    InputError
        An item that a line cannot have said, with file and line.
    """
    items: tuple[Heard, ...] = _read(record, _TRAFFIC)["items"]
    return items


def table_of(record: JournalRecord) -> RecordedTable:
    """Return the table of a model.

    Raises
    ------
    InputError
        It is none, with file and line.
    """
    return RecordedTable(**{"sigma0_um": None, **_read(record, _TABLE, _SIGMA0)})


def inner_table_of(record: JournalRecord) -> RecordedInnerTable:
    """Return the table of an inner orientation.

    Raises
    ------
    InputError
        It is none, with file and line.
    """
    return RecordedInnerTable(**{"sigma0_um": None, **_read(record, _INNER, _SIGMA0)})


def _read(
    record: JournalRecord, required: Fields, optional: Fields | None = None
) -> dict[str, Any]:
    """Return the declared keys of a record; others are for other readers."""
    try:
        return Keys(required, optional, also=record.payload).of(record.payload)
    except WrongValueError as error:
        raise refusal(record, plain(error.placed(), 200)) from None
