"""Journals with valid checksums that this program did not write: an answer or one line, always.

Every value of every kind of record is replaced in turn by values of another type or size, or left
out, and its checksum made anew. What comes of it is a replay, a difference or an InputError that
names file and line: never another exception.
"""

from __future__ import annotations

import contextlib
import copy
import io
import json
import warnings
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from anaplot.errors import InputError
from anaplot.exchange.journal import JournalRecord, event_of, read_journal
from anaplot.session.events import EVENT_KINDS
from anaplot.station.payloads import heard_in, inner_table_of, opened_by, table_of
from anaplot.station.rebuild import session_solutions
from anaplot.station.replay import Difference, replay_session
from anaplot.station.replayed import ReplayStation

CORPUS = Path(__file__).parents[1] / "sessions"
SESSIONS = ("changes", "fiducials", "profile-mitutoyo-gauge", "profile-summagraphics-mm1103")
MORE = 3  # records that are kept behind the forged one
LENGTH = 3  # elements of a list that are forged
STRIDE = 37  # of the forgeries every so manieth is replayed: all of them take minutes

INFINITE = "@infinite@"  # written as 1e999, which is JSON
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 10**400, 1e308, -1e308, 5e-324, INFINITE, 0.1),
    *("", "x", "1", "\x1b[2J\u202e", "\u20ac", "a" * 300, "101", "left", "../../etc/passwd"),
    *([], [[]], [None] * 4, ["in", "x", "y", 0.0], {}, {"a": 1}),
)
ITEMS: tuple[Any, ...] = (
    *(["in", "nowhere", "x", 0.0], ["out", "nowhere", "x", 0.0], ["in", "line", "\u20ac", 0.0]),
    *(["decoder", "reopen", "nowhere", 0.0], ["decoder", "reference", "1 2 3", 0.0]),
    *(["decoder", "reference", "1 2 3 nan", 0.0], ["decoder", "reference", "1 2 3 4", 0.0]),
    *(["decoder", "press", "nothing", 1e308], ["decoder", "x", "x", -1e308], ["lost", "", "", 0]),
)


def forged_line(seq: int, kind: str, payload: Any, time: str = "2026-01-01T00:00:00.000Z") -> bytes:
    """Return a line with a valid checksum, whatever is in it."""
    data = {"seq": seq, "t": time, "kind": kind, **payload}
    text = json.dumps(data, separators=(",", ":")).replace(f'"{INFINITE}"', "1e999")
    body = text[:-1].encode("ascii")
    return body + b',"crc":"%08x"}\n' % zlib.crc32(body)


def changed(value: Any) -> Iterator[Any]:
    """Yield copies of a payload with one thing in it replaced, left out or doubled."""
    keys: list[Any] = []
    if isinstance(value, dict):
        keys = list(value)
    elif isinstance(value, list):
        keys = list(range(min(len(value), LENGTH)))
        yield from ([*value, item] for item in ITEMS)
    for key in keys:
        for other in VALUES:
            if other != value[key]:
                after = copy.copy(value)
                after[key] = other
                yield after
        less = copy.copy(value)
        del less[key]
        yield less
        for part in changed(value[key]):
            after = copy.copy(value)
            after[key] = part
            yield after


def forgeries(records: tuple[JournalRecord, ...]) -> Iterator[list[bytes]]:
    """Yield journals, each with one record changed that is the first of its kind and shape."""
    lines = [forged_line(r.seq, r.kind, r.payload) for r in records]
    seen: set[str] = set()
    for at, record in enumerate(records):
        if record.kind in seen:
            continue
        seen.add(record.kind)
        for payload in changed(dict(record.payload)):
            if {"seq", "t", "kind", "crc"} & payload.keys():
                continue
            line = forged_line(record.seq, record.kind, payload)
            yield [*lines[:at], line, *lines[at + 1 : at + 1 + MORE]]
        for other in {r.kind: r for r in records}.values():
            line = forged_line(record.seq, other.kind, record.payload)
            yield [*lines[:at], line, *lines[at + 1 : at + 1 + MORE]]


def outcome(path: Path) -> str:
    """Return what a replay says: nothing when it comes out the same."""
    refused = ""
    differences: tuple[Difference, ...] = ()
    try:
        replayed = replay_session(path)
        session_solutions(replayed.state)
        differences = replayed.differences
    except InputError as error:
        refused = str(error)
    # without a block in its header a journal belongs to a folder
    places = f"{path.name} line ", "block.toml: file not found"
    assert not refused or any(place in refused for place in places)
    said = refused or "; ".join(map(str, differences))
    assert not said or said.isprintable()
    return said


PARSERS = {
    "header": opened_by,
    "opened": opened_by,
    "traffic": heard_in,
    "table": table_of,
    "inner-table": inner_table_of,
    **dict.fromkeys(EVENT_KINDS, event_of),
}


@pytest.mark.parametrize("name", SESSIONS)
def test_every_forged_payload_is_read_or_refused_with_its_place(name):
    records = read_journal(CORPUS / f"{name}.jsonl").records
    first = {record.kind: record for record in reversed(records)}
    refused = count = 0
    for kind in PARSERS.keys() & first.keys():
        for payload in changed(dict(first[kind].payload)):
            text = json.dumps(payload).replace(f'"{INFINITE}"', "1e999")
            forged = first[kind]._replace(payload=json.loads(text))
            count += 1
            said = ""
            try:
                PARSERS[kind](forged)
            except InputError as error:
                said = str(error)
            refused += bool(said)
            assert not said or said.startswith(f"{forged.file} line {forged.line}: ")
            assert not said or said.isprintable()
    assert count > refused > count / 3


@pytest.mark.parametrize("name", SESSIONS)
def test_a_replay_with_a_forged_record_is_refused_or_told(name, tmp_path):
    records = read_journal(CORPUS / f"{name}.jsonl").records
    path = tmp_path / "0001.jsonl"
    told = count = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for lines in islice(forgeries(records), 0, None, STRIDE):
            path.write_bytes(b"".join(lines))
            told += bool(outcome(path))
            count += 1
    assert count > told > count / 3


def test_a_forged_session_is_watched_to_its_end_or_refused(tmp_path):
    records = read_journal(CORPUS / f"{SESSIONS[-1]}.jsonl").records
    path = tmp_path / "0001.jsonl"
    ended = 0
    for lines in islice(forgeries(records), 0, None, 10 * STRIDE):
        path.write_bytes(b"".join(lines))
        with contextlib.suppress(InputError):
            station = ReplayStation(path, 1e9)
            station.run(io.StringIO())
            station.close()
            ended += 1
    assert ended > 0


def test_a_time_that_does_not_exist_is_damage(tmp_path):
    records = read_journal(CORPUS / "torn-tail.jsonl").records
    lines = [forged_line(r.seq, r.kind, r.payload) for r in records]
    lines[2] = forged_line(3, records[2].kind, records[2].payload, "2026-99-99T99:99:99.999Z")
    path = tmp_path / "0001.jsonl"
    path.write_bytes(b"".join(lines))
    with pytest.raises(
        InputError, match=r"0001\.jsonl line 3: damaged: a time that does not exist"
    ):
        read_journal(path)
