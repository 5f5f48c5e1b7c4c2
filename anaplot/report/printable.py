"""Text made safe for a terminal; light, because every error of the command line passes here."""

from __future__ import annotations

__all__ = ["printable"]


def printable(text: str) -> str:
    """Return text in which nothing can control a terminal: such characters are shown escaped."""
    if text.isprintable():
        return text
    return "".join(ch if ch.isprintable() else ch.encode("unicode_escape").decode() for ch in text)
