"""What the records of a session's journal hold, read strictly: one kind of error, with its place.

A record's checksum says that it is as it was written, not that this program wrote it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from anaplot.errors import InputError
from anaplot.exchange.journal import Record
from anaplot.plotter.readings import Position
from anaplot.textfiles.wording import describe_type, plain

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
    "table_of",
]

_FIRST_RULES = 1  # of headers that do not say

Value = str | float | bool | None
"""One value of a recorded table's row."""


@dataclass(frozen=True, slots=True)
class Opened:
    """What a header, or the record that a journal was opened again, says of the session.

    Attributes
    ----------
    block_toml
        The block as it was declared, or None.
    camera_files
        The texts of its camera files, by their names.
    profile, profile_sha256
        The device profile's name and the digest of its file; None without an instrument.
    profile_text
        The profile itself; None in sessions of version 0.1.
    rules
        By which the decoder decided what is a measurement, see `anaplot.plotter.decoder.RULES`.
    simulated
        Whether the instrument was a simulated one.
    """

    block_toml: str | None
    camera_files: Mapping[str, str]
    profile: str | None
    profile_sha256: str | None
    profile_text: str | None
    rules: int
    simulated: bool


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


def refusal(record: Record, message: str) -> InputError:
    """Return the error about a record: its file, its line, its kind."""
    return InputError(f"{record.file} line {record.line}: {record.kind}: {message}")


def opened_by(record: Record) -> Opened:
    """Return what a header or "opened" record says.

    Raises
    ------
    InputError
        A key holds something else than it should, with file and line.
    """
    files = record.payload.get("camera_files", {})
    if not isinstance(files, dict) or not all(isinstance(text, str) for text in files.values()):
        raise refusal(record, "camera_files must be texts by their names")
    rules = record.payload.get("rules", _FIRST_RULES)
    if isinstance(rules, bool) or not isinstance(rules, int):
        raise refusal(record, f"rules must be a number, not {describe_type(rules)}")
    return Opened(
        block_toml=_text_or_none(record, "block_toml"),
        camera_files=files,
        profile=_text_or_none(record, "profile"),
        profile_sha256=_text_or_none(record, "profile_sha256"),
        profile_text=_text_or_none(record, "profile_text"),
        rules=rules,
        simulated=record.payload.get("simulated") is True,
    )


def heard_in(record: Record) -> tuple[Heard, ...]:
    """Return the traffic of a record, in order.

    Raises
    ------
    InputError
        An item that a line cannot have said, with file and line.
    """
    items = record.payload.get("items")
    if not isinstance(items, list):
        raise refusal(record, f"items must be a list, not {describe_type(items)}")
    return tuple(_heard(record, index, item) for index, item in enumerate(items))


def table_of(record: Record) -> RecordedTable:
    """Return the table of a model.

    Raises
    ------
    InputError
        It is none, with file and line.
    """
    return RecordedTable(
        model=_text(record, "model"),
        sigma0_um=_sigma0(record),
        rows=_rows(record),
    )


def inner_table_of(record: Record) -> RecordedInnerTable:
    """Return the table of an inner orientation.

    Raises
    ------
    InputError
        It is none, with file and line.
    """
    return RecordedInnerTable(
        photo=_text(record, "photo"),
        side=_text(record, "side"),
        transformation=_text(record, "transformation"),
        sigma0_um=_sigma0(record),
        rows=_rows(record),
    )


def _heard(record: Record, index: int, item: Any) -> Heard:
    where = f"items[{index}]"
    if not isinstance(item, list) or len(item) != 4:
        raise refusal(record, f"{where} must be a list of kind, name, text and time")
    kind, name, text, when = item
    if not (isinstance(kind, str) and isinstance(name, str) and isinstance(text, str)):
        raise refusal(record, f"{where}: kind, name and text must be texts")
    heard = Heard(kind, name, text, _number(record, f"{where}: the time", when))
    if kind in ("in", "out") and not all(character <= "\xff" for character in text):
        raise refusal(record, f"{where}: a character that is no byte")
    if kind == "decoder" and name == "reference":
        try:
            heard.position()
        except ValueError:
            raise refusal(record, f"{where}: a reference is four numbers") from None
    return heard


def _text(record: Record, key: str) -> str:
    value = record.payload.get(key)
    if not isinstance(value, str):
        raise refusal(record, f"{key} must be text, not {describe_type(value)}")
    return value


def _text_or_none(record: Record, key: str) -> str | None:
    return None if record.payload.get(key) is None else _text(record, key)


def _sigma0(record: Record) -> float | None:
    value = record.payload.get("sigma0_um")
    return None if value is None else _number(record, "sigma0_um", value)


def _rows(record: Record) -> tuple[tuple[Value, ...], ...]:
    rows = record.payload.get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise refusal(record, "rows must be a list of lists")
    return tuple(
        tuple(_value(record, f"rows[{index}]", value) for value in row)
        for index, row in enumerate(rows)
    )


def _value(record: Record, where: str, value: Any) -> Value:
    if value is None or isinstance(value, bool | str):
        return value
    return _number(record, where, value)


def _number(record: Record, where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise refusal(record, f"{where} must be a number, not {describe_type(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise refusal(record, f"{where} must be a finite number, not {plain(str(value), 30)}")
    return number
