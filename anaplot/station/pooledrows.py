"""Rows of models and inner orientations with whose, of what and when, pooled by any of these."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import datetime
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.pooling import Pooled, pooled_rows, variance_interval
from anaplot.aliases import Array, Axis, Bools

__all__ = ["ALPHA", "AdjustedRows", "Row", "Sigma", "sigma_of", "sums_by"]

ALPHA = 0.01
"""Significance of the tests between groups."""


class Sigma(NamedTuple):
    """A standard deviation [um], its confidence interval (95 %), and its degrees of freedom.

    `high_um` is None where so little is known that there is no upper end.
    """

    um: float
    low_um: float
    high_um: float | None
    degrees: float

    def holds(self, sigma_um: float) -> bool:
        """Whether a value lies in the interval."""
        return self.low_um <= sigma_um and (self.high_um is None or sigma_um <= self.high_um)


class Row(NamedTuple):
    """Whose row it is, and of what."""

    strip: str
    who: str | None
    kind: str
    axis: Axis
    time: datetime | None


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedRows:
    """The rows of one model or inner orientation that can be tested, and their statistics.

    `whole`: sums over all rows.
    """

    rows: tuple[Row, ...]
    residual: Array
    w: Array
    r: Array
    correlation: Array
    whole: Pooled

    def pooled(self, chosen: Bools) -> Pooled:
        """Return the sums over some rows."""
        return self.whole if chosen.all() else pooled_rows(self.w, self.r, self.correlation, chosen)


def sums_by(
    adjusted: Iterable[AdjustedRows], key: Callable[[Row], str | None]
) -> dict[str, Pooled]:
    """Return the sums of each group of rows, in the order in which they come."""
    sums: dict[str, Pooled] = {}
    for one in adjusted:
        of = [key(row) for row in one.rows]
        for name in dict.fromkeys(name for name in of if name is not None):
            chosen = np.array([each == name for each in of])
            sums[name] = sums.get(name, Pooled()).plus(one.pooled(chosen))
    return sums


def sigma_of(pooled: Pooled, apriori: float) -> Sigma | None:
    """Return the standard deviation of a group; None without redundancy."""
    factor, degrees = pooled.factor, pooled.degrees
    if factor is None or degrees <= 0.0:
        return None
    low, high = variance_interval(factor, degrees)
    end = None if high is None else apriori * sqrt(high)
    return Sigma(apriori * sqrt(factor), apriori * sqrt(low), end, degrees)
