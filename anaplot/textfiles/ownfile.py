"""Files that anaplot itself writes into: never through a link, never into what is no file."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import check_regular
from anaplot.textfiles.wording import place

__all__ = ["check_own", "is_same", "open_own"]

_FLAGS: int = (
    getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
)


def open_own(path: Path, flags: int) -> int:
    """Open a file for writing, and make it where the flags say so.

    Returns
    -------
    int
        Its descriptor.

    Raises
    ------
    InputError
        There is something else of that name: a link, a pipe, a file that has another name too.
    OSError
        It cannot be opened.
    """
    if os.path.lexists(path):
        check_own(path)
    descriptor = os.open(path, flags | _FLAGS, 0o666)
    try:
        _check(path, os.fstat(descriptor))
        if not is_same(path, descriptor):
            raise InputError(f"{place(path)}: was replaced while it was opened")
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def check_own(path: Path) -> None:
    """Refuse what is not a regular file with one name; raises InputError, or OSError."""
    _check(path, path.lstat())


def is_same(path: Path, descriptor: int) -> bool:
    """Return whether a name still stands for the open file itself."""
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except OSError:
        return False


def _check(path: Path, status: os.stat_result) -> None:
    if stat.S_ISLNK(status.st_mode):
        raise InputError(f"{place(path)}: a link to another file, which is not written to")
    check_regular(path, status)
    if status.st_nlink > 1:
        raise InputError(
            f"{place(path)}: the file has another name too (a hard link) and is not written to"
        )
