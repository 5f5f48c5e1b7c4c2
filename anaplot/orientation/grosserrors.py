"""Gross errors of models and strips: a strategy's rejected rows out, oriented again, and so on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.findings import Findings, SearchSettings
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.significance import TESTABLE, critical_normal
from anaplot.adjustment.strategies import find_gross_errors
from anaplot.errors import NotComputableError
from anaplot.orientation.model import WrongPointsError, orient
from anaplot.orientation.modelvalues import ideal_roots
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import BridgedStrip, bridge_strip
from anaplot.photogrammetry.block import Block, Precision, Strip, TestSettings

__all__ = [
    "CleanedModel",
    "CleanedStrip",
    "RejectedRow",
    "model_gross_errors",
    "residual_system",
    "strategy_findings",
    "strip_gross_errors",
]

_MOST_PASSES = 30


class RejectedRow(NamedTuple):
    """A row that is left out of a model.

    Attributes
    ----------
    point, axis
        The row.
    w
        Standardized residual it has when it alone comes back, a-priori sigma; None when the model
        has no orientation with it, or cannot test it.
    parx_um
        Parallax at the row when it alone is back [um]; None likewise.
    redn
        Its redundancy number then; None likewise.
    """

    point: str
    axis: str
    w: float | None
    parx_um: float | None
    redn: float | None


@dataclass(frozen=True, slots=True, eq=False)
class CleanedModel:
    """A model without the rows that a strategy rejects.

    Attributes
    ----------
    solution
        Oriented without them.
    rejected
        Rows left out, in the order of their rejection.
    findings
        Of every pass, each on the model as it then was; the last rejects nothing new.
    came_back
        Rows that a pass rejected and the final trial put back.
    hard_to_tell
        Rejected row, kept row, and the correlation of their residuals when the first one went.
    first_rows
        The rows of the first pass in their order: those that could be oriented at all.
    remarks
        What else there is to say: weights that did not settle, rows that cannot be left out.
    """

    solution: ModelSolution
    rejected: tuple[RejectedRow, ...]
    findings: tuple[Findings, ...]
    came_back: tuple[tuple[str, str], ...]
    hard_to_tell: tuple[tuple[tuple[str, str], tuple[str, str], float], ...] = ()
    first_rows: tuple[tuple[str, str], ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class CleanedStrip:
    """A strip bridged without the rows that a strategy rejects.

    Attributes
    ----------
    bridged
        The strip as far as it could be bridged.
    models
        What was rejected in each of its models.
    """

    bridged: BridgedStrip
    models: tuple[CleanedModel, ...]


def residual_system(solution: ModelSolution) -> DenseResiduals:
    """See an oriented model from the side of its residuals."""
    root = np.sqrt(solution.q_l)
    parallax = np.array([row.parx_um for row in solution.table])
    e = parallax / (solution.apriori_um * root)
    return DenseResiduals(
        tuple(row.key for row in solution.table),
        e,
        np.array([row.redn for row in solution.table]),
        float(e @ e),
        solution.redundancy,
        solution.q_vv / root[:, None] / root,
    )


def strategy_findings(
    solution: ModelSolution, strategy: str, settings: SearchSettings | None = None
) -> Findings:
    """Run a strategy on a model as it is oriented.

    "modified" takes its model values from the ideal model with the same points.

    Raises
    ------
    ValueError
        No such strategy.
    """
    return find_gross_errors(
        residual_system(solution),
        strategy,
        settings,
        models=ideal_roots(solution) if strategy == "modified" else None,
    )


def model_gross_errors(
    pair: Stereopair,
    precision: Precision,
    test: TestSettings,
    strategy: str,
    settings: SearchSettings | None = None,
) -> CleanedModel:
    """Orient a model, reject, orient again until nothing more is rejected; then try all again.

    Parameters
    ----------
    pair, precision, test
        As `orient` has them; rows that are off stay off and are not reported.
    strategy, settings
        As `find_gross_errors` has them; None: the significance of the test.

    Raises
    ------
    NotComputableError
        The model cannot be oriented even so.
    ValueError
        No such strategy.
    """
    used = SearchSettings(alpha=test.alpha, power=test.power) if settings is None else settings
    out: list[tuple[str, str]] = []
    findings: list[Findings] = []
    remarks: list[str] = []
    partners: list[tuple[tuple[str, str], tuple[str, str], float]] = []
    solution = _oriented(pair, precision, test, out)
    first_rows = tuple(row.key for row in solution.table)
    for _ in range(_MOST_PASSES):
        room = used
        if used.most is not None:
            if findings and len(out) >= used.most:
                break
            room = replace(used, most=max(used.most - len(out), 0))
        found = strategy_findings(solution, strategy, room)
        findings.append(found)
        remarks += found.remarks
        keys = [solution.table[row].key for row in found.rows]
        if not keys:
            break
        table = solution.table
        without = [*out, *keys]
        try:
            solution = _oriented(pair, precision, test, without)
        except NotComputableError as error:
            # a linear model could spare these rows, the orientation cannot
            rows = ", ".join(f"{point} {axis}" for point, axis in keys)
            remarks.append(f"{rows} should go, but cannot be left out: {error}")
            break
        out = without
        partners += [(table[a].key, table[b].key, rho) for a, b, rho in found.hard_to_tell]
    else:
        remarks.append(f"still rejecting after {_MOST_PASSES} passes")
    back: list[tuple[str, str]] = []
    rejected: list[RejectedRow] = []
    critical = critical_normal(used.alpha)
    for key in tuple(out):
        rest = [other for other in out if other != key]
        row = _tried(pair, precision, test, rest, key)
        if row.w is not None and abs(row.w) < critical:
            out = rest
            back.append(key)
    if back:
        solution = _oriented(pair, precision, test, out)
    for key in out:
        rest = [other for other in out if other != key]
        rejected.append(_tried(pair, precision, test, rest, key))
    hard = tuple(p for p in partners if p[0] in out and p[1] not in out)
    return CleanedModel(
        solution,
        tuple(rejected),
        tuple(findings),
        tuple(back),
        hard,
        first_rows,
        tuple(dict.fromkeys(remarks)),
    )


def strip_gross_errors(
    block: Block, strip: Strip, strategy: str, settings: SearchSettings | None = None
) -> CleanedStrip:
    """Bridge a strip; every model loses its rejected rows before the next one is tied to it.

    Raises
    ------
    ValueError
        No such strategy.
    """
    cleaned: list[CleanedModel] = []

    def form(pair: Stereopair) -> ModelSolution:
        model = model_gross_errors(pair, block.precision, block.test, strategy, settings)
        cleaned.append(model)
        return model.solution

    return CleanedStrip(bridge_strip(block, strip, form=form), tuple(cleaned))


def _oriented(
    pair: Stereopair, precision: Precision, test: TestSettings, out: list[tuple[str, str]]
) -> ModelSolution:
    """Orient without the rows in `out`; points that allow no orientation are appended to it."""
    while True:
        try:
            solution = orient(replace(pair, off=pair.off | set(out)), precision, test)
        except WrongPointsError as error:
            new = _rows_of(pair, error.suspects[:1], out)
            if not new:
                raise
        else:
            new = _rows_of(pair, solution.outliers[:1], out)
            if not new:
                return solution
        out += new


def _rows_of(
    pair: Stereopair, points: tuple[str, ...], out: list[tuple[str, str]]
) -> list[tuple[str, str]]:
    rows = [(point, "y") for point in points]
    rows += [(point, "x") for point in points if pair.ties is not None and point in pair.ties]
    return [row for row in rows if row not in out and row not in pair.off]


def _tried(
    pair: Stereopair,
    precision: Precision,
    test: TestSettings,
    rest: list[tuple[str, str]],
    key: tuple[str, str],
) -> RejectedRow:
    """Orient with only `rest` left out and see what the row says."""
    nothing = RejectedRow(*key, None, None, None)
    try:
        solution = orient(replace(pair, off=pair.off | set(rest)), precision, test)
    except NotComputableError:
        return nothing
    at = [row.key for row in solution.table].index(key)
    row = solution.table[at]
    if row.redn < TESTABLE or solution.outliers:
        return nothing
    sigma = solution.apriori_um * float(np.sqrt(solution.q_l[at] * row.redn))
    return RejectedRow(*key, row.parx_um / sigma, row.parx_um, row.redn)
