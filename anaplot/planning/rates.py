"""Confidence intervals of rates found by counting."""

from __future__ import annotations

from math import sqrt

from anaplot.adjustment.significance import critical_normal

__all__ = ["score_interval"]


def score_interval(p: float, trials: float, confidence: float) -> tuple[float, float]:
    """Return Wilson's interval of a share p found in so many trials, not necessarily whole."""
    z2 = critical_normal(1.0 - confidence) ** 2
    centre = (p + z2 / (2 * trials)) / (1 + z2 / trials)
    half = sqrt(z2 * (p * (1 - p) / trials + z2 / (4 * trials**2))) / (1 + z2 / trials)
    low = 0.0 if p == 0.0 else max(centre - half, 0.0)
    high = 1.0 if p == 1.0 else min(centre + half, 1.0)
    return low, high
