"""The precision of pointing, from pointings at the same points."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import groupby
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.pooling import covariance_degrees, variance_interval
from anaplot.aliases import Array
from anaplot.session.pointings import Run
from anaplot.station.pooledrows import Sigma

__all__ = ["RepeatedPointing", "repeated_pointing"]


class RepeatedPointing(NamedTuple):
    """The precision of pointing, from pointings at the same points.

    Attributes
    ----------
    who, kind
        The operator's name, or ""; "tie", "new", "control" or "fiducial".
    points, pointings, unmoved
        How many points, pointings that count, and pointings that do not, for the mark was not
        seen to move away before them.
    sigma
        Of one coordinate in one photo; None while no point has two pointings.
    x_um, y_um
        Of the coordinates of the left photo, or of the one that was pointed at [um].
    px_um, py_um
        Of the parallaxes [um]; None where photos are pointed at one by one.
    degrees
        Degrees of freedom of each of these four.
    """

    who: str
    kind: str
    points: int
    pointings: int
    unmoved: int
    sigma: Sigma | None
    x_um: float | None
    y_um: float | None
    px_um: float | None
    py_um: float | None
    degrees: int


class _Scatter(NamedTuple):
    """Sums of squares and products [um^2] about the means of runs, and degrees of freedom."""

    products: Array
    degrees: int


def repeated_pointing(
    runs: Iterable[Run], control: set[str]
) -> tuple[tuple[RepeatedPointing, ...], Sigma | None, int]:
    """Return the precision by operator and kind, that of a point's coordinate, its pointings.

    Parameters
    ----------
    runs
        What was pointed at again.
    control
        Names of the control points.
    """
    groups: defaultdict[tuple[str, str], list[Run]] = defaultdict(list)
    for run in runs:
        kind = "fiducial" if run.fiducial else "control" if run.name in control else run.role
        groups[run.who, kind].append(run)
    found = tuple(_precision(who, kind, group) for (who, kind), group in sorted(groups.items()))
    counted = [(key, group) for key, group in groups.items() if key[1] != "fiducial"]
    scatters = [s for _, group in counted for s in _scatters(group)]
    pointings = sum(one.pointings for one in found if one.kind != "fiducial" and one.sigma)
    return found, _of_a_coordinate(scatters), pointings


def _scatters(runs: Iterable[Run]) -> list[_Scatter]:
    """Return the scatter of runs in two photos, and of those in one."""
    out = []
    by_photos = sorted(runs, key=lambda run: len(run.places[0]) if run.places else 0)
    for photos, group in groupby(by_photos, lambda run: len(run.places[0]) if run.places else 0):
        if photos == 0:
            continue
        products, degrees = np.zeros((2 * photos, 2 * photos)), 0
        for run in group:
            at = 1000.0 * np.array(run.places).reshape(len(run.places), -1)
            at -= at.mean(axis=0)
            products += at.T @ at
            degrees += len(at) - 1
        if degrees > 0:
            out.append(_Scatter(products, degrees))
    return out


def _of_a_coordinate(scatters: Sequence[_Scatter]) -> Sigma | None:
    """Return the standard deviation of one coordinate in one photo [um]."""
    number = sum(len(s.products) * s.degrees for s in scatters)
    if number == 0:
        return None
    variance = sum(float(np.trace(s.products)) for s in scatters) / number
    degrees = sum(covariance_degrees(s.products / s.degrees, s.degrees) for s in scatters)
    low, high = variance_interval(variance, degrees)
    return Sigma(sqrt(variance), sqrt(low), None if high is None else sqrt(high), degrees)


def _precision(who: str, kind: str, runs: Sequence[Run]) -> RepeatedPointing:
    scatters = _scatters(runs)
    counting = [run for run in runs if len(run.places) > 1]
    pairs = [s for s in scatters if len(s.products) == 4]
    degrees = sum(s.degrees for s in scatters)
    paired = sum(s.degrees for s in pairs)

    def deviation(of: Sequence[_Scatter], weights: tuple[int, ...], n: int) -> float | None:
        if n == 0:
            return None
        h = [np.array(weights[: len(s.products)], dtype=float) for s in of]
        total = sum(float(a @ s.products @ a) for a, s in zip(h, of, strict=True))
        return sqrt(max(total, 0.0) / n)

    return RepeatedPointing(
        who,
        kind,
        len(counting),
        sum(len(run.places) for run in counting),
        sum(run.unmoved for run in runs),
        _of_a_coordinate(scatters),
        deviation(scatters, (1, 0, 0, 0), degrees),
        deviation(scatters, (0, 1, 0, 0), degrees),
        deviation(pairs, (1, 0, -1, 0), paired),
        deviation(pairs, (0, 1, 0, -1), paired),
        degrees,
    )
