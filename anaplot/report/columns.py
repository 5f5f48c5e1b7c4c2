"""Tables and lists that keep to the width of a page."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.textfiles.wording import plain

__all__ = ["PAGE", "cell", "column", "counted", "fitted", "shortened", "wrapped"]

PAGE = 80
_GAP = "..."


def counted(number: float, one: str, more: str | None = None) -> str:
    """Return how many there are of something, in words for one and for several."""
    shown = f"{number:g}" if isinstance(number, float) else str(number)
    return f"{shown} {one if number == 1 else more or one + 's'}"


def shortened(name: str, width: int) -> str:
    """Return a name made plain, in at most `width` characters.

    A long one keeps its two ends: names of a family differ at their ends.
    """
    text = plain(name)
    if len(text) <= width:
        return text
    kept = width - len(_GAP)
    return text[: (kept + 1) // 2] + _GAP + text[len(text) - kept // 2 :]


def fitted(value: float | None, decimals: int, width: int) -> str:
    """Return a number in at most `width` characters, "-" for None.

    A large one has fewer decimals, or an exponent; one that is too wide even so is not cut. What is
    rounded to nothing has no sign.
    """
    if value is None:
        return "-"
    forms = [f"{value:z.{n}f}" for n in range(decimals, -1, -1)]
    forms += [f"{value:.1e}", f"{value:.0e}"]
    return next((text for text in forms if len(text) <= width), forms[-1])


def column(text: str | int, width: int) -> str:
    """Return a cell with its text at the right, and never without a space before it."""
    return f" {text:>{width - 1}}"


def cell(value: float | None, decimals: int, width: int) -> str:
    """Return a number at the right of a cell that never touches its neighbour; "-" for None."""
    return column(fitted(value, decimals, width - 1), width)


def wrapped(
    head: str, items: Iterable[str], *, separator: str = ", ", indent: str = "    "
) -> list[str]:
    """Return lines of items, no item broken, that begin with `head` and go on after `indent`."""
    lines = [head]
    empty = True
    for item in items:
        if not empty:
            lines[-1] += separator.rstrip()
        gap = "" if empty and lines[-1].endswith(" ") else " " * (not empty)
        if not empty and len(lines[-1]) + len(gap) + len(item) + len(separator.rstrip()) > PAGE:
            lines.append(indent + item)
        else:
            lines[-1] += gap + item
        empty = False
    return lines
