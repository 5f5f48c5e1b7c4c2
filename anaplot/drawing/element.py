"""Elements of SVG as text: what is foreign is escaped here, and nowhere else.

Markup has a type of its own, `Svg`; a name out of a file is a `str` and becomes markup only by
`text` or as an attribute.
"""

from __future__ import annotations

from typing import NewType

from anaplot.drawing.pathdata import number
from anaplot.textfiles.wording import plain

__all__ = ["NOTHING", "Svg", "element", "escaped", "joined", "shortened", "text"]

Svg = NewType("Svg", str)
"""Markup: well-formed, everything foreign escaped."""

NOTHING = Svg("")

_LONGEST = 2000  # characters of one text
_MARKUP = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#39;"})


def escaped(text: str) -> Svg:
    """Return outside text as text of XML: no control character, direction mark or markup in it."""
    return Svg(plain(text, _LONGEST).translate(_MARKUP))


def shortened(text: str, most: int) -> str:
    """Return a name without its middle where it has more than `most` characters, made plain."""
    name = plain(text, _LONGEST)
    if len(name) <= most:
        return name
    tail = (most - 1) // 2
    return f"{name[: most - 1 - tail]}…{name[len(name) - tail :]}"


def element(tag: str, content: Svg = NOTHING, **attributes: str | float | None) -> Svg:
    """Return an element.

    Parameters
    ----------
    tag
        Name, not foreign.
    content
        What stands in it.
    **attributes
        Their names with "_" for "-" ("class_": without the last); numbers are written shortly;
        None: not there.
    """
    pairs = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{_value(value)}"'
        for name, value in attributes.items()
        if value is not None
    )
    return Svg(f"<{tag}{pairs}>{content}</{tag}>" if content else f"<{tag}{pairs}/>")


def _value(value: str | float) -> str:
    if not isinstance(value, str):
        return number(value)
    # paths are long and ours: nothing in them is to be escaped
    return value if value.isascii() and value.isprintable() and _harmless(value) else escaped(value)


def _harmless(value: str) -> bool:
    return not any(mark in value for mark in "&<>\"'")


def joined(*parts: Svg) -> Svg:
    """Return elements one after another."""
    return Svg("".join(parts))


def text(
    x: float,
    y: float,
    content: str,
    classes: str = "",
    *,
    most: int | None = None,
    turned: bool = False,
) -> Svg:
    """Return text at a place.

    Parameters
    ----------
    x, y
        Where its line begins, or as `classes` says (t-mid, t-end).
    content
        Anything, also foreign.
    classes
        Of `STYLE`.
    most
        Characters; where there are more, the middle is left out and the whole is shown when the
        pointer rests on it.
    turned
        Whether it is read from the right.
    """
    shown = content if most is None else shortened(content, most)
    inner = escaped(shown)
    if shown != content:
        inner = joined(element("title", escaped(content)), inner)
    return element(
        "text",
        inner,
        class_=classes or None,
        x=x,
        y=y,
        transform=f"rotate(-90 {number(x)} {number(y)})" if turned else None,
    )
