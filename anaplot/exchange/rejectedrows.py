"""Rows that `anaplot adjust --apply` switched off; the reason says how they were."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import takewhile
from typing import cast, get_args

from anaplot.aliases import Axis, SwitchedBy
from anaplot.errors import InputError
from anaplot.photogrammetry.block import ImagePoint, Use
from anaplot.textfiles.wording import quoted

__all__ = [
    "STRATEGIES",
    "as_before",
    "chain",
    "last_times",
    "next_time",
    "own_text",
    "rejected_axes",
    "rejecting_reason",
    "rejects",
    "said_by",
]

STRATEGIES: tuple[SwitchedBy, ...] = get_args(SwitchedBy)
# more than that nobody has applied: a higher number is a person's own text
_MAX_TIME = 9999
# before a strategy's name alone the row counted whole, and nobody had said anything of it
_BEFORE = re.compile(
    r"(?P<name>\w+)(; apply: (?P<time>[1-9][0-9]{0,3}))?"
    r"(; before: (?P<use>xy|x|y)(, (?P<reason>.*))?)?",
    re.DOTALL,
)


def said_by(reason: str | None) -> SwitchedBy | None:
    """Return the strategy whose reason that is; None of a person's, and where there is none."""
    match = _BEFORE.fullmatch(reason) if reason else None
    return None if match is None else _strategy(match)


def own_text(reason: str) -> str:
    """Return what a person says in a reason, without what strategies have put before it."""
    while (match := _BEFORE.fullmatch(reason)) and _strategy(match) is not None:
        reason = match["reason"] or ""
    return reason


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

    Raises
    ------
    InputError
        The time could not be read again.
    """
    if time > _MAX_TIME:
        last = f"{strategy}; apply: {_MAX_TIME}"
        raise InputError(f"reason {quoted(last)} is the last: no row goes after that one")
    again = "" if time == 1 else f"; apply: {time}"
    before = "" if use == "xy" and reason is None else f"; before: {use}"
    return strategy + again + before + ("" if reason is None else f", {reason}")


def next_time(rows: Iterable[ImagePoint], strategy: SwitchedBy) -> int:
    """Return which time it is that a strategy's rejections are applied to some rows.

    Rows that somebody else gave the name of a strategy are of the first time.
    """
    times = (time for row in rows for said, time in chain(row) if said == strategy)
    return max(times, default=0) + 1


def last_times(rows: Iterable[ImagePoint], strategies: Collection[str]) -> dict[SwitchedBy, int]:
    """Return which time of some strategies is to be taken back first.

    That is the latest of those above which no other strategy has switched off anything.
    Where times were written by hand so that none is before all others, it is the latest of those
    that were the last of their rows.
    """
    every: dict[SwitchedBy, int] = {}
    tops: dict[SwitchedBy, int] = {}
    chains = [said for said in map(chain, rows) if said]
    for said in chains:
        for strategy, time in takewhile(lambda one: one[0] in strategies, said):
            every[strategy] = max(every.get(strategy, 1), time)
        strategy, time = said[0]
        if strategy in strategies:
            tops[strategy] = max(tops.get(strategy, 1), time)
    follow = any(every.get(said[0][0]) == said[0][1] for said in chains)
    return every if follow else tops


def chain(row: ImagePoint) -> list[tuple[SwitchedBy, int]]:
    """Return which strategies have switched off something of a row, the last first, and when."""
    return [(strategy, time) for strategy, time, _ in _links(row)]


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
    for strategy, time, before in _links(row):
        if strategy not in names or (times is not None and times.get(strategy) != time):
            break
        row = before
    return row


def rejected_axes(row: ImagePoint) -> Mapping[Axis, SwitchedBy]:
    """Return the coordinates of a row that strategies have switched off, and which did."""
    out: dict[Axis, SwitchedBy] = {}
    axes: tuple[Axis, ...] = ("x", "y")
    for strategy, _, before in _links(row):
        out |= {a: strategy for a in axes if before.counts(a) and not row.counts(a)}
        row = before
    return out


def _links(row: ImagePoint) -> Iterator[tuple[SwitchedBy, int, ImagePoint]]:
    """Yield which strategies have switched off something of a row, when, and the row before.

    The last comes first.
    """
    while row.reason and (match := _BEFORE.fullmatch(row.reason)):
        strategy = _strategy(match)
        if strategy is None:
            return
        row = replace(row, use=cast("Use", match["use"] or "xy"), reason=match["reason"])
        yield strategy, int(match["time"] or 1), row


def _strategy(match: re.Match[str]) -> SwitchedBy | None:
    return next((s for s in STRATEGIES if s == match["name"]), None)
