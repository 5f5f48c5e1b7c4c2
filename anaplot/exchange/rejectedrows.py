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
]

STRATEGIES: tuple[SwitchedBy, ...] = get_args(SwitchedBy)
# before a strategy's name alone the row counted whole, and nobody had said anything of it
_BEFORE = re.compile(r"(?P<name>\w+)(; before: (?P<use>xy|x|y)(, (?P<reason>.*))?)?", re.DOTALL)


def said_by(reason: str | None) -> SwitchedBy | None:
    """Return the strategy whose reason that is; None of a person's, and where there is none."""
    match = None if reason is None else _BEFORE.fullmatch(reason)
    return next((s for s in STRATEGIES if match is not None and s == match["name"]), None)


def rejects(row: ImagePoint) -> bool:
    """Whether a strategy has switched off something of a row."""
    return said_by(row.reason) is not None


def rejecting_reason(strategy: SwitchedBy, use: Use, reason: str | None) -> str:
    """Return the reason of a row that a strategy rejects.

    Parameters
    ----------
    strategy
        Its name.
    use, reason
        Of the row before.
    """
    before = "" if use == "xy" and reason is None else f"; before: {use}"
    return strategy + before + ("" if reason is None else f", {reason}")


def as_before(row: ImagePoint, strategies: Iterable[str] = STRATEGIES) -> ImagePoint:
    """Return a row as it was before some strategies' rejections were applied."""
    names = frozenset(strategies)
    while said_by(row.reason) in names:
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


def _one_before(row: ImagePoint) -> ImagePoint:
    match = _BEFORE.fullmatch(row.reason or "")
    assert match is not None
    return replace(row, use=cast("Use", match["use"] or "xy"), reason=match["reason"])
