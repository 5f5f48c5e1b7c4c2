"""Which two of some points are exchanged: with these alone a similarity joins all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.similarity import Similarity, closed_form

__all__ = ["ControlRemark", "ExchangedPair", "exchanged_pairs", "likely_exchange"]

_ALL_PAIRS = 40  # points of which every two are exchanged
_AS_ONE = 0.2  # of what is left as they are: what two that were exchanged leave
_MOST_PAIRS = 3  # of them
_CLEARLY = 20.0  # times better than as they are
_ALONE = 5.0  # times better than with another two exchanged, which else may be it as well


class ExchangedPair(NamedTuple):
    """Two points that may have been exchanged.

    Attributes
    ----------
    first, second
        Which.
    left
        What all points miss their targets by with these two exchanged, root of the mean square.
    fitted
        The similarity that leaves it.
    """

    first: int
    second: int
    left: float
    fitted: Similarity


def exchanged_pairs(source: Array, target: Array) -> tuple[list[ExchangedPair], float]:
    """Find two points with whose targets exchanged a similarity leaves a fifth at most.

    In what is symmetric there are several: of a level rectangle with two corners exchanged the
    other two corners are a second pair, upside down.

    Parameters
    ----------
    source, target
        (n, 3) points before and after; four at least, and at most as many as have few pairs.

    Returns
    -------
    list of ExchangedPair
        Three at most, that which leaves least first.
    float
        What a similarity leaves with the targets as they are.
    """
    n = len(source)
    if not 4 <= n <= _ALL_PAIRS:
        return [], 0.0
    pairs = np.array(list(combinations(range(n), 2)))
    targets = np.repeat(target[None], len(pairs) + 1, axis=0)
    at = np.arange(len(pairs))[:, None]
    targets[at, pairs] = target[pairs[:, ::-1]]
    scale, rotation, shift = closed_form(np.broadcast_to(source, targets.shape), targets)
    there = scale[:, None, None] * (source @ rotation.transpose(0, 2, 1)) + shift[:, None]
    left = np.linalg.norm(there - targets, axis=(1, 2)) / sqrt(n)
    as_they_are = float(left[-1])
    found = [
        ExchangedPair(
            int(pairs[k, 0]),
            int(pairs[k, 1]),
            float(left[k]),
            Similarity(float(scale[k]), rotation[k], shift[k]),
        )
        for k in np.argsort(left[:-1], kind="stable")[:_MOST_PAIRS].tolist()
        if left[k] < _AS_ONE * as_they_are
    ]
    return found, as_they_are


class ControlRemark(NamedTuple):
    """What is wrong with control as a whole.

    Attributes
    ----------
    text
        A sentence.
    exchanged
        Two control points that are exchanged, or several such pairs of which one is; none: it is
        something else.
    """

    text: str
    exchanged: tuple[tuple[str, str], ...] = ()


def likely_exchange(
    names: Sequence[str],
    source: Array,
    target: Array,
    of: str,
    unlikely: Callable[[Similarity], bool],
) -> ControlRemark | None:
    """Say which two of some control points were exchanged, if with these alone all agree.

    Parameters
    ----------
    names
        n of them.
    source, target
        (n, 3) where they are seen, and where they are said to be [m].
    of
        With what they agree then.
    unlikely
        Whether a similarity turns upside down what lies upright: of a pair and its likeness only
        what differs clearly speaks for that one.
    """
    pairs, as_they_are = exchanged_pairs(source, target)
    if not pairs:
        return None
    left = [pair.left * (_CLEARLY if unlikely(pair.fitted) else 1.0) for pair in pairs]
    best = min(left)
    if not best * _CLEARLY < as_they_are:
        return None
    likely = [pair for pair, one in zip(pairs, left, strict=True) if not best * _ALONE < one]
    exchanged = tuple((names[pair.first], names[pair.second]) for pair in likely)
    said = ", or ".join(f"control point {a} and control point {b}" for a, b in exchanged)
    if len(exchanged) > 1:
        said += ","
    return ControlRemark(
        f"{said} interchanged? With their coordinates exchanged all {len(names)} agree with {of} "
        f"to {likely[0].left:.2g} m, else to {as_they_are:.2g} m",
        exchanged,
    )
