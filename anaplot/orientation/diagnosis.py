"""What the operator is told beyond the table: transfers, partners, suspects, advice."""

from __future__ import annotations

from collections.abc import Sequence
from math import dist, log, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from anaplot.adjustment.advice import (
    NOTHING_FLAGGED,
    odds_in_words,
    other_explanations,
    remeasure,
)
from anaplot.adjustment.partners import EQUAL, rounded
from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS, NONE_PRIOR
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.tested import (
    Odds,
    Partner,
    Tested,
    Transfer,
    error_odds,
    sum_by_point,
)
from anaplot.aliases import Array
from anaplot.orientation.interchange import Interchange, interchange_of
from anaplot.orientation.residuals import residual_system
from anaplot.orientation.results import TOO_LARGE, Diagnosis, ModelSolution, Row

if TYPE_CHECKING:
    from anaplot.adjustment.findings import Findings

__all__ = ["diagnose"]


_LEFT = 3  # redundancy that is left where rows are found wrong together
_TWINS = 0.1  # bases: points no further apart are a doubled point


def diagnose(solution: ModelSolution) -> Diagnosis:
    """Return detectable errors, transfers, odds and advice of a model."""
    partners = solution.tested.partners()
    evidence = _evidence(solution)
    suspects = _suspects(solution, evidence)
    interchange = interchange_of(solution)
    together: tuple[Row, ...] = ()
    if interchange is not None:
        suspects = _of_first(interchange.points, suspects, solution.tested.keys)
    else:
        together = _wrong_together(solution, suspects)
        suspects = *together, *(row for row in suspects if row not in together)
    return Diagnosis(
        transfers=_transfers(solution),
        partners=partners,
        advice=_advice(solution, evidence, suspects, partners, interchange, together),
        suspects=suspects,
        interchange=interchange,
        chances=tuple(evidence.chance.values()),
        none=evidence.none,
    )


def _transfers(solution: ModelSolution) -> tuple[Transfer[Row], ...]:
    """Return the transfers that mislead.

    What is serious between the two points of a doubled one is none: "because their location is
    almost identical, the problem area is uniquely identified" (1983).
    """
    transfers = solution.tested.transfers()
    if all(transfer.critical for transfer in transfers):
        return transfers
    at = {point.point: (point.X, point.Y) for point in solution.points}
    near = _TWINS * abs(solution.base[0])

    def twins(one: str, other: str) -> bool:
        return one in at and other in at and dist(at[one], at[other]) <= near

    return tuple(
        transfer
        for transfer in transfers
        if transfer.critical or not twins(transfer.source[0], transfer.target[0])
    )


def _unchecked(solution: ModelSolution) -> str:
    """Say how many x coordinates no row checks: "significant blunders in x may go undetected".

    An x error of a point that is no tie changes its height and nothing else (1983).
    """
    checked = {point for point, axis in solution.tested.keys if axis == "x"}
    x = sum(axis == "y" and point not in checked for point, axis in solution.tested.keys)
    if not x:
        return ""
    return f"; x of {x} point{'s' if x > 1 else ''} is checked by the next model only"


class _Evidence(NamedTuple):
    """By what the rows to doubt are ordered.

    Attributes
    ----------
    chance
        Probability of each row (point, axis) that it holds the one gross error.
    size
        Its significance, 0 where it cannot be tested; what differs by rounding is equal.
    points
        Probability of each point.
    none
        Probability that there is no gross error.
    """

    chance: dict[Row, float]
    size: dict[Row, float]
    points: dict[str, float]
    none: float


def _evidence(solution: ModelSolution) -> _Evidence:
    """Return what the table says; under "exact", what the weight Sigma_F^-1 makes of it.

    In a table of correlated rows an error may show larger in another row than in its own. Where the
    largest needs an error beyond the usual width of the prior, the prior is as wide as that: else
    the odds would prefer a row that explains it worse by a smaller error.
    """
    tested = solution.tested
    if solution.exact is None or tested.redundancy < 1:
        return _evidence_of(tested, np.fmax(np.abs(tested.w), 0.0), tested.odds)
    system = residual_system(solution)
    w = np.abs(system.e) / np.sqrt(np.where(system.r >= TESTABLE, system.r, np.nan))
    factor = tested.test.factor(sqrt(system.vtpv / system.redundancy))
    if factor:
        w /= factor
    shown = np.fmax(w, 0.0)
    # with one redundancy all are equal but for rounding: the smallest error that explains it
    largest = shown >= shown.max() * (1.0 - EQUAL)
    errors = shown[largest] / np.sqrt(np.maximum(system.r[largest], TESTABLE))
    wider = max(ERROR_PRIOR_SIGMAS, float(errors.min()))
    odds = error_odds(wider**2 * system.r, w, system.redundancy, tested.test.kind)
    return _evidence_of(tested, shown, odds)


def _evidence_of(tested: Tested[Row], size: Array, odds: Odds) -> _Evidence:
    keys, chances = tested.keys, odds.rows
    return _Evidence(
        dict(zip(keys, chances.tolist(), strict=True)),
        {key: rounded(one) for key, one in zip(keys, size.tolist(), strict=True)},
        sum_by_point(keys, chances),
        odds.none,
    )


def _suspects(solution: ModelSolution, evidence: _Evidence) -> tuple[Row, ...]:
    """Rows to doubt, the most probably wrong first: of outliers, then flagged ones.

    Under "exact" one that is not flagged may be why others are, and the significance by the weight
    Sigma_F^-1 decides: without noise that of an error is the largest in its own row.
    """
    tested, exact = solution.tested, solution.exact is not None

    def order(key: Row) -> tuple[bool, float, float, float, float]:
        # odds saturate when errors are large; the significance then decides
        outlying = key[0] in solution.outliers
        points, chance = rounded(evidence.points[key[0]]), rounded(evidence.chance[key])
        size = evidence.size[key]
        return not outlying, -size if exact else 0.0, -points, -chance, -size

    doubted = [
        key
        for key, flagged in zip(tested.keys, tested.flagged.tolist(), strict=True)
        if flagged or key[0] in solution.outliers
    ]
    critical = tested.test.critical
    if doubted and exact and critical is not None:
        there = set(doubted)
        doubted += [
            key for key in tested.keys if key not in there and evidence.size[key] > critical
        ]
    return tuple(sorted(doubted, key=order))


def _wrong_together(solution: ModelSolution, suspects: tuple[Row, ...]) -> tuple[Row, ...]:
    """Return the rows without which all others agree, the largest error first; or none.

    Several errors hide each other behind a sigma0 that they enlarge, and bend good rows until these
    show most: odds of a single error then name a good one, or nothing is flagged at all. A search
    with the a-priori sigma0 (strategy "search") finds them, where enough is left that checks, and
    where they explain the residuals better than noise of another size in all rows.
    """
    sigma0 = solution.sigma0_um
    if sigma0 is None or sigma0 <= TOO_LARGE * solution.apriori_um or solution.outliers:
        return ()
    # loaded with the first model that asks for it
    from anaplot.orientation.grosserrors import strategy_findings

    found = strategy_findings(solution, "search")
    left = found.at_end
    if not found.rows or left.redundancy < _LEFT or not _rather_than_noise(solution, found):
        return ()
    order = sorted(found.rows, key=lambda row: -abs(left.w[row]))
    rows = tuple(solution.tested.keys[row] for row in order)
    if suspects and len({point for point, _ in rows}) < 2:
        return ()  # one error is what the odds weigh
    return rows


def _rather_than_noise(solution: ModelSolution, found: Findings) -> bool:
    """Whether gross errors in some rows are likelier than an a-priori sigma0 that is too small.

    By the largest likelihoods of both: with sigma0 estimated from f redundancies log L is
    -f / 2 (1 + log sigma0^2); with errors in some of n rows it is -v'Pv / 2 of the others, less for
    each the prior odds of an error (conventions, Odds) and the log of its size in sigmas.
    """
    sigma0, left, n = solution.tested.sigma0, found.at_end, len(solution.tested.keys)
    if not sigma0 or left.sigma0 is None:
        return False
    odds = log(n * NONE_PRIOR / (1.0 - NONE_PRIOR))
    errors = sum(odds + log(max(abs(float(left.w[row])), 1.0)) for row in found.rows)
    rows = -0.5 * left.redundancy * left.sigma0**2 - errors
    return rows > -0.5 * solution.redundancy * (1.0 + 2.0 * log(sigma0))


def _of_first(
    points: tuple[str, str], suspects: tuple[Row, ...], keys: Sequence[Row]
) -> tuple[Row, ...]:
    """Return the rows to doubt with those of two points first, which are doubted in any case."""
    own = [row for row in suspects if row[0] in points]
    own += [(point, "y") for point in points if (point, "y") in keys and (point, "y") not in own]
    return *own, *(row for row in suspects if row not in own)


def _advice(
    solution: ModelSolution,
    evidence: _Evidence,
    suspects: tuple[Row, ...],
    partners: tuple[Partner[Row], ...],
    interchange: Interchange | None,
    together: tuple[Row, ...],
) -> tuple[str, ...]:
    out = list(solution.remarks)
    if interchange is not None:
        # one mistake explains all: what the table takes for single errors is none
        return interchange.text, *out
    if not suspects:
        if solution.unexplained:
            out.append(
                f"{NOTHING_FLAGGED}, but {solution.unexplained}: measurements are wrong, and the "
                "test does not tell which"
            )
        elif solution.redundancy > 1:
            out.append(NOTHING_FLAGGED + _unchecked(solution))
        return tuple(out)
    points = evidence.points
    suspect, axis = suspects[0]
    others = {name: p for name, p in points.items() if name != suspect}
    why = ""
    if together:
        *rows, named = (f"{point} {of}" for point, of in together)
        if rows:
            named = f"{', '.join(rows)} and {named}"
        why = f"without {named} all other rows agree"
    elif suspect in solution.outliers:
        why = "without it all other points agree"
    elif others:
        shows: dict[str, float] = {}
        for (point, _), size in evidence.size.items():
            shows[point] = max(shows.get(point, 0.0), size)
        # where odds have run out of digits the significance tells who comes second
        rival = max(others, key=lambda name: (others[name], shows[name]))
        why = odds_in_words(points, suspect, rival)
    out.insert(0, remeasure(suspect, axis, why))
    if axis == "x":
        out.insert(
            1,
            f"{suspect} x has two suspects: this pointing, and the tie's coordinates from the "
            "preceding model",
        )
    if not together:
        out += other_explanations(suspects[0], partners, points, evidence.none)
    return tuple(out)
