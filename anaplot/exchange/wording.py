"""Words for people: names of files and things in one safe line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path

__all__ = ["describe_type", "hint", "place", "plain", "quoted", "reason"]


def plain(text: str, limit: int = 120) -> str:
    """Return text as one printable line of bounded length.

    Whatever is not printable (control characters, line ends, direction marks) is shown as an
    escape, so that text from a file never reaches a terminal as a command.
    """
    cut = text if len(text) <= limit else text[:limit] + "..."
    if cut.isprintable():
        return cut
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in cut)


def quoted(text: str) -> str:
    """Return text made plain, between quotation marks."""
    return f"'{plain(text, 60)}'"


def place(path: Path, line: int | None = None) -> str:
    """Return "FILE line N", or only the file where there is no line."""
    name = plain(str(path), 400)
    return name if line is None else f"{name} line {line}"


def reason(error: BaseException) -> str:
    """Return why a system call failed, without the file name."""
    if isinstance(error, OSError) and error.strerror:
        return plain(error.strerror)
    return plain(str(error) or type(error).__name__)


def hint(unknown: str, known: Iterable[str], *, listing: bool = True) -> str:
    """Return " (did you mean 'x'?)" for the nearest known name, else a few names in a list."""
    names = {name.lower(): name for name in known}
    close = difflib.get_close_matches(unknown[:60].lower(), names, n=1, cutoff=0.5)
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
