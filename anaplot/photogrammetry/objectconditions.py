"""Conditions between points of the object: distances, lines, planes, angles, equal distances."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Literal

__all__ = ["ConditionKind", "ConditionUse", "ObjectCondition", "condition_fault"]

ConditionKind = Literal["distance", "line", "plane", "angle", "equal"]
ConditionUse = Literal["control", "check", "off"]

_LEAST = {"line": 3, "plane": 4}


@dataclass(frozen=True, slots=True)
class ObjectCondition:
    """Something that is known of several points together (Gruen 1978, section B).

    Attributes
    ----------
    kind
        "distance" between two points; points on a "line" or a "plane"; an "angle" at the second of
        three points, between the other two; "equal" distances, of which every two points are one.
    points
        Their names.
    value
        Distance [m] or angle [rad]; None of the others.
    sigma
        Standard deviation [m, rad] of the distance or angle, of every point from the line or plane,
        of each of the equal distances from what they have in common; 0 is free of error.
    use
        "control": it takes part; "check": it is compared; "off".
    where
        File and line that it stands in, or "".
    """

    kind: ConditionKind
    points: tuple[str, ...]
    value: float | None
    sigma: float
    use: ConditionUse = "control"
    where: str = ""

    @property
    def id(self) -> str:
        """What it is called: where it stands, or kind and points."""
        return self.where or f"{self.kind} {' '.join(self.points)}"


def condition_fault(kind: str, points: tuple[str, ...], value: float | None) -> str | None:
    """Return what is wrong with a condition whatever the coordinates; None where nothing is."""
    count = len(points)
    if kind == "distance" and count != 2:
        return f"{count} points where a distance has two"
    if kind == "angle" and count != 3:
        return f"{count} points where an angle has three, its vertex in the middle"
    if kind in _LEAST and count < _LEAST[kind]:
        return f"{count} points lie on a {kind} in any case: at least {_LEAST[kind]} points"
    if kind == "equal" and (count < 4 or count % 2):
        return f"{count} points where equal distances have two each, and there are two at least"
    sets = [points]
    if kind == "equal":
        pairs = list(zip(points[::2], points[1::2], strict=True))
        unordered = [frozenset(pair) for pair in pairs]
        if len(set(unordered)) < len(pairs):
            return "the same distance twice"
        sets = [tuple(pair) for pair in pairs]
    for names in sets:
        twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
        if twice is not None:
            return f"point {twice} twice"
    if kind in ("line", "plane", "equal"):
        return None if value is None else f"a value where {kind} has none"
    if value is None:
        return f"no value of the {kind}"
    if kind == "distance" and not 0.0 < value < float("inf"):
        return f"a distance of {value:g} m"
    if kind == "angle" and not 0.0 < value < pi:
        return f"an angle of {value:g} rad (between 0 and pi; at either end it is a line)"
    return None
