"""One model as a document: the table that the operator of the ANAPLOT saw (1983, Figure 6)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import degrees, isfinite
from typing import Any

from anaplot.adjustment.tested import Observation
from anaplot.orientation.accuracy import ModelAccuracy, model_accuracy
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.results import Diagnosis, ModelSolution, Row
from anaplot.report.astext import line_text
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Column,
    Document,
    Line,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    stacked,
    table,
)
from anaplot.report.matrix import MATRIX, matrix_document
from anaplot.report.modelcorrelations import ELEMENT_COLUMNS, correlations_page
from anaplot.report.testedlines import sigma0_line, test_line

__all__ = ["OF_MODEL", "model_document", "model_rows", "model_tables", "stacked_rows"]

_ROWS = (
    name("point", "POINT", 5),
    name("axis", head="  "),
    number("redn", "RED-N", 3, 8),
    number("parx_um", "PARX", 1, 8, unit="um"),
    number("expd_um", "EXPD", 1, 8, unit="um"),
    number("sigf", "SIGF", 2, 8),
    *for_programs("flagged"),
    name("", "verdict", head="", look=bool),
)
_OFF = for_programs("off")
_POINTS = for_programs("point", "X", "Y", "Z", "sX", "sY", "sZ")
_ODDS = for_programs("point", "axis", "probability")
_PER_LINE = 6
_SAME = {"points": _POINTS, "correlations": ELEMENT_COLUMNS, "matrix": MATRIX}
_BASE, _ANGLES = ("bx", "by", "bz"), ("omega", "phi", "kappa")

OF_MODEL = (name("strip", "STRIP", 5), name("left", "LEFT", 4), name("right", "RIGHT", 5))
"""What stands before the rows of several models' tables."""


def model_document(
    model: ModelSolution,
    *,
    strip: str,
    number: int,
    count: int,
    pooled_um: float | None = None,
    matrix: bool = False,
    correlations: bool = False,
) -> Document:
    """Return the document of one model.

    For programs angles in radians, base and points in mm, residuals in um.

    Parameters
    ----------
    model
        The model.
    strip, number, count
        Name of the strip, which of its models this is (from 1), how many it has.
    pooled_um
        sigma0 pooled over the strip's models so far [um].
    matrix
        Whether Q_vv P is in it, whole.
    correlations
        Whether those of the orientation are on its page and among its tables; its answer has them.
    """
    diagnosis = diagnose(model)
    rows = model_rows(model.listed, diagnosis.suspects)
    accuracy = model_accuracy(model)
    points = table(
        "points",
        _POINTS,
        (
            (p.point, *map(_finite, p[1:]), *map(_finite, deviations))
            for p, deviations in zip(model.points, accuracy.points.tolist(), strict=True)
        ),
    )
    sigma0, tested = sigma0_line(model), test_line(model)
    if pooled_um is not None:
        sigma0 += say(", pooled {:.2f} um", pooled_um)
    if model.ties:
        tested += say("; tie variance {}", model.tie_variance)
    under_base, under_rotation, below = _deviations(accuracy)
    page: list[Block] = [
        say("STRIP {}  MODEL {}/{}  ({} of {})", strip, model.left, model.right, number, count).of(
            "heading"
        ),
        say("  base      bx {:.4f}  by {:.4f}  bz {:.4f} mm", *model.base),
        *under_base,
        say(
            "  rotation  omega {:.5f}  phi {:.5f}  kappa {:.5f} deg", *map(degrees, model.rotation)
        ),
        *under_rotation,
        *below,
        sigma0,
        tested,
        BLANK,
        *_discrepancies("PARALLAXES [um]", [row for row in model.table if row.axis == "y"]),
        *_discrepancies("TIE DISCREPANCIES [um]", [row for row in model.table if row.axis == "x"]),
        BLANK,
        rows,
        BLANK,
        *(say("  {}", sentence) for sentence in diagnosis.advice),
    ]
    answer = _answer(model, diagnosis, accuracy, rows, points)
    answer["advice"] = list(diagnosis.advice)
    tables = [rows, points]
    if correlations:
        related = correlations_page(accuracy.elements, accuracy.correlations)
        page += [BLANK, *related.page]
        tables += related.tables
    if matrix:
        whole = matrix_document(model.tested)
        answer["matrix"] = whole.answer
        page += [BLANK, *whole.page]
        tables += whole.tables
    return Document(answer, tuple(page), tuple(tables))


def _deviations(accuracy: ModelAccuracy) -> tuple[list[Line], list[Line], list[Line]]:
    """Return what stands under the base, under the rotation, and below both."""
    trace = say(
        "  cofactors trace of Q_gg {:.2f} (lengths in bases), correlation of {} and {} {:+.3f}",
        accuracy.trace, *accuracy.strongest,
    )  # fmt: skip
    if accuracy.sigma_um is None:
        return [], [], [trace]
    bx, by, bz = map(accuracy.of, _BASE)
    base = say("    +-      bx {:.4f||held}  by {:.4f}  bz {:.4f} mm", bx, by, bz)
    angles = (degrees(accuracy.of(angle) or 0.0) for angle in _ANGLES)
    rotation = say("    +-      omega {:.5f}  phi {:.5f}  kappa {:.5f} deg", *angles)
    points = say(
        "  points    sX {:.4f}  sY {:.4f}  sZ {:.4f} mm, root mean square", *accuracy.rms.tolist()
    )
    return [base], [rotation], [trace, points]


def _answer(
    model: ModelSolution,
    diagnosis: Diagnosis,
    accuracy: ModelAccuracy,
    rows: Table,
    points: Table,
) -> Answer:
    odds = (
        (*key, chance) for key, chance in zip(model.tested.keys, diagnosis.chances, strict=True)
    )
    return {
        "left": model.left,
        "right": model.right,
        "base": list(model.base),
        "rotation": dict(zip(_ANGLES, model.rotation, strict=True)),
        "sigma0_um": model.sigma0_um,
        "redundancy": model.redundancy,
        "iterations": model.iterations,
        "accuracy": {
            "sigma_um": accuracy.sigma_um,
            "trace_q_gg": accuracy.trace,
            "base": [accuracy.of(each) for each in _BASE],
            "rotation": {each: accuracy.of(each) for each in _ANGLES},
            "elements": list(accuracy.elements),
            "correlations": accuracy.correlations.tolist(),
        },
        "test": {
            "kind": model.test.kind,
            "alpha": model.test.alpha,
            "critical": model.test.critical,
        },
        "table": rows,
        "points": points,
        "ties": list(model.ties),
        "condition": model.condition,
        "odds": {"none": diagnosis.none, "rows": table("odds", _ODDS, odds)},
        "remarks": list(model.remarks),
    }


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def model_rows(model: Iterable[Observation[Row]], suspects: Sequence[Row] = ()) -> Table:
    """Return the RED-N / PARX / EXPD / SIGF table; where rows are switched off, every row says so.

    Parameters
    ----------
    model
        The rows.
    suspects
        Rows to doubt, the most probably wrong first.
    """
    suspect = suspects[0] if suspects else None
    listed = list(model)
    rows = (
        (row.point, row.axis, row.r if row.use else None, _finite(row.residual), row.expected,
         row.size, row.flagged, _verdict(row, suspect))
        for row in listed
    )  # fmt: skip
    out = table("rows", _ROWS, rows, units="^")
    off = [not row.use for row in listed]
    return _with_off(out, off) if any(off) else out


def _with_off(rows: Table, off: Sequence[bool]) -> Table:
    return replace(rows, columns=(*rows.columns, *_OFF), source=(*rows.values, off))


def stacked_rows(leading: Iterable[Column], parts: Iterable[tuple[Sequence[Any], Table]]) -> Table:
    """Return one table of several models' rows; parameters as `stacked` has them."""
    parts = list(parts)
    columns = max((one.columns for _, one in parts), key=len, default=_ROWS)
    alike = (
        (of, one if one.columns == columns else _with_off(one, [False] * len(one)))
        for of, one in parts
    )
    return stacked("rows", leading, columns, alike)


def _verdict(row: Observation[Row], suspect: Row | None) -> str:
    if row.key == suspect:
        return "<< REMEASURE"
    if row.flagged:
        return "< flagged"
    if not row.use:
        return "off"
    return "not testable" if row.w is None else ""


def _discrepancies(title: str, rows: list[Observation[Row]]) -> list[Line]:
    if not rows:
        return []
    width = max(len(line_text(say("{}", row.point))) for row in rows)
    cells = [say("{:>{width}} {:8.1f}", row.point, row.residual, width=width) for row in rows]
    starts = range(0, len(cells), _PER_LINE)
    return [
        say("  {}", title),
        *(say("  {}", named(cells[k : k + _PER_LINE], separator="   ")) for k in starts),
    ]


def model_tables(models: Iterable[tuple[str, Document]]) -> tuple[Table, ...]:
    """Return the tables of several models (strip, document) as single ones."""
    parts = [
        (
            (strip, *map(one.answer.get, ("left", "right"))),
            {table.key: table for table in one.tables},
        )
        for strip, one in models
    ]
    keys = ("points", *(key for key in _SAME if key != "points" and parts and key in parts[0][1]))
    return (
        stacked_rows(OF_MODEL, ((of, tables["rows"]) for of, tables in parts)),
        *(
            stacked(key, OF_MODEL, _SAME[key], ((of, tables[key]) for of, tables in parts))
            for key in keys
        ),
    )
