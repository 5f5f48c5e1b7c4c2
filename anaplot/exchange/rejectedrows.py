"""Rows that `anaplot adjust --apply` switched off; the reason says how they were."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import cast, get_args

from anaplot.aliases import Axis, SwitchedBy
from anaplot.photogrammetry.block import ImagePoint, Use

__all__ = [
    "STRATEGIES",
    "as_before",
    "rejected_axes",
    "rejecting_reason",
    "rejects",
    "said_by",
    "times_applied",
]

STRATEGIES: tuple[SwitchedBy, ...] = get_args(SwitchedBy)
# before a strategy's name alone the row counted whole, and nobody had said anything of it
_BEFORE = re.compile(
    r"(?P<name>\w+)(; apply: (?P<time>[1-9][0-9]{0,5}))?"
    r"(; before: (?P<use>xy|x|y)(, (?P<reason>.*))?)?",
    re.DOTALL,
)


def said_by(reason: str | None) -> SwitchedBy | None:
    """Return the strategy whose reason that is; None of a person's, and where there is none."""
    match = _BEFORE.fullmatch(reason) if reason else None
    return None if match is None else next((s for s in STRATEGIES if s == match["name"]), None)


def rejects(row: ImagePoint) -> bool:
    """Whether a strategy has switched off something of a row."""
    return said_by(row.reason) is not None


def rejecting_reason(strategy: SwitchedBy, use: Use, reason: str | None, time: int = 1) -> str:
    """Return the reason of a row that a strategy rejects.

    Parameters
    ----------
    strategy
        Its name.
    use, reason
        Of the row before.
    time
        Which time it is that the strategy's rejections are applied, from 1.
    """
    again = "" if time == 1 else f"; apply: {time}"
    before = "" if use == "xy" and reason is None else f"; before: {use}"
    return strategy + again + before + ("" if reason is None else f", {reason}")


def times_applied(rows: Iterable[ImagePoint]) -> dict[SwitchedBy, int]:
    """Return how many times the rejections of each strategy were applied, as the rows tell.

    Rows that somebody else gave the name of a strategy are of the first time.
    """
    times: dict[SwitchedBy, int] = {}
    for row in rows:
        while (strategy := said_by(row.reason)) is not None:
            times[strategy] = max(times.get(strategy, 1), _time(row.reason))
            row = _one_before(row)
    return times


def as_before(
    row: ImagePoint,
    strategies: Iterable[str] = STRATEGIES,
    times: Mapping[SwitchedBy, int] | None = None,
) -> ImagePoint:
    """Return a row as it was before some strategies' rejections were applied.

    Parameters
    ----------
    row
        The row.
    strategies
        Their names.
    times
        Which time alone is meant of each; None: every time.
    """
    names = frozenset(strategies)
    while (strategy := said_by(row.reason)) in names:
        assert strategy is not None
        if times is not None and times.get(strategy) != _time(row.reason):
            break
        row = _one_before(row)
    return row


def rejected_axes(row: ImagePoint) -> Mapping[Axis, SwitchedBy]:
    """Return the coordinates of a row that strategies have switched off, and which did."""
    out: dict[Axis, SwitchedBy] = {}
    axes: tuple[Axis, ...] = ("x", "y")
    while (strategy := said_by(row.reason)) is not None:
        before = _one_before(row)
        out |= {a: strategy for a in axes if before.counts(a) and not row.counts(a)}
        row = before
    return out


def _time(reason: str | None) -> int:
    """Return which time it was that a strategy said that."""
    return int(_said(reason)["time"] or 1)


def _one_before(row: ImagePoint) -> ImagePoint:
    match = _said(row.reason)
    return replace(row, use=cast("Use", match["use"] or "xy"), reason=match["reason"])


def _said(reason: str | None) -> re.Match[str]:
    match = _BEFORE.fullmatch(reason or "")
    assert match is not None
    return match
