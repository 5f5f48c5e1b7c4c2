"""Numbers that have a comma where others have a point, in text whose fields commas do not part."""

from __future__ import annotations

import re
from typing import Final

__all__ = ["parted_by_blanks", "with_point"]

_COMMA: Final = re.compile(r"[+-]?\d{0,30},\d{1,30}(?:[eE][+-]?\d{1,3})?")
_QUOTES: Final = re.compile(r'"[^"]*"')


def with_point(text: str) -> str | None:
    """Return a number with a decimal comma as one with a point; None for any other text."""
    return text.replace(",", ".") if "," in text and _COMMA.fullmatch(text) else None


def parted_by_blanks(line: str) -> bool:
    """Return whether every comma of a line is a decimal one, in words that blanks part.

    `,5` counts as no number here: the comma of `1 ,5` rather parts the two.
    """
    words = _QUOTES.sub("q", line).split()
    commas = [word for word in words if "," in word]
    return len(words) > 1 and all(
        with_point(word) is not None and word.lstrip("+-")[0] != "," for word in commas
    )
