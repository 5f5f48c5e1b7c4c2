"""A folder of files is there wholly, or as it was."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from anaplot.errors import InputError
from anaplot.textfiles.wholefile import create_folder, write_together


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


def contents(folder: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in folder.iterdir()}


def test_files_are_replaced_together_or_not_at_all(tmp_path: Path) -> None:
    before = {"a": b"1", "b": b"2"}
    for name, data in before.items():
        (tmp_path / name).write_bytes(data)

    def files(last: bool) -> Iterator[tuple[Path, bytes]]:
        yield tmp_path / "new", b"3"
        yield tmp_path / "a", b"other"
        if not last:
            raise InputError("the last cannot be made")
        yield tmp_path / "b", b"another"

    with pytest.raises(InputError, match="the last"):
        write_together(files(last=False))
    assert contents(tmp_path) == before
    with pytest.raises(InputError, match="/none/a: cannot be written: No such file"):
        write_together([(tmp_path / "a", b"other"), (tmp_path / "none" / "a", b"")])
    assert contents(tmp_path) == before
    write_together(files(last=True))
    assert contents(tmp_path) == {"a": b"other", "b": b"another", "new": b"3"}


def test_what_comes_meanwhile_is_not_written_over(tmp_path: Path) -> None:
    def files() -> Iterator[tuple[Path, bytes]]:
        yield tmp_path / "new", b"mine"
        (tmp_path / "new").write_bytes(b"another's")
        yield tmp_path / "more", b"mine"

    with pytest.raises(InputError, match="new: exists already"):
        write_together(files())
    assert contents(tmp_path) == {"new": b"another's"}
