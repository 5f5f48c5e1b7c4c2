"""Drift of an operator over the day: his first hour against his last one.

Variances are compared by F with the degrees of freedom of `anaplot.adjustment.pooling`; means of
standardised residuals by Student's t, the variance of a mean being that of the correlated residuals
themselves: what the orientations take up cannot be seen in them, and is not tested. Residuals of
models that follow one another are taken as independent, and the pooled variance as independent of
the means: an approximation as good as there are many models.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.pooling import (
    Pooled,
    VarianceTest,
    equal_variances,
    student_two_sided,
)
from anaplot.aliases import Axis
from anaplot.station.pooledrows import ALPHA, AdjustedRows, Row, Sigma, sigma_of, sums_by

__all__ = ["Drift", "MeanShift", "drift_over_days"]

_HOUR = timedelta(hours=1)
_ABSORBED = 1e-4  # of the variance that a mean of independent residuals would have


class MeanShift(NamedTuple):
    """The change of the mean residual of an axis: means [um], Student's t, its probability."""

    axis: Axis
    first_um: float
    last_um: float
    t: float
    probability: float


class Drift(NamedTuple):
    """The first against the last hour of one operator's day.

    Attributes
    ----------
    day, who
        Date on the wall's calendar, and the operator's name or "".
    first, last
        sigma0 of what was measured in these hours; None where nothing is redundant.
    test
        Whether the two are equal; None where they cannot be compared.
    shifts
        Of the means of y (py) and x rows; none where the orientations take them up altogether.
    why
        Why nothing is tested, or "".
    """

    day: str
    who: str
    first: Sigma | None = None
    last: Sigma | None = None
    test: VarianceTest | None = None
    shifts: tuple[MeanShift, ...] = ()
    why: str = ""

    @property
    def drifts(self) -> bool:
        """Whether anything has changed, at ALPHA shared by the tests."""
        found = [shift.probability for shift in self.shifts]
        found += [] if self.test is None else [self.test.probability]
        return bool(found) and min(found) < ALPHA / len(found)


def drift_over_days(models: Sequence[AdjustedRows], apriori: float) -> tuple[Drift, ...]:
    """Test the first against the last hour of every day, of each operator by himself."""
    days: defaultdict[tuple[str, str], list[datetime]] = defaultdict(list)
    for one in models:
        for row in one.rows:
            if row.time is not None and row.who is not None:
                days[_day(row.time), row.who].append(row.time)
    return tuple(
        _of_a_day(models, apriori, day, who, min(times), max(times))
        for (day, who), times in sorted(days.items())
    )


def _day(time: datetime) -> str:
    return time.astimezone().date().isoformat()


def _of_a_day(
    models: Sequence[AdjustedRows],
    apriori: float,
    day: str,
    who: str,
    begin: datetime,
    end: datetime,
) -> Drift:
    if end - begin < 2 * _HOUR:
        minutes = (end - begin).total_seconds() / 60.0
        return Drift(day, who, why=f"{minutes:.0f} minutes of work: no first and last hour")

    def part(row: Row) -> str | None:
        if row.time is None or row.who != who or not begin <= row.time <= end:
            return None
        return "first" if row.time <= begin + _HOUR else "last" if row.time >= end - _HOUR else None

    sums = sums_by(models, part)
    first, last = (sums.get(name, Pooled()) for name in ("first", "last"))
    if first.factor is None or last.factor is None:
        return Drift(day, who, why="nothing redundant was measured in the first or last hour")
    pooled = first.plus(last)
    assert pooled.factor is not None
    shifts = []
    axes: tuple[Axis, Axis] = ("y", "x")
    for axis in axes:
        means = _mean(models, part, "first", axis), _mean(models, part, "last", axis)
        shift = _shift(axis, *means, pooled)
        shifts += [] if shift is None else [shift]
    return Drift(
        day,
        who,
        sigma_of(first, apriori),
        sigma_of(last, apriori),
        equal_variances((first.factor, last.factor), (first.degrees, last.degrees)),
        tuple(shifts),
    )


class _Mean(NamedTuple):
    """Number of rows, mean of w, its variance in a-priori ones, and mean residual [um]."""

    n: int
    w: float
    variance: float
    um: float


def _mean(
    models: Sequence[AdjustedRows], part: Callable[[Row], str | None], hour: str, axis: Axis
) -> _Mean | None:
    n, w, variance, um = 0, 0.0, 0.0, 0.0
    for one in models:
        at = np.array([row.axis == axis and part(row) == hour for row in one.rows])
        if at.any():
            n += int(np.count_nonzero(at))
            w += float(one.w[at].sum())
            um += float(one.residual[at].sum())
            variance += max(float(one.correlation[np.ix_(at, at)].sum()), 0.0)
    return _Mean(n, w / n, variance / n**2, um / n) if n else None


def _shift(axis: Axis, first: _Mean | None, last: _Mean | None, pooled: Pooled) -> MeanShift | None:
    """Test the difference of two means; None where the orientations take it up altogether."""
    if first is None or last is None or pooled.factor is None or pooled.factor <= 0.0:
        return None
    variance = first.variance + last.variance
    if variance < _ABSORBED * (1.0 / first.n + 1.0 / last.n):
        return None
    t = (last.w - first.w) / sqrt(pooled.factor * variance)
    return MeanShift(axis, first.um, last.um, t, student_two_sided(t, pooled.degrees))
