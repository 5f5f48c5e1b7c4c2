"""Events into a journal, and out of its records; how often it is read, and no waiting for disks."""

from __future__ import annotations

import os
from collections.abc import Iterable
from types import ModuleType

import pytest

from anaplot.exchange.eventcodec import event_to_payload
from anaplot.exchange.journal import Journal, JournalRecord, event_of
from anaplot.session.events import EVENT_KINDS, Event

PLAIN = """\
format = 1
name = "b"
[[camera]]
id = "c"
c = 150.0
[[strip]]
id = "1"
first = "1"
last = "3"
"""
"""The block.toml of a strip of three photos."""


def append_event(journal: Journal, event: Event, *, durable: bool = True) -> int:
    """Write a session event; its sequence number."""
    return journal.append(event.kind, event_to_payload(event), durable=durable)


def events_of(records: Iterable[JournalRecord]) -> tuple[Event, ...]:
    """The session events among records, in order."""
    return tuple(event_of(record) for record in records if record.kind in EVENT_KINDS)


def wait_for_no_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what is written reach the system alone: the same one reads it again."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: None, raising=False)


def lines_decoded(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> list[int]:
    """Return where the numbers of the lines stand that a module decodes from now on."""
    lines: list[int] = []
    decode = module.decode_line

    def counted(raw, file, line, *keep):
        lines.append(line)
        return decode(raw, file, line, *keep)

    monkeypatch.setattr(module, "decode_line", counted)
    return lines
