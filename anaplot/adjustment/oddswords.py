"""Odds in words: "12 to 1 over 104, 3.1 to 1 over no error".

"12 to 1 over 104" compares two suspects, and is right in 12 of 13 cases that one of these two is
to blame for. It leaves out that there may be no error, and what the others may have done: both are
said where they are not far behind.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["odds_in_words", "to_one"]

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


def odds_in_words(chances: Mapping[str, float], accused: str, rival: str) -> str:
    """Return the odds of a suspect over its rival, and over what else it may be.

    Parameters
    ----------
    chances
        Probability of every suspect that it holds the one gross error; what they lack to 1 is the
        probability that there is none.
    accused, rival
        The suspect, and the next one.
    """
    mine = chances[accused]
    out = f"{to_one(mine, chances[rival])} over {rival}"
    others = [p for name, p in chances.items() if name not in (accused, rival)]
    # the others together, where they are as much to reckon with as the rival
    if sum(others) >= chances[rival] > 0.0 and mine < _CLEAR * sum(others):
        out += f", {to_one(mine, sum(others))} over all others"
    none = 1.0 - sum(chances.values())
    if none <= mine < _CLEAR * none:
        out += f", {to_one(mine, none)} over no error"
    return out


def _number(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}"
