"""A drawing as a file of its own."""

from __future__ import annotations

from anaplot.drawing.drawing import Drawing
from anaplot.drawing.palette import declarations
from anaplot.drawing.style import STYLE

__all__ = ["standalone"]


def standalone(drawing: Drawing) -> str:
    """Return the text of an SVG file: the drawing with its style, light or dark as the system is.

    Nothing is fetched; the fonts are those of the reader's system.
    """
    style = (
        f"<style>\nsvg{{{declarations('light')}}}\n"
        f"@media (prefers-color-scheme: dark){{svg{{{declarations('dark')}}}}}\n"
        f"{STYLE}</style>"
    )
    end = drawing.svg.index(">") + 1
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        + drawing.svg[:end]
        + style
        + drawing.svg[end:]
        + "\n"
    )
