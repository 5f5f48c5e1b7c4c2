"""One drawing, as a page or a file takes it."""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["Drawing"]

_KEY = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*", re.ASCII)
_LONGEST_KEY = 80


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawing: one `<svg>` element and what it says in words.

    Attributes
    ----------
    key
        Its name within a report, and that of its file without the ending: small letters, digits and
        single hyphens, at most 80. What comes from a file stands in no key.
    title
        One line for people, made plain; stands above the drawing and in its `<title>`.
    description
        What is to be seen, in sentences with numbers, made plain; stands in its `<desc>`.
    caption
        Of the description what nothing in the drawing says; may be "".
    svg
        One `<svg role="img">` element without script, style sheet or reference to anything outside
        it, everything foreign escaped. Its classes are those of `STYLE` in
        `anaplot/drawing/style.py`, which the page holds once; a file of its own is made by
        `anaplot/drawing/standalone.py`.

    Raises
    ------
    ValueError
        A key that could not name a file, or a text that is no `<svg>` element.
    """

    key: str
    title: str
    description: str
    svg: str
    caption: str = ""

    def __post_init__(self) -> None:
        if not _KEY.fullmatch(self.key) or len(self.key) > _LONGEST_KEY:
            raise ValueError(f"no key of a drawing: {self.key!r}")
        if not (self.svg.startswith("<svg ") and self.svg.endswith("</svg>")):
            raise ValueError(f"drawing {self.key} is no svg element")
