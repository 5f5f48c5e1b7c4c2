"""A folder of files is there wholly, or as it was."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from anaplot.errors import InputError
from anaplot.textfiles.wholefile import create_folder


def test_a_folder_and_those_around_it_are_made(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    files = create_folder(folder, [("one", b"1"), ("two", iter([b"2", b"", b"3"]))])
    assert files == (folder / "one", folder / "two")
    assert [file.read_bytes() for file in files] == [b"1", b"23"]
    assert sorted(entry.name for entry in folder.iterdir()) == ["one", "two"]


def failing() -> Iterator[bytes]:
    yield b"begun"
    raise InputError("cannot be made")


@pytest.mark.parametrize("last", [("there", b"mine"), ("new", failing())])
def test_what_fails_leaves_what_was(tmp_path: Path, last: tuple[str, bytes]) -> None:
    old = tmp_path / "old"
    old.mkdir()
    (old / "there").write_bytes(b"before")
    with pytest.raises(InputError):
        create_folder(old, [("one", b"1"), last])
    assert {entry.name: entry.read_bytes() for entry in old.iterdir()} == {"there": b"before"}


def test_a_folder_that_was_made_for_nothing_goes(tmp_path: Path) -> None:
    def files() -> Iterator[tuple[str, bytes]]:
        yield "one", b"1"
        raise InputError("the second cannot be made")

    with pytest.raises(InputError, match="the second"):
        create_folder(tmp_path / "a" / "b", files())
    assert not list(tmp_path.iterdir())
