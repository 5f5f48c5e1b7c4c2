"""Opening a file that a person wrote: present, regular, of bounded size, UTF-8."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from anaplot.errors import InputError
from anaplot.exchange.wording import place, reason

__all__ = ["not_utf8", "open_input", "read_text"]


def open_input(path: Path, max_bytes: int) -> BinaryIO:
    """Open a regular file for reading.

    Parameters
    ----------
    path
        The file.
    max_bytes
        Largest size that is read.

    Raises
    ------
    InputError
        The file is missing, not a regular file, too large or cannot be opened.
    """
    try:
        # Looked at before it is opened: opening a named pipe would wait for a writer.
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(f"{place(path)}: not a regular file")
        file = path.open("rb")
    except FileNotFoundError:
        raise InputError(f"{place(path)}: file not found") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error
    size = os.fstat(file.fileno()).st_size
    if size > max_bytes:
        file.close()
        limit = f"{max_bytes / 1e6:g} MB"
        raise InputError(f"{place(path)}: {size / 1e6:.1f} MB, more than {limit} is not read")
    return file


def read_text(path: Path, max_bytes: int) -> str:
    """Read a whole UTF-8 file; a byte order mark is tolerated.

    Raises
    ------
    InputError
        As `open_input`, and when the file is not UTF-8 (with the line).
    """
    with open_input(path, max_bytes) as file:
        try:
            data = file.read(max_bytes + 1)
        except OSError as error:
            raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # The position counts from behind the mark that utf-8-sig leaves out; a mark is no line.
        line = error.object.count(b"\n", 0, error.start) + 1
        raise not_utf8(path, line) from None


def not_utf8(path: Path, line: int | None) -> InputError:
    """Return the error for a file in another encoding."""
    return InputError(f"{place(path, line)}: not UTF-8 text")
