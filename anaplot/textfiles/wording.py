"""Words for people: names of files and things in one safe line."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

__all__ = [
    "describe_type",
    "first_of",
    "hint",
    "place",
    "plain",
    "quoted",
    "reason",
    "typed_path",
    "typed_value",
]


def plain(text: str | bytes, limit: int | None = None) -> str:
    r"""Return outside text as one line in which nothing can control a terminal.

    The one function for everything that comes from a file, a device or a person. Letters of all
    languages stay as they are; what is not printable (control characters, line ends, direction
    marks) and every byte that is not ASCII is shown as an escape (``\x1b``, ``\u202e``). Markup is
    the display's business: the text must be shown as plain text.

    Parameters
    ----------
    text
        What a file, a device or a person said.
    limit
        Longest result in characters; more is cut and marked with ``...``.
    """
    most = 10 * len(text) if limit is None else limit  # no escape is longer than ten characters
    if isinstance(text, bytes):
        shown = [
            chr(byte) if 0x20 <= byte < 0x7F else f"\\x{byte:02x}" for byte in text[: most + 1]
        ]
    elif text.isprintable() and len(text) <= most:
        return text
    else:
        shown = [c if c.isprintable() else _escape(ord(c)) for c in text[: most + 1]]
    if sum(map(len, shown)) <= most:
        return "".join(shown)
    while sum(map(len, shown)) > most - 3:
        shown.pop()
    return "".join(shown) + "..."


def _escape(code: int) -> str:
    if code <= 0xFF:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"


def quoted(text: str) -> str:
    """Return text made plain, between quotation marks."""
    return f"'{plain(text, 60)}'"


def first_of(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Return the first of some names, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return between.join(names[:most]) + more


def place(path: Path, line: int | None = None) -> str:
    """Return "FILE line N", or only the file where there is no line."""
    name = plain(str(path), 400)
    return name if line is None else f"{name} line {line}"


def typed_path(path: Path) -> str:
    """Return a path as one types it in a shell, uncut, in one safe line."""
    import shlex  # as difflib

    return plain(shlex.quote(typed_value(path)))


def typed_value(value: object) -> str:
    """Return the text of a value on a command line; a path with a dash first is no option."""
    text = str(value)
    return f".{os.sep}{text}" if isinstance(value, Path) and text.startswith("-") else text


def reason(error: BaseException) -> str:
    """Return why a system call failed, without the file name."""
    if isinstance(error, OSError) and error.strerror:
        return plain(error.strerror, 120)
    return plain(str(error) or type(error).__name__, 120)


def hint(unknown: str, known: Iterable[str], *, listing: bool = True) -> str:
    """Return " (did you mean 'x'?)" for the nearest known name, else a few names in a list."""
    import difflib  # light to start with: every error of the command line passes this module

    names = {name.lower(): name for name in known}
    close = difflib.get_close_matches(unknown[:60].lower(), names, n=1, cutoff=0.6)
    if close:
        return f" (did you mean {quoted(names[close[0]])}?)"
    if listing and 0 < len(names) <= 12:
        return f" (known: {', '.join(plain(name, 60) for name in names.values())})"
    return ""


def describe_type(value: object) -> str:
    """Return what kind of value a file holds, in words."""
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, str):
        return "text"
    if isinstance(value, int | float):
        return "a number"
    if isinstance(value, list | tuple):
        return "a list"
    if isinstance(value, dict):
        return "a table"
    return "nothing" if value is None else "a date or time"
