"""The point patterns of the paper (1983, Figures 1, 2, 4 and 7): where their points lie.

Standard points: 1, 2, 3 are the upper, middle and lower point under the left projection centre,
4, 5, 6 the same under the right one, 7, 8, 9 the column between them. In a regular pattern of four
or five lines 12 lies between 1 and 2, 23 between 2 and 3, and so on. A doubled point is two points
a few millimetres apart: 1 and 1'.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from anaplot.aliases import Side
from anaplot.errors import InputError
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "FEWEST_TIES",
    "PATTERNS",
    "USUAL_BASE",
    "USUAL_C",
    "USUAL_D",
    "Pattern",
    "pattern",
]

USUAL_BASE, USUAL_D, USUAL_C = 90.0, 100.0, 152.0
"""Base at photo scale, half the model in y and camera constant [mm], where none are asked for."""

FEWEST_TIES = 3
"""Ties of a pattern that has any."""

_COLUMN = {"1": 0, "2": 0, "3": 0, "7": 1, "8": 1, "9": 1, "4": 2, "5": 2, "6": 2}
_LINE = {"1": 1, "7": 1, "4": 1, "2": 0, "8": 0, "5": 0, "3": -1, "9": -1, "6": -1}
_UPPER = "174"  # between one of these and the point below it lies the second line
_UNDER_RIGHT = str.maketrans("456", "123")
_TWIN = "'"


@dataclass(frozen=True, slots=True)
class Pattern:
    """A pattern of orientation points.

    Attributes
    ----------
    name
        "13" without ties (a strip's first model), "13/5" with five of them.
    arrangement
        How its points lie, in words.
    labels
        Labels of its points in the order of measurement; "1'" is the twin of "1".
    ties
        Labels of the points that the model shares with the preceding one.
    lines
        On how many equally spaced lines along the flight its points lie.
    """

    name: str
    arrangement: str
    labels: tuple[str, ...]
    ties: tuple[str, ...] = ()
    lines: int = 3

    def positions(
        self, base: float, d: float, twin: tuple[float, float] = (0.0, 0.0)
    ) -> dict[str, tuple[float, float]]:
        """Return where the points lie in the left photo [mm], photos vertical, ground flat.

        Parameters
        ----------
        base
            Base at photo scale [mm]; points lie at x = 0, base / 2 and base.
        d
            Distance of the upper and lower points from the x axis [mm].
        twin
            Displacement [mm] in x and y of a doubled point from its original, towards the
            model's middle; along the flight for points of the middle column.
        """
        out = {}
        for label in self.labels:
            point = label[0]
            column, line = _COLUMN[point], self._line(label)
            x, y = 0.5 * base * column, d * line
            if label.endswith(_TWIN):
                x += -twin[0] if column == 2 else twin[0]
                y -= line * twin[1]
            out[label] = (x, y)
        return out

    @property
    def usual_base(self) -> float:
        """The base [mm] with which it is judged."""
        return USUAL_BASE

    @property
    def transferred(self) -> tuple[str, ...]:
        """Labels of the points that are looked for in the preceding model: the left column."""
        return tuple(label for label in self.labels if _COLUMN[label[0]] == 0)

    def under(self, label: str) -> tuple[Side, str]:
        """Return after which photo a new point is named, and how there.

        It is the photo under which it lies: 4 is the point 1 of the right one.
        """
        under_right = label.translate(_UNDER_RIGHT)
        return ("left", label) if under_right == label else ("right", under_right)

    def _line(self, label: str) -> float:
        """Return how far up a point lies, from -1 to 1."""
        label = label.removesuffix(_TWIN)
        if len(label) == 1:
            return _LINE[label]
        # the line next to the middle, or the middle's neighbour
        step = (self.lines - 3) / (self.lines - 1)
        return step if label[0] in _UPPER else -step


_SIX = ("1", "2", "3", "4", "5", "6")
_DOUBLED = ("1", "1'", "2", "3", "3'", "4", "4'", "5", "6", "6'")
_EIGHT = ("1", "12", "23", "3", "4", "45", "56", "6")
_TEN = ("1", "12", "2", "23", "3", "4", "45", "5", "56", "6")
_NAMED = (
    Pattern("6", "2 x 3", _SIX),
    Pattern("8", "2 x 4", _EIGHT, lines=4),
    Pattern("9", "3 x 3", (*_SIX, "7", "8", "9")),
    Pattern("10", "2 x 5", _TEN, lines=5),
    Pattern("10d", "2 x 3, corners doubled", _DOUBLED),
    Pattern("12", "3 x 4", (*_EIGHT, "7", "78", "89", "9"), lines=4),
    Pattern("13", "3 x 3, corners doubled", (*_DOUBLED, "7", "8", "9")),
    Pattern("15", "3 x 3, all outer points doubled", (*_DOUBLED, "7", "7'", "8", "9", "9'")),
    Pattern("15r", "3 x 5", (*_TEN, "7", "78", "8", "89", "9"), lines=5),
)


def _patterns() -> dict[str, Pattern]:
    out = {}
    for one in _NAMED:
        standard = tuple(label for label in one.transferred if len(label) == 1)
        out[one.name] = one
        for ties in sorted({standard, one.transferred}, key=len):
            if len(ties) >= FEWEST_TIES:
                name = f"{one.name}/{len(ties)}"
                out[name] = replace(one, name=name, ties=ties)
    return out


PATTERNS: Mapping[str, Pattern] = MappingProxyType(_patterns())
"""Patterns by name: "6", "6/3", "8", "8/4", ... "15r/5"; arrangements are columns x lines.

Ties are all points of the left column, or the three of them at standard places.
"""


def pattern(name: str) -> Pattern:
    """Return a pattern by its name.

    Raises
    ------
    InputError
        There is no such pattern; names the nearest, or all.
    """
    try:
        return PATTERNS[name]
    except KeyError:
        near = hint(name, PATTERNS, listing=False)
        names = ", ".join(one.name for one in _NAMED)
        known = near or f"; there are {names} and with ties 13/5"
        raise InputError(f"no point pattern {quoted(name)}{known}") from None
