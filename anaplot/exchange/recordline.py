"""One record of a journal as one line: sequence number, time, kind, payload, checksum."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, NamedTuple

from anaplot.errors import InputError
from anaplot.textfiles.wording import quoted, reason

__all__ = [
    "JOURNAL_FORMAT",
    "MAX_LINE",
    "OPENING",
    "SESSIONS",
    "DamagedLineError",
    "JournalError",
    "JournalRecord",
    "Keep",
    "UnknownKindError",
    "claimed_format",
    "decode_line",
    "encode_line",
    "was_confirmed",
]

SESSIONS = "sessions"
"""The folder of a block's journal."""

JOURNAL_FORMAT = 1

MAX_LINE = 1_000_000
"""Longest line [bytes], its end included."""

OPENING = ("header", "opened")
"""Kinds of records that say in which format what follows is."""

Keep = Callable[[str], bool]
"""Says of a kind of record whether its payload is wanted; raises UnknownKindError."""

_KIND = re.compile(r"[a-z][a-z0-9-]{0,39}")
_RESERVED = frozenset(("seq", "t", "kind", "durable", "crc"))
_HEAD = re.compile(
    rb'\{"seq":([1-9][0-9]{0,14}),'
    rb'"t":"([0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\.[0-9]{3}Z)",'
    rb'"kind":"([a-z][a-z0-9-]{0,39})"(?:,"durable":(true|false))?'
)
_TAIL = re.compile(rb',"crc":"([0-9a-f]{8})"\}')
_TAIL_LENGTH = len(',"crc":"01234567"}')


class JournalError(InputError):
    """A record was refused: it is not in the journal, and what was there before is."""


class DamagedLineError(Exception):
    """A line is not what was written; the text says why.

    Attributes
    ----------
    changed
        It has the form of a record: not torn off, but changed.
    """

    def __init__(self, why: str, *, changed: bool = True) -> None:
        super().__init__(why)
        self.changed = changed


class UnknownKindError(Exception):
    """A record is of a kind that its reader must know and does not; the text says which."""


class JournalRecord(NamedTuple):
    """One record of a journal.

    Attributes
    ----------
    seq
        Sequence number, from 1, running on through all files.
    time
        When it was written, UTC, ISO 8601 with milliseconds; clocks may jump, `seq` is the order.
    kind
        What it is.
    payload
        The other keys of its JSON object.
    file, line
        Where it stands.
    durable
        Whether the writer was told only when it was on disk, with all before it; None where the
        line does not say it, as in journals of older versions.
    """

    seq: int
    time: str
    kind: str
    payload: Mapping[str, Any]
    file: str
    line: int
    durable: bool | None = None

    def __repr__(self) -> str:
        """Return what and where it is, without what a device or a person said."""
        at = f"{self.file}:{self.line}"
        return f"<JournalRecord {self.seq} {self.kind!r} of {self.time!r}, {at!r}>"


def encode_line(
    seq: int, time: str, kind: str, payload: Mapping[str, Any], durable: bool | None = None
) -> bytes:
    """Return a record as one line of ASCII, its end included.

    The checksum is the CRC-32 of all bytes before `,"crc"`. What is None is left out.

    Raises
    ------
    JournalError
        The payload is no JSON object, uses a key of the journal itself, or is too long.
    """
    if _KIND.fullmatch(kind) is None:
        raise JournalError(f"record refused: bad kind {quoted(kind)}")
    for key in payload:
        if not isinstance(key, str) or key in _RESERVED:
            raise JournalError(f"record {quoted(kind)} refused: bad key {quoted(str(key))}")
    said = {} if durable is None else {"durable": durable}
    record = {"seq": seq, "t": time, "kind": kind, **said, **payload}
    try:
        text = json.dumps(record, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    except (TypeError, ValueError, RecursionError) as error:
        raise JournalError(f"record {quoted(kind)} refused: {reason(error)}") from error
    # JSON escapes all other control characters by itself.
    body = text[:-1].replace("\x7f", "\\u007f").encode("ascii")
    line = body + b',"crc":"%08x"}\n' % zlib.crc32(body)
    if len(line) > MAX_LINE:
        raise JournalError(
            f"record {quoted(kind)} refused: {len(line)} bytes are more than {MAX_LINE}"
        )
    return line


def decode_line(
    raw: bytes, file: str, line: int, keep: Keep | None = None
) -> tuple[JournalRecord, bool]:
    """Return the record of a line.

    Parameters
    ----------
    raw
        The line without its end.
    file, line
        Where it stands.
    keep
        Which kinds are wanted; of the others the payload is not parsed. None: all.

    Returns
    -------
    tuple[JournalRecord, bool]
        The record, and whether it is wanted; without payload when it is not.

    Raises
    ------
    DamagedLineError
        The line is not one that `encode_line` wrote.
    """
    head, tail = _ends(raw)
    if raw.endswith(b"\r") and _ends(raw[:-1])[1] is not None:
        raise DamagedLineError("its end is CR LF, as an editor or a transfer as text leaves it")
    if tail is None or head is None:
        raise DamagedLineError("not a complete record", changed=False)
    body = raw[: tail.start()]
    if zlib.crc32(body) != int(tail[1], 16):
        raise DamagedLineError("the checksum does not agree")
    time = head[2].decode("ascii")
    try:
        datetime.fromisoformat(time)
    except ValueError:
        raise DamagedLineError("a time that does not exist") from None
    kind = head[3].decode("ascii")
    wanted = keep is None or keep(kind)
    durable = None if head[4] is None else head[4] == b"true"
    payload = _payload(body) if wanted else {}
    return JournalRecord(int(head[1]), time, kind, payload, file, line, durable), wanted


def was_confirmed(raw: bytes) -> bool:
    """Whether a line that is no record has been one that somebody was told is on disk.

    It has the beginning or the end of a record, and nothing in it says that nobody was told.

    Parameters
    ----------
    raw
        A whole line without its end, in which nothing is zeros.
    """
    return any(_ends(raw)) and b'"durable":false' not in raw


def _ends(raw: bytes) -> tuple[re.Match[bytes] | None, re.Match[bytes] | None]:
    return _HEAD.match(raw), _TAIL.fullmatch(raw, max(len(raw) - _TAIL_LENGTH, 0))


def claimed_format(raw: bytes) -> int | None:
    """Return the format that a header line states, whatever else is in it; None without one."""
    if len(raw) > MAX_LINE:
        return None
    try:
        header = json.loads(raw)
    except (ValueError, RecursionError):
        return None
    if not isinstance(header, dict) or header.get("kind") != "header":
        return None
    number = header.get("format")
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def _payload(body: bytes) -> dict[str, Any]:
    try:
        data: dict[str, Any] = _DECODER.decode((body + b"}").decode("ascii"))
    except (ValueError, RecursionError) as error:
        raise DamagedLineError("not JSON") from error
    for key in _RESERVED & data.keys():
        del data[key]
    return data


def _no_constant(name: str) -> None:
    raise ValueError(name)


_DECODER = json.JSONDecoder(parse_constant=_no_constant)  # made once: a line needs as long
