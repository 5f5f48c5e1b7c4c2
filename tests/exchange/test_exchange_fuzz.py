"""Whatever bytes lie in a block folder, reading them ends with a block or with an InputError."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from journaltools import events_of

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import check_for_bridge, read_block
from anaplot.exchange.journal import Journal, read_journal
from anaplot.photogrammetry.block import Block

TOML = b"""format = 1
name = "f"
[test]
kind = "tau"
[[camera]]
id = "k"
c = 150.0
format = [230, 230]
[[strip]]
id = "1"
photos = ["101", "102", "103"]
[[photo]]
id = "101"
camera = "k"
position = [1, 2, 3]
rotation = { omega = 1, phi = 2, kappa = 3, unit = "gon" }
rotation_sigma = { omega = 1, phi = 2, kappa = 3, unit = "rad" }
[[photo]]
id = "102"
camera = "k"
[[photo]]
id = "103"
camera = "k"
"""
POINTS = (
    b'photo,point,x,y,sigma_um,model\n101,1,1.5,2,,\n102,"1",3,4,7,101/102\n102,1,3,4,,102/103\n'
)
CONTROL = b"point,X,Y,Z,sX,sY,sZ,use\n1,10,20,30,0,,1,control\n2,,,5,,,,check\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    path = tmp_path_factory.mktemp("fuzz")
    yield path
    shutil.rmtree(path)


def assert_one_safe_line(error: InputError, folder: Path) -> None:
    assert str(error).isprintable()
    assert str(error).startswith(str(folder))


def read(folder: Path, toml: bytes, points: bytes, control: bytes) -> Block | None:
    for name, data in (
        ("block.toml", toml),
        ("image_points.csv", points),
        ("control.csv", control),
    ):
        (folder / name).write_bytes(data)
    try:
        return read_block(folder)
    except InputError as error:
        assert_one_safe_line(error, folder)
        return None


@st.composite
def damaged(draw: st.DrawFn, original: bytes) -> bytes:
    data = bytearray(original)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(data)))
        length = draw(st.integers(0, 6))
        data[at : at + length] = draw(
            st.binary(max_size=6)
            | st.sampled_from(
                [b"\n", b'"', b",", b"nan", b"1e999", b"[", b"{", b"=", b"\x1b", b"#"]
            )
        )
    return bytes(data)


def test_the_originals_are_good(folder):
    block = read(folder, TOML, POINTS, CONTROL)
    assert block is not None
    assert (len(block.image_points), len(block.control)) == (3, 2)


@pytest.mark.slow
@given(st.binary(max_size=300))
def test_any_bytes_anywhere(folder, data):
    assert read(folder, data, POINTS, CONTROL) is None
    # Bytes that are no header hold no points, and are never taken for an empty file.
    for block in (read(folder, TOML, data, CONTROL), read(folder, TOML, POINTS, data)):
        assert block is None or b"point" in data


@pytest.mark.slow
@settings(max_examples=200)
@given(damaged(TOML))
def test_a_damaged_toml(folder, data):
    block = read(folder, data, POINTS, CONTROL)
    if block is not None:
        with contextlib.suppress(InputError):
            check_for_bridge(block)
        photos = [photo.id for photo in block.photos]
        assert len(set(photos)) == len(photos)
        assert {photo for strip in block.strips for photo in strip.photos} <= set(photos)


@pytest.mark.slow
@settings(max_examples=200)
@given(damaged(POINTS), damaged(CONTROL))
def test_damaged_tables(folder, points, control):
    for block in (read(folder, TOML, points, CONTROL), read(folder, TOML, POINTS, control)):
        if block is not None:
            with contextlib.suppress(InputError):
                check_for_bridge(block)
            assert all(abs(row.x) <= 115.0 and abs(row.y) <= 115.0 for row in block.image_points)
            assert {row.photo for row in block.image_points} <= {"101", "102", "103"}


@pytest.mark.slow
@settings(max_examples=200)
@given(
    st.binary(max_size=200)
    | st.text(max_size=100).map(str.encode)
    | st.builds(
        lambda head, tail: b'{"seq":1,"t":"2026-01-01T00:00:00.000Z","kind":"' + head + tail,
        st.sampled_from([b'header","format":1', b"header", b'x",']),
        st.binary(max_size=40),
    )
)
def test_any_bytes_as_a_journal(tmp_path_factory, data):
    block = tmp_path_factory.mktemp("journal")
    sessions = block / "sessions"
    sessions.mkdir()
    (sessions / "0001.jsonl").write_bytes(data)
    try:
        recovered = read_journal(block)
    except InputError as error:
        assert_one_safe_line(error, block)
        with pytest.raises(InputError):
            Journal.open(block, {})
        assert (sessions / "0001.jsonl").read_bytes() == data
        return
    # Such bytes hold no record: their one line is a torn one, kept aside when the journal opens.
    assert recovered.records == ()
    assert events_of(recovered.records) == ()
    journal, again = Journal.open(block, {})
    journal.close()
    assert again.records == ()
    assert len(again.remarks) == 1
    if data:
        assert (sessions / "0001.jsonl.torn-1").read_bytes() == data
    assert [record.kind for record in read_journal(block).records] == ["header"]
