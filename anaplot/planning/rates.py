"""Rates found by counting, with their confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from anaplot.adjustment.significance import critical_normal

__all__ = ["Rate", "score_interval", "wilson"]


@dataclass(frozen=True, slots=True)
class Rate:
    """A relative frequency and its two-sided confidence interval.

    Attributes
    ----------
    hits, trials
        What was counted, and of how many.
    value
        Their ratio.
    low, high
        The interval.
    """

    hits: int
    trials: int
    value: float
    low: float
    high: float


def wilson(hits: int, trials: int, confidence: float = 0.95) -> Rate:
    """Return the rate of `hits` in `trials` with Wilson's score interval (Wilson 1927).

    Raises
    ------
    ValueError
        No trials, or more hits than trials, or a confidence outside 0 to 1.
    """
    if trials < 1 or not 0 <= hits <= trials:
        raise ValueError(f"{hits} hits in {trials} trials are no rate")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence {confidence} must lie between 0 and 1")
    p = hits / trials
    return Rate(hits, trials, p, *score_interval(p, trials, confidence))


def score_interval(p: float, trials: float, confidence: float) -> tuple[float, float]:
    """Return Wilson's interval of a share p found in so many trials, not necessarily whole."""
    z2 = critical_normal(1.0 - confidence) ** 2
    centre = (p + z2 / (2 * trials)) / (1 + z2 / trials)
    half = sqrt(z2 * (p * (1 - p) / trials + z2 / (4 * trials**2))) / (1 + z2 / trials)
    low = 0.0 if p == 0.0 else max(centre - half, 0.0)
    high = 1.0 if p == 1.0 else min(centre + half, 1.0)
    return low, high
