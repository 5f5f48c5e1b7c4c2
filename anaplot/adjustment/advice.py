"""Advice in words: which row to look at, how sure that is, and what it may be taken for.

"12 to 1 over 104" compares two suspects, and is right in 12 of 13 cases that one of these two is
to blame for. It leaves out that there may be no error, and what the others may have done: both are
said where they are not far behind.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeVar

from anaplot.adjustment.tested import Partner

__all__ = [
    "NOTHING_FLAGGED",
    "hard_to_tell_apart",
    "odds_in_words",
    "other_explanations",
    "remeasure",
    "to_one",
]

NOTHING_FLAGGED = "nothing is flagged"

Row = TypeVar("Row", bound=tuple[str, str])

_CLEAR = 100.0  # to 1: beyond it, what is left out does not matter


def to_one(more: float, less: float) -> str:
    """Return the ratio of two probabilities as odds."""
    if less <= 0.0 or more / less >= 1000.0:
        return "more than 1000 to 1"
    ratio = more / less
    if ratio <= 1e-3:
        return "1 to more than 1000"
    if ratio < 1.0:
        return f"1 to {_number(1.0 / ratio)}"
    return f"{_number(ratio)} to 1"


def odds_in_words(chances: Mapping[str, float], suspect: str, rival: str) -> str:
    """Return the odds of a suspect over its rival, and over what else it may be.

    Parameters
    ----------
    chances
        Probability of every suspect that it holds the one gross error; what they lack to 1 is the
        probability that there is none.
    suspect, rival
        The most probable one, and the next.
    """
    mine = chances[suspect]
    out = f"{to_one(mine, chances[rival])} over {rival}"
    others = [p for name, p in chances.items() if name not in (suspect, rival)]
    # the others together, where they are as much to reckon with as the rival
    if sum(others) >= chances[rival] > 0.0 and mine < _CLEAR * sum(others):
        out += f", {to_one(mine, sum(others))} over all others"
    none = 1.0 - sum(chances.values())
    if none <= mine < _CLEAR * none:
        out += f", {to_one(mine, none)} over no error"
    return out


def remeasure(point: str, axis: str, why: str = "") -> str:
    """Return which coordinate to measure again; `why` follows a colon."""
    return f"remeasure {point} ({axis})" + (f": {why}" if why else "")


def hard_to_tell_apart(first: tuple[str, str], second: tuple[str, str], correlation: float) -> str:
    """Return that the residuals of two rows (point, axis) look alike."""
    names = f"{' '.join(first)} and {' '.join(second)}"
    return f"{names} are hard to tell apart (correlation {correlation:.2f})"


def other_explanations(
    suspect: Row,
    partners: Iterable[Partner[Row]],
    chances: Mapping[str, float],
    none: float,
) -> list[str]:
    """Return what else may be true than that a row (point, axis) is wrong.

    Parameters
    ----------
    suspect
        The most probable row.
    partners
        Pairs of rows that are hard to tell apart.
    chances, none
        Probabilities of every point, and of no gross error.
    """
    out = []
    for partner in partners:
        if suspect in (partner.first, partner.second):
            other = partner.second if partner.first == suspect else partner.first
            out.append(hard_to_tell_apart(suspect, other, partner.correlation))
    point = suspect[0]
    if none > chances[point]:
        out.append(f"no gross error at all: {to_one(none, chances[point])} over {point}")
    return out


def _number(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}"
