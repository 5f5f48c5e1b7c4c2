"""What the operator is told beyond the table: detectable errors, transfers, odds, advice."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.reliability import (
    critical_transfers,
    error_odds,
    residual_correlations,
    smallest_detectable_errors,
)
from anaplot.orientation.results import (
    Diagnosis,
    ModelSolution,
    Partner,
    RowDiagnosis,
    TableRow,
    Transfer,
)

__all__ = ["HARD_TO_TELL", "diagnose", "point_odds"]

HARD_TO_TELL = 0.9
"""Residual correlation from which two rows are named as hard to tell apart."""


def diagnose(solution: ModelSolution, power: float = 0.80) -> Diagnosis:
    """Say what can be said of every row of a model, always with the a-priori sigma0 for nabla.

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
    rows = tuple(
        RowDiagnosis(row.point, row.axis, None if nabla != nabla else nabla, p)
        for row, nabla, p in zip(table, detectable.tolist(), odds.rows.tolist(), strict=True)
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
    chance: dict[tuple[str, str], float] = dict(zip(keys, odds.rows.tolist(), strict=True))
    suspects = tuple(sorted((row.key for row in solution.flagged), key=lambda key: -chance[key]))
    return Diagnosis(
        rows=rows,
        none=odds.none,
        transfers=transfers,
        partners=partners,
        advice=_advice(solution, rows, partners, odds.none),
        suspects=suspects,
    )


def point_odds(rows: tuple[RowDiagnosis, ...]) -> dict[str, float]:
    """Return each point's probability of holding the gross error: the sum over its rows."""
    out: dict[str, float] = {}
    for row in rows:
        out[row.point] = out.get(row.point, 0.0) + row.probability
    return out


def _advice(
    solution: ModelSolution,
    rows: tuple[RowDiagnosis, ...],
    partners: tuple[Partner, ...],
    none: float,
) -> tuple[str, ...]:
    out = list(solution.remarks)
    flagged = solution.flagged
    if not flagged:
        if solution.redundancy > 1:
            out.append("nothing is flagged")
        return tuple(out)
    points = point_odds(rows)
    chance = {(str(row.point), str(row.axis)): row.probability for row in rows}
    # among the points that show a flag, the one most probably wrong; the runner-up may be any
    accused = max(flagged, key=lambda row: (points[row.point], row.sigf or 0.0)).point
    row = max((row for row in flagged if row.point == accused), key=lambda row: chance[row.key])
    others = {name: p for name, p in points.items() if name != accused}
    sentence = f"remeasure {accused} ({row.axis})"
    if others:
        rival = max(others, key=others.__getitem__)
        sentence += f": {_to_one(points[accused], others[rival])} over {rival}"
    out.insert(0, sentence)
    if row.axis == "x":
        out.insert(
            1,
            f"{accused} x has two suspects: this pointing, and the tie's coordinates from the "
            "preceding model",
        )
    for partner in partners:
        if row.key in (partner.first, partner.second):
            other = partner.second if partner.first == row.key else partner.first
            out.append(
                f"{_row(row)} and {other[0]} {other[1]} are hard to tell apart "
                f"(correlation {partner.correlation:.2f})"
            )
    if none > points[accused]:
        out.append(
            f"no gross error at all: {_to_one(none, points[accused])} over {accused}"
        )
    return tuple(out)


def _row(row: TableRow) -> str:
    return f"{row.point} {row.axis}"


def _to_one(more: float, less: float) -> str:
    if less <= 0.0 or more / less >= 1000.0:
        return "more than 1000 to 1"
    ratio = more / less
    if ratio < 1.0:
        return f"1 to {_number(1.0 / ratio)}"
    return f"{_number(ratio)} to 1"


def _number(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}"
