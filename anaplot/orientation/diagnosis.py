"""What the operator is told beyond the table: detectable errors, transfers, odds, advice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.adjustment.oddswords import odds_in_words, to_one
from anaplot.adjustment.reliability import (
    ERROR_PRIOR_SIGMAS,
    HARD_TO_TELL,
    critical_transfers,
    error_odds,
    residual_correlations,
    smallest_detectable_errors,
    undetected_effects,
)
from anaplot.adjustment.significance import TESTABLE, noncentrality, tau_power
from anaplot.aliases import Axis, RowKey
from anaplot.orientation.residuals import residual_system
from anaplot.orientation.results import (
    Diagnosis,
    ModelSolution,
    Partner,
    RowDiagnosis,
    TableRow,
    Transfer,
)

__all__ = ["HARD_TO_TELL", "diagnose", "point_odds"]


_SUSPICIOUS = 3.0  # times the a-priori sigma0: a test that estimates sigma may hide behind it


def diagnose(solution: ModelSolution, power: float = 0.80) -> Diagnosis:
    """Say what can be said of every row of a model beyond its table.

    Smallest detectable errors and their effects hold for the a-priori sigma0 whatever the test;
    the power that the test really has against them stands beside.

    Parameters
    ----------
    solution
        The oriented model.
    power
        Power that smallest detectable errors refer to.
    """
    table = solution.table
    r = np.array([row.r for row in table])
    ratio = np.array([np.nan if row.w is None else row.w for row in table])
    apparent = solution.apparent_q_l
    detectable = smallest_detectable_errors(
        r, apparent, apriori=solution.apriori_um, alpha=solution.test.alpha, power=power
    )
    odds = error_odds(
        # g = 400 q_l r^2 / q_vv, which is 400 r but for "exact"
        r if solution.exact is None else solution.q_l * r / apparent,
        None if solution.redundancy < 1 else ratio,
        solution.redundancy,
        solution.test.kind,
    )
    if solution.exact is None:
        effects = undetected_effects(r, alpha=solution.test.alpha, power=power)
    else:
        effects = detectable / solution.apriori_um * solution.exact.effects
    rows = tuple(
        RowDiagnosis(
            row.point, row.axis, None if nabla != nabla else nabla, p, None if e != e else e
        )
        for row, nabla, p, e in zip(
            table, detectable.tolist(), odds.rows.tolist(), effects.tolist(), strict=True
        )
    )
    keys = [row.key for row in table]
    transfers = tuple(
        Transfer(keys[i], keys[j], value) for i, j, value in critical_transfers(solution.influence)
    )
    correlation = residual_correlations(solution.q_vv, r)
    first, second = np.nonzero(np.triu(np.abs(correlation) >= HARD_TO_TELL, 1))
    partners = tuple(
        Partner(keys[i], keys[j], float(correlation[i, j]))
        for i, j in zip(first.tolist(), second.tolist(), strict=True)
    )
    evidence = _evidence(solution, rows, odds.none)
    suspects = _suspects(solution, evidence)
    return Diagnosis(
        rows=rows,
        none=odds.none,
        transfers=transfers,
        partners=partners,
        advice=_advice(solution, evidence, suspects, partners),
        suspects=suspects,
        power=_real_power(solution, power),
    )


class _Evidence(NamedTuple):
    """By what the rows to doubt are ordered.

    Attributes
    ----------
    chance
        Probability of each row (point, axis) that it holds the one gross error.
    size
        Its significance; 0 where it cannot be tested.
    points
        Probability of each point.
    none
        Probability that there is no gross error.
    """

    chance: dict[RowKey, float]
    size: dict[RowKey, float]
    points: dict[str, float]
    none: float


def _evidence(solution: ModelSolution, rows: tuple[RowDiagnosis, ...], none: float) -> _Evidence:
    """Return what the table says; under "exact", what the weight Sigma_F^-1 makes of it.

    In a table of correlated rows an error may show larger in another row than in its own. Where the
    largest needs an error beyond the usual width of the prior, the prior is as wide as that: else
    the odds would prefer a row that explains it worse by a smaller error.
    """
    if solution.exact is None or solution.redundancy < 1:
        chance: dict[RowKey, float] = {(row.point, row.axis): row.probability for row in rows}
        size: dict[RowKey, float] = {row.key: row.w or 0.0 for row in solution.table}
        return _Evidence(chance, size, point_odds(rows), none)
    system = residual_system(solution)
    w = np.full(len(system.e), np.nan)
    np.divide(np.abs(system.e), np.sqrt(system.r), out=w, where=system.r >= TESTABLE)
    if solution.test.kind == "tau" and system.vtpv > 0.0:
        w /= np.sqrt(system.vtpv / system.redundancy)
    shown = np.nan_to_num(w)
    top = int(np.argmax(shown))
    error = float(shown[top]) / max(float(system.r[top]), TESTABLE) ** 0.5
    wider = max(1.0, error / ERROR_PRIOR_SIGMAS)
    odds = error_odds(wider**2 * system.r, w, system.redundancy, solution.test.kind)
    keys = [row.key for row in solution.table]
    chances = dict(zip(keys, odds.rows.tolist(), strict=True))
    points: dict[str, float] = {}
    for (point, _), one in chances.items():
        points[point] = points.get(point, 0.0) + one
    return _Evidence(chances, dict(zip(keys, shown.tolist(), strict=True)), points, odds.none)


def _suspects(solution: ModelSolution, evidence: _Evidence) -> tuple[tuple[str, Axis], ...]:
    """Rows to doubt, the most probably wrong first: of outliers, then flagged ones.

    Under "exact" one that is not flagged may be why others are, and the significance by the weight
    Sigma_F^-1 decides: without noise that of an error is the largest in its own row.
    """
    exact = solution.exact is not None

    def order(row: TableRow) -> tuple[bool, float, float, float, float]:
        # odds saturate when errors are large; the significance then decides
        outlying = row.point in solution.outliers
        points, chance = evidence.points[row.point], evidence.chance[row.key]
        size = evidence.size[row.key]
        first = float(f"{size:.9g}") if exact else 0.0  # what differs by rounding is equal
        return not outlying, -first, -points, -chance, -size

    doubted = [row for row in solution.table if row.flagged or row.point in solution.outliers]
    critical = solution.test.critical
    if doubted and exact and critical is not None:
        there = {row.key for row in doubted}
        doubted += [
            row
            for row in solution.table
            if row.key not in there and evidence.size[row.key] > critical
        ]
    return tuple((row.point, row.axis) for row in sorted(doubted, key=order))


def _real_power(solution: ModelSolution, power: float) -> float | None:
    """Power of the applied test against the smallest detectable errors of the normal test."""
    alpha = solution.test.alpha
    if solution.test.kind == "tau":
        return tau_power(noncentrality(alpha, power), alpha, solution.redundancy)
    return power if solution.redundancy > 0 else None


def point_odds(rows: tuple[RowDiagnosis, ...]) -> dict[str, float]:
    """Return each point's probability of holding the gross error: the sum over its rows."""
    out: dict[str, float] = {}
    for row in rows:
        out[row.point] = out.get(row.point, 0.0) + row.probability
    return out


def _advice(
    solution: ModelSolution,
    evidence: _Evidence,
    suspects: tuple[tuple[str, Axis], ...],
    partners: tuple[Partner, ...],
) -> tuple[str, ...]:
    out = list(solution.remarks)
    if not suspects:
        sigma0 = solution.sigma0_um
        if sigma0 is not None and sigma0 > _SUSPICIOUS * solution.apriori_um:
            out.append(
                f"nothing is flagged, but sigma0 is {sigma0 / solution.apriori_um:.0f} times its "
                "a-priori value: more than one measurement is wrong"
            )
        elif solution.redundancy > 1:
            out.append("nothing is flagged")
        return tuple(out)
    points = evidence.points
    accused, axis = suspects[0]
    others = {name: p for name, p in points.items() if name != accused}
    sentence = f"remeasure {accused} ({axis})"
    if accused in solution.outliers:
        sentence += ": without it all other points agree"
    elif others:
        shows: dict[str, float] = {}
        for (point, _), size in evidence.size.items():
            shows[point] = max(shows.get(point, 0.0), size)
        # where odds have run out of digits the significance tells who comes second
        rival = max(others, key=lambda name: (others[name], shows[name]))
        sentence += f": {odds_in_words(points, accused, rival)}"
    out.insert(0, sentence)
    if axis == "x":
        out.insert(
            1,
            f"{accused} x has two suspects: this pointing, and the tie's coordinates from the "
            "preceding model",
        )
    for partner in partners:
        if suspects[0] in (partner.first, partner.second):
            other = partner.second if partner.first == suspects[0] else partner.first
            out.append(
                f"{accused} {axis} and {other[0]} {other[1]} are hard to tell apart "
                f"(correlation {partner.correlation:.2f})"
            )
    if evidence.none > points[accused]:
        odds = to_one(evidence.none, points[accused])
        out.append(f"no gross error at all: {odds} over {accused}")
    return tuple(out)
