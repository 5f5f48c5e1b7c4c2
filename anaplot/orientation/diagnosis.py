"""What the operator is told beyond the table: detectable errors, transfers, odds, advice."""

from __future__ import annotations

from typing import Literal

import numpy as np

from anaplot.adjustment.oddswords import odds_in_words
from anaplot.adjustment.oddswords import to_one as _to_one
from anaplot.adjustment.reliability import (
    HARD_TO_TELL,
    critical_transfers,
    error_odds,
    residual_correlations,
    smallest_detectable_errors,
    undetected_effects,
)
from anaplot.adjustment.significance import noncentrality, tau_power
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
    r = np.array([row.redn for row in table])
    ratio = np.array([np.nan if row.sigf is None else row.sigf for row in table])
    detectable = smallest_detectable_errors(
        r, solution.q_l, apriori=solution.apriori_um, alpha=solution.test.alpha, power=power
    )
    odds = error_odds(
        r,
        None if solution.redundancy < 1 else ratio,
        solution.redundancy,
        solution.test.kind,
    )
    effects = undetected_effects(r, alpha=solution.test.alpha, power=power)
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
        Transfer(keys[i], keys[j], value)
        for i, j, value in critical_transfers(solution.q_vv, solution.q_l)
    )
    correlation = residual_correlations(solution.q_vv, r)
    first, second = np.nonzero(np.triu(np.abs(correlation) >= HARD_TO_TELL, 1))
    partners = tuple(
        Partner(keys[i], keys[j], float(correlation[i, j]))
        for i, j in zip(first.tolist(), second.tolist(), strict=True)
    )
    suspects = _suspects(solution, rows)
    return Diagnosis(
        rows=rows,
        none=odds.none,
        transfers=transfers,
        partners=partners,
        advice=_advice(solution, rows, suspects, partners, odds.none),
        suspects=suspects,
        power=_real_power(solution, power),
    )


def _suspects(
    solution: ModelSolution, rows: tuple[RowDiagnosis, ...]
) -> tuple[tuple[str, Literal["x", "y"]], ...]:
    """Rows to doubt, the most probably wrong first: of outliers, then flagged ones."""
    points = point_odds(rows)
    chance = {(row.point, row.axis): row.probability for row in rows}

    def order(row: TableRow) -> tuple[bool, float, float, float]:
        # odds saturate when errors are large; the significance then decides
        outlying = row.point in solution.outliers
        sigf = row.sigf or 0.0
        return not outlying, -points[row.point], -chance[row.point, row.axis], -sigf

    doubted = [row for row in solution.table if row.flagged or row.point in solution.outliers]
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
    rows: tuple[RowDiagnosis, ...],
    suspects: tuple[tuple[str, Literal["x", "y"]], ...],
    partners: tuple[Partner, ...],
    none: float,
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
    points = point_odds(rows)
    accused, axis = suspects[0]
    others = {name: p for name, p in points.items() if name != accused}
    sentence = f"remeasure {accused} ({axis})"
    if accused in solution.outliers:
        sentence += ": without it all other points agree"
    elif others:
        shows: dict[str, float] = {}
        for row in solution.table:
            shows[row.point] = max(shows.get(row.point, 0.0), row.sigf or 0.0)
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
    if none > points[accused]:
        out.append(f"no gross error at all: {_to_one(none, points[accused])} over {accused}")
    return tuple(out)
