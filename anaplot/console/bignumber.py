"""Numbers three lines high, to be read from across the room."""

from __future__ import annotations

from textual.renderables.digits import DIGITS, DIGITS3X3_BOLD

__all__ = ["big_number"]


def big_number(value: float | None) -> tuple[str, str, str]:
    """Return a number with its sign as three lines, as wide whatever the number is.

    There is room for three digits before the point, and three stand behind it; None is a dash.
    """
    width = 3 * (1 + 3 + 3) + 1
    if value is None:
        return " " * width, "╺━╸".rjust(width), " " * width
    shown = f"{value:+.3f}"
    if not shown.strip("+-0."):
        shown = f" {shown[1:]}"  # nothing has no sign
    rows: list[list[str]] = [[], [], []]
    for character in shown:
        if character == ".":
            parts = [" ", " ", "."]
        else:
            place = 3 * DIGITS.index(character)
            parts = [line.ljust(3) for line in DIGITS3X3_BOLD[place : place + 3]]
        for row, part in zip(rows, parts, strict=True):
            row.append(part)
    upper, middle, lower = ("".join(row).rjust(width) for row in rows)
    return upper, middle, lower
