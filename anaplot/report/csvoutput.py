"""CSV files that commands write beside their report."""

from __future__ import annotations

import csv
import io
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.wholefile import replace_whole
from anaplot.exchange.wording import place, reason

__all__ = ["check_csv", "write_csv"]


def check_csv(path: Path | None, inputs: Iterable[Path] = (), made: Path | None = None) -> None:
    """Refuse a file that could not be written, before anything is computed or written.

    Parameters
    ----------
    path
        The file that is asked for, or None.
    inputs
        Files that the command reads or writes otherwise.
    made
        A folder that the command makes before it writes the file.

    Raises
    ------
    InputError
        Its folder does not exist, or it is a folder, an input or the standard output itself.
    """
    if path is None:
        return
    try:
        if path.is_dir():
            raise InputError(f"{place(path)}: cannot be written: it is a folder")
        parent = path.parent
        if not parent.is_dir() and (made is None or parent.resolve() != made.resolve()):
            raise InputError(f"{place(path)}: cannot be written: there is no such folder")
        taken = (*inputs, *(() if made is None else (made,)))
        if any(path.resolve() == other.resolve() for other in taken):
            raise InputError(f"{place(path)}: cannot be written: it is in use by the command")
        if path.is_file() and _is_output(path):
            raise InputError(f"{place(path)}: cannot be written: the report goes there")
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be written: {reason(error)}") from error


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table, whole or not at all; None is written as an empty cell.

    Raises
    ------
    InputError
        It could not be written; an old file is as it was.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(header)
    writer.writerows(rows)
    data = text.getvalue().encode()
    try:
        # a pipe or a device is no file that could be replaced
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        target = path.resolve()
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be written: {reason(error)}") from error
    replace_whole(target, data)


def _is_output(path: Path) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(sys.__stdout__.fileno()))  # type: ignore[union-attr]
    except (AttributeError, OSError, ValueError):
        # there is no standard output, or it is no file
        return False
