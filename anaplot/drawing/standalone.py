"""A drawing as a file of its own."""

from __future__ import annotations

from anaplot.drawing.drawing import Drawing
from anaplot.drawing.palette import declarations
from anaplot.drawing.style import STYLE

__all__ = ["is_standalone", "standalone"]

_BEGINS = '<?xml version="1.0" encoding="UTF-8"?>\n'
_STYLES = "<style>\nsvg"


def is_standalone(head: bytes) -> bool:
    """Return whether a file that begins like this is one of them."""
    return head.startswith(f"{_BEGINS}<svg".encode()) and _STYLES.encode() in head


def standalone(drawing: Drawing) -> str:
    """Return the text of an SVG file: the drawing with its style, light or dark as the system is.

    Nothing is fetched; the fonts are those of the reader's system.
    """
    style = (
        f"{_STYLES}{{{declarations('light')}}}\n"
        f"@media (prefers-color-scheme: dark){{svg{{{declarations('dark')}}}}}\n"
        f"{STYLE}</style>"
    )
    end = drawing.svg.index(">") + 1
    return _BEGINS + drawing.svg[:end] + style + drawing.svg[end:] + "\n"
