"""How wide a text is about to be: enough to lay out labels, since fonts are the reader's."""

from __future__ import annotations

import unicodedata
from functools import lru_cache

from anaplot.drawing.element import shortened

__all__ = ["SMALL", "TEXT", "TINY", "characters_within", "folded", "text_width"]

TEXT, SMALL, TINY = 12.5, 11.0, 9.5
"""Sizes of texts in units of the drawing: of most, of numbers and names, and the smallest."""

_LONGEST_WORD = 40
_BROADEST = 1.06  # of the fonts that may be there
_NARROW = frozenset("iljI.,:;'|!`")
_SLIM = frozenset('frt()[]{}-/\\ "°·')
_BROAD = frozenset("mwMW@%…—")


@lru_cache(maxsize=4096)
def _of(character: str) -> float:
    if character in _NARROW:
        return 0.29
    if character in _SLIM:
        return 0.38
    if character in _BROAD:
        return 0.92
    if unicodedata.combining(character):
        return 0.0
    if unicodedata.east_asian_width(character) in "WF":
        return 1.0
    return 0.68 if character.isupper() else 0.59


def text_width(text: str, size: float = TEXT) -> float:
    """Return the width of a text set in a size, rather too much than too little."""
    return size * sum(map(_of, text)) * _BROADEST


def characters_within(text: str, width: float, size: float, most: int) -> int:
    """Return to how many characters, at most so many, a text is `shortened` to be no wider."""
    count = most
    while count > 1 and text_width(shortened(text, count), size) > width:
        count -= 1
    return count


def folded(text: str, width: float, size: float = TEXT) -> list[str]:
    """Return the lines of a text none of which is wider; long words lose their middle."""
    lines: list[str] = []
    for word in (shortened(each, _LONGEST_WORD) for each in text.split()):
        if lines and text_width(f"{lines[-1]} {word}", size) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines
