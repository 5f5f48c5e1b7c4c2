"""Points that help weak photos most, as they are told (Gruen 1980, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from anaplot.planning.stabilizing import WEAK, AddedPoint, StabilizingSet
from anaplot.report.columns import counted
from anaplot.report.document import Answer, Block, Line, Listed, say

__all__ = ["stabilizing_json", "stabilizing_lines"]

_SHOWN = 6


def stabilizing_json(sets: Sequence[StabilizingSet]) -> list[Answer]:
    """Return the sets for programs; coordinates in the photo [mm] and on the ground [m]."""
    return [
        {
            "photo": one.photo,
            "before": one.before,
            "after": one.after,
            "low_before": one.low_before,
            "low_after": one.low_after,
            "points": [point._asdict() for point in one.points],
        }
        for one in sets
    ]


def stabilizing_lines(
    sets: Sequence[StabilizingSet], added: Sequence[AddedPoint] | None = None
) -> list[Block]:
    """Return what to measure in weak photos; the largest set of each, and what fewer reach.

    Parameters
    ----------
    sets
        Of all weak photos, those of one after another.
    added
        Points that are planned already; None: nothing was asked for.
    """
    page: list[Block] = []
    if added is not None:
        none = "" if added else f": no photo's mean r is below {WEAK:g} of the median photo's"
        page.append(
            say("{} planned beside the standard ones{}", counted(len(added), "point"), none)
        )
    if sets:
        page.append(say("what would help most, at (x, y) in the photo [mm]:"))
        lines = [
            line for _, of in groupby(sets, key=lambda one: one.photo) for line in _lines(list(of))
        ]
        page.append(Listed(tuple(lines), 2 * _SHOWN, ""))
    return page


def _lines(sets: list[StabilizingSet]) -> tuple[Line, Line]:
    most = sets[-1]
    reached = ", ".join(f"{one.after:.3f} with {len(one.points)}" for one in sets)
    places = ", ".join(f"({point.x:.0f}, {point.y:.0f})" for point in most.points)
    return (
        say("  {:<6} mean r {:.3f}, {} points", most.photo, most.before, reached),
        say("         {}", places),
    )
