"""Two points whose records were exchanged: one mistake that shows as two gross errors.

That it is one is found by trying: with the two records exchanged back, everything agrees.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from anaplot.aliases import Array
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import Exchanged, Interchange, ModelSolution
from anaplot.orientation.solver import agreement
from anaplot.photogrammetry.block import TieVariance

__all__ = ["Interchange", "interchange_of", "interchanged"]

_HUGE = 10.0  # times the a-priori sigma0: below, nobody took one point for another
_MOST_PAIRS = 6  # pairs that are tried
_FEW_POINTS = 7  # with these the table hardly tells pairs apart, and all are tried


def interchange_of(solution: ModelSolution) -> Interchange | None:
    """Return the two points of an oriented model that are interchanged, if any are.

    Nothing is tried unless sigma0 is as large as only gross errors make it, and the others do not
    agree without the worst point. The pairs without whose rows v'Pv would fall most are tried.

    Parameters
    ----------
    solution
        The model.
    """
    pair, sigma0 = solution.pair, solution.sigma0_um
    if pair is None or sigma0 is None or sigma0 < _HUGE * solution.apriori_um:
        return None
    apriori_mm = solution.apriori_um * 1e-3
    (worst,), *_ = _likely(solution, 1)
    if agreement(_without(pair, worst), solution.tie_variance, apriori_mm) is not None:
        return None
    most = _MOST_PAIRS if len(pair.points) > _FEW_POINTS else None
    pairs = [(first, second) for first, second in _likely(solution, 2)[:most]]
    return interchanged(pair, solution.tie_variance, apriori_mm, pairs)


def interchanged(
    pair: Stereopair,
    tie_variance: TieVariance,
    apriori_mm: float,
    candidates: Iterable[tuple[str, str]],
) -> Interchange | None:
    """Return which one of some pairs of points is interchanged, by orienting with it exchanged.

    Not where two pairs would do, nor where all agree without one of the two: then one gross error
    is enough.

    Parameters
    ----------
    pair
        The measurements.
    tie_variance
        How the ties are weighted.
    apriori_mm
        A-priori sigma0 [mm].
    candidates
        The pairs to try.
    """
    fits: dict[tuple[str, str], list[tuple[float, Exchanged]]] = {}
    for names in candidates:
        for exchanged, other in _exchanges(pair, *names):
            square = agreement(other, tie_variance, apriori_mm)
            if square is not None:
                fits.setdefault(names, []).append((square, exchanged))
    if len(fits) != 1:
        return None
    names, found = fits.popitem()
    if any(
        agreement(_without(pair, point), tie_variance, apriori_mm) is not None for point in names
    ):
        return None
    exchanged = min(found)[1]
    photo = {"left": pair.left, "right": pair.right, "both": ""}[exchanged]
    if pair.ties is None or not set(names) & set(pair.ties):
        photo = ""  # the rays meet alike whichever one is exchanged
    return Interchange(names, photo, exchanged)


def _exchanges(pair: Stereopair, first: str, second: str) -> Iterator[tuple[Exchanged, Stereopair]]:
    """Yield the pair with the records of two points exchanged, in every way that shows."""
    order = np.arange(len(pair.points))
    i, j = pair.points.index(first), pair.points.index(second)
    order[[i, j]] = j, i
    yield "right", replace(pair, xr=pair.xr[order], aside=None)
    if pair.ties is not None and not {first, second}.isdisjoint(pair.ties):
        yield "left", replace(pair, xl=pair.xl[order], aside=None)
        yield "both", replace(pair, xl=pair.xl[order], xr=pair.xr[order], aside=None)


def _without(pair: Stereopair, point: str) -> Stereopair:
    return replace(pair, off=pair.off | {(point, "x"), (point, "y")}, aside=None)


def _likely(solution: ModelSolution, count: int) -> list[tuple[str, ...]]:
    """Return the points, or pairs of them, the rows of which explain most of v'Pv first.

    Without some rows v'Pv falls by v' (Q_vv)^-1 v of these, Q_vv being their part of it.
    """
    rows: dict[str, list[int]] = {}
    for k, (point, _) in enumerate(solution.tested.keys):
        rows.setdefault(point, []).append(k)
    v = np.array([row.residual for row in solution.table])

    def explained(names: tuple[str, ...]) -> float:
        at = [k for name in names for k in rows[name]]
        part: Array = solution.q_vv[np.ix_(at, at)]
        return float(v[at] @ np.linalg.pinv(part, rcond=1e-6, hermitian=True) @ v[at])

    # in the order of the left photo, also where the first rows are those of other points
    points = [point for point in solution.measured if point in rows]
    return sorted(combinations(points, count), key=explained, reverse=True)
