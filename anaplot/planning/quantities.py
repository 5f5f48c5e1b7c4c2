"""What a simulation counts: what a run's value can be, and how well its mean is known."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from anaplot.adjustment.significance import critical_normal
from anaplot.planning.rates import score_interval

__all__ = ["COUNT", "MEASURE", "YES_OR_NO", "Quantity", "mean_interval", "out_of", "share"]


class Quantity(NamedTuple):
    """What the value of a run can be; it is never negative.

    Attributes
    ----------
    top
        The largest value; None: a count without a bound worth the name.
    parts
        Of how many answers, yes or no, a bounded value is made; 0: a length or the like.
    """

    top: float | None
    parts: int


YES_OR_NO = Quantity(1.0, 1)
COUNT = Quantity(None, 1)
MEASURE = Quantity(None, 0)


def out_of(number: int) -> Quantity:
    """Return the quantity "so many of `number`"."""
    return Quantity(float(number), max(number, 1))


def share(number: int) -> Quantity:
    """Return the quantity "which share of `number`"."""
    return Quantity(1.0, number)


def mean_interval(
    quantity: Quantity, runs: int, total: float, squares: float, confidence: float = 0.95
) -> tuple[float, float] | None:
    """Return the two-sided confidence interval of the mean of a run's value.

    Parameters
    ----------
    quantity
        What the value is.
    runs, total, squares
        Number of runs, sum and sum of squares of their values.
    confidence
        Between 0 and 1.

    Returns
    -------
    tuple or None
        Low and high end; None for a count or a length in a single run, which says nothing of its
        scatter.

    Notes
    -----
    The interval is decided by the quantity, never by the values that happened to be drawn. That of
    a length is the mean's with its standard deviation, not below zero. All others are score
    intervals: the means that the data do not contradict, with the variance that
    belongs to that mean and not to the one observed. So none has zero width where all runs agree,
    and none leaves the range of its quantity.

    Yes or no: Wilson's. So many of k: Wilson's for the share of k, in as many independent trials
    as the scatter between runs tells. Independent answers count as k trials a run, answers that
    share the fate of their run as one, and nothing lies beyond that; the design effect between 1
    and k (below 1 where answers exclude each other) is estimated, as if one answer more, of the
    rarer kind, had shared its run's fate: with nothing missed nothing is known about how errors
    are missed together, and the runs alone count. What is right and what is missed are treated
    alike, so that one interval is the mirror of the other. Counts without bound: the limit of
    Wilson's for many answers (the score interval of Poisson's mean), its variance times the
    dispersion between runs.
    """
    top, parts = quantity
    mean = total / runs
    scatter = max(squares / runs - mean * mean, 0.0) * runs / max(runs - 1, 1)
    if top is None:
        if runs < 2:
            return None
        if parts == 0:
            half = critical_normal(1.0 - confidence) * sqrt(scatter / runs)
            return max(mean - half, 0.0), mean + half
        trials = runs * (total + 1.0) / (runs * scatter + 1.0)
        z2 = critical_normal(1.0 - confidence) ** 2
        centre = mean + z2 / (2 * trials)
        half = sqrt(z2 * (mean / trials + z2 / (4 * trials**2)))
        return (0.0 if total == 0 else max(centre - half, 0.0)), centre + half
    if top == 0.0:
        return 0.0, 0.0
    p = min(mean / top, 1.0)
    rarer = parts * runs * min(p, 1.0 - p)
    # the design effect scatter / (p (1 - p) / parts), times `rarer`
    spread = (scatter / top**2) * parts**2 * runs / max(p, 1.0 - p)
    effect = min((spread + parts) / (rarer + 1.0), parts) if runs > 1 else parts
    low, high = score_interval(p, parts * runs / effect, confidence)
    return top * low, top * high
