"""The door through which every file comes in: present, regular, of bounded size.

What is not a regular file is refused without waiting for it, and no more is read than was said,
whatever the file's length was when it was opened.
"""

from __future__ import annotations

import io
import os
import stat
from pathlib import Path

from anaplot.errors import InputError
from anaplot.textfiles.wording import place, reason

__all__ = [
    "check_regular",
    "decoded",
    "not_utf8",
    "open_input",
    "read_bytes",
    "read_text",
    "real_path",
]

# A named pipe that took the file's name meanwhile is opened at once, and then refused.
_FLAGS: int = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def real_path(path: Path) -> Path:
    """Return an absolute path without links; a circle of links stays what it is."""
    return Path(os.path.realpath(path))


def open_input(path: Path, max_bytes: int) -> io.BufferedReader:
    """Open a regular file for reading.

    Parameters
    ----------
    path
        The file; a link to one will do.
    max_bytes
        Largest size that is read. Reading beyond it raises InputError, should the file be longer
        than it seemed.

    Raises
    ------
    InputError
        The file is missing, not a regular file, too large or cannot be opened.
    """
    try:
        # Looked at before it is opened: of some devices the opening itself does something.
        _check(path, path.stat(), max_bytes)
        descriptor = os.open(path, _FLAGS)
        try:
            _check(path, os.fstat(descriptor), max_bytes)
        except BaseException:
            os.close(descriptor)
            raise
    except FileNotFoundError:
        raise InputError(f"{place(path)}: file not found") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error
    return io.BufferedReader(_Bounded(path, descriptor, max_bytes))


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """Read a whole file.

    Raises
    ------
    InputError
        As `open_input`.
    """
    with open_input(path, max_bytes) as file:
        try:
            return file.read()
        except OSError as error:
            raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error


def read_text(path: Path, max_bytes: int) -> str:
    """Read a whole UTF-8 file; a byte order mark is tolerated.

    Raises
    ------
    InputError
        As `open_input`, and when the file is not UTF-8 (with the line).
    """
    return decoded(read_bytes(path, max_bytes), path)


def decoded(raw: bytes, path: Path) -> str:
    """Return a UTF-8 file's text without its byte order mark; raises InputError as `read_text`."""
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # The position counts from behind the mark that utf-8-sig leaves out; a mark is no line.
        line = error.object.count(b"\n", 0, error.start) + 1
        raise not_utf8(path, line) from None


def not_utf8(path: Path, line: int | None) -> InputError:
    """Return the error for a file in another encoding."""
    return InputError(f"{place(path, line)}: not UTF-8 text")


class _Bounded(io.RawIOBase):
    """A descriptor, closed with this, from which no more than so many bytes are read."""

    def __init__(self, path: Path, descriptor: int, max_bytes: int) -> None:
        self._path = path
        self._descriptor = descriptor
        self._max = self._left = max_bytes

    def readable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        data = os.read(self._descriptor, len(buffer))
        self._left -= len(data)
        if self._left < 0:
            raise InputError(f"{place(self._path)}: more than {_size(self._max)} is not read")
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        if not self.closed:
            os.close(self._descriptor)
        super().close()


def check_regular(path: Path, status: os.stat_result) -> None:
    """Refuse what is no file: a folder, a pipe, a device; raises InputError."""
    if stat.S_ISREG(status.st_mode):
        return
    what = "a folder, not a file" if stat.S_ISDIR(status.st_mode) else "not a regular file"
    raise InputError(f"{place(path)}: {what}")


def _check(path: Path, status: os.stat_result, max_bytes: int) -> None:
    check_regular(path, status)
    if status.st_size > max_bytes:
        size, limit = _size(status.st_size), _size(max_bytes)
        raise InputError(f"{place(path)}: {size}, more than {limit} is not read")


def _size(count: int) -> str:
    return f"{count / 1e6:.4g} MB" if count >= 1_000_000 else f"{count / 1e3:.4g} kB"
