from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.plotter.framing import Framer
from anaplot.plotter.readings import Refused
from anaplot.plotter.schema import Framing

LINE = Framing("line", b"\r\n", 20)
TWO = Framing("line", b"\n", 20, gap=0.1, lines=2)
FIXED = Framing("fixed", max_bytes=4, length=4, gap=0.1)
SYNC = Framing("sync-bit", max_bytes=3, length=3)
KINDS = [LINE, TWO, FIXED, SYNC, Framing("line", b"\n", 20, joined="middle")]


def frames(found):
    return [frame for frame in found if isinstance(frame, bytes)]


def reasons(found):
    return [frame.reason for frame in found if isinstance(frame, Refused)]


def test_lines():
    framer = Framer(LINE)
    assert framer.feed(b"ab\r", 0.0) == []
    assert framer.feed(b"\ncd\r\n\r\n e\rf\r\n", 0.0) == [b"ab", b"cd", b" e\rf"]


def test_a_line_that_is_too_long_is_refused_to_its_end():
    framer = Framer(LINE)
    found = framer.feed(b"x" * 50, 0.0)
    found += framer.feed(b"yy\r\nab\r\n", 0.0)
    assert frames(found) == [b"ab"]
    assert reasons(found)[0] == "longer than 20 bytes"
    assert b"".join(f.raw for f in found if isinstance(f, Refused)) == b"x" * 50 + b"yy\r\n"
    assert frames(framer.feed(b"z" * 21 + b"\r\ncd\r\n", 0.0)) == [b"cd"]


def test_joining_in_the_middle_of_a_line():
    framer = Framer(KINDS[-1])
    found = framer.feed(b"56\n12\n", 0.0)
    assert frames(found) == [b"12"]
    assert reasons(found) == ["the start was missed"]
    framer.reset()
    assert frames(framer.feed(b"34\n", 0.0)) == []


def test_records_of_two_lines_and_the_pause_between_them():
    framer = Framer(TWO)
    assert framer.feed(b"a\nb\nc\n", 0.0) == [b"a\nb"]
    found = framer.feed(b"a\nb\n", 0.2)
    assert frames(found) == [b"a\nb"]
    assert reasons(found) == ["a pause cut the record short"]
    assert framer.expire(9.0) == []


def test_fixed_records_wait_for_a_pause_when_out_of_step():
    framer = Framer(FIXED)
    assert framer.feed(b"abcdefgh", 0.0) == [b"abcd", b"efgh"]
    framer.lose_sync()
    assert reasons(framer.feed(b"ijkl", 0.05)) == ["out of step"]
    assert frames(framer.feed(b"mnop", 0.3)) == [b"mnop"]
    framer.feed(b"q", 0.3)
    assert reasons(framer.expire(0.5)) == ["a pause cut the record short"]


def test_sync_bit():
    framer = Framer(SYNC)
    found = framer.feed(b"\x01\x81\x01\x02\x82\x03\x83\x01\x02", 0.0)
    assert frames(found) == [b"\x81\x01\x02", b"\x83\x01\x02"]
    assert reasons(found) == ["no start of a record", "a new record began before its end"]


@pytest.mark.parametrize("framing", KINDS)
@given(chunks=st.lists(st.binary(max_size=40), max_size=20))
def test_no_byte_disappears_and_memory_is_bounded(framing, chunks):
    framer = Framer(framing)
    came, told = 0, 0
    for chunk in chunks:
        came += len(chunk)
        for frame in framer.feed(chunk, 0.0):
            told += len(frame.raw) if isinstance(frame, Refused) else len(frame)
            if isinstance(frame, bytes):
                assert len(frame) <= framing.max_bytes
    held = len(framer._buffer)
    assert held <= framing.max_bytes + len(framing.terminator)
    terminators = b"".join(chunks).count(framing.terminator) if framing.kind == "line" else 0
    ends = terminators * len(framing.terminator) + b"".join(chunks).count(b"\r")
    assert came - ends <= told + held <= came


@pytest.mark.parametrize("framing", KINDS)
@given(data=st.binary(max_size=60), cut=st.integers(0, 60))
def test_where_the_stream_is_cut_makes_no_difference(framing, data, cut):
    whole, parts = Framer(framing), Framer(framing)
    expected = frames(whole.feed(data, 0.0))
    found = parts.feed(data[:cut], 0.0) + parts.feed(data[cut:], 0.0)
    assert frames(found) == expected
