"""`anaplot plan pattern` and its call: what a point pattern is worth."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.reliability import SERIOUS
from anaplot.adjustment.tested import Tested, Transfer
from anaplot.errors import InputError
from anaplot.exchange.patternfile import is_pattern_file, read_pattern
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.idealmodel import trace_in_bases
from anaplot.orientation.patterns import PATTERNS, USUAL_BASE, USUAL_D
from anaplot.orientation.patterns import pattern as named_pattern
from anaplot.orientation.results import ModelSolution, Row
from anaplot.orientation.suitability import unsuitable
from anaplot.photogrammetry.block import TieVariance
from anaplot.photogrammetry.planting import PlantedError
from anaplot.planning.patternplan import (
    PatternReliability,
    Place,
    PlannedPattern,
    PointAdvice,
    PointSetAdvice,
    Span,
    from_pattern,
    pattern_reliability,
)
from anaplot.report.computed import Computed
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Document,
    Figure,
    Line,
    Names,
    for_programs,
    name,
    number,
    say,
    table,
)
from anaplot.report.keywords import takes_options
from anaplot.report.matrix import matrix_document
from anaplot.report.patterndrawing import drawing
from anaplot.report.planarguments import add_pattern_arguments
from anaplot.report.planting import planted_errors
from anaplot.textfiles.wording import hint, place, quoted

__all__ = [
    "PointsOfPattern",
    "pattern_files",
    "plan_pattern_document",
    "planned_pattern",
    "points_of_pattern",
]

_SHOWN = 5
_LEAST_BASE = 1e-3  # mm


_EQUAL = 5e-4  # nothing is gained where people read the same three decimals

_ROWS = for_programs("point", "x_mm", "y_mm", "axis", "redn")
_CHANGES = (
    name("point", "POINT", 5),
    name("axis", head="  "),
    number("change_um", "CHANGE", 1, 8, unit="um"),
)
_POINTS = for_programs("label", "x_mm", "y_mm", "tie")
_PLACES = ("x_mm", "y_mm", "doubles", "tie")


def plan_pattern_document(
    title: str,
    found: PatternReliability,
    *,
    base_derived: bool = False,
    planted: Sequence[PlantedError] = (),
    matrix: bool = False,
) -> Document:
    """Return the document of a point pattern.

    Parameters
    ----------
    title
        Name of the pattern, or of its file.
    found
        What it is worth.
    base_derived
        Whether the base follows from the points.
    planted
        Errors in rows, of which the changes of all are shown.
    matrix
        Whether Q_vv P is shown whole.

    Raises
    ------
    InputError
        An error is planted in a row that there is not.
    """
    plan, solution = found.plan, found.solution
    transfers = diagnose(solution).transfers
    verdict = unsuitable(transfers)
    at = {label: (x, y) for label, x, y in plan.points}
    rows = table(
        "rows", _ROWS, ((row.point, *at[row.point], row.axis, row.r) for row in solution.table)
    )
    points = table("points", _POINTS, ((*one, one[0] in plan.ties) for one in plan.points))
    expected = np.sqrt(np.maximum(np.diag(solution.q_vv), 0.0)).tolist()
    answer: Answer = {
        "points": points,
        "tie_variance": solution.tie_variance,
        "rows": [
            {"point": row.point, "axis": row.axis, "redn": row.r, "expd": expd}
            for row, expd in zip(solution.table, expected, strict=True)
        ],
        "n": len(rows),
        "base_mm": plan.base,
        "mean_redn": float(np.mean([row.r for row in solution.table])),
        "trace_q_gg": trace_in_bases(solution, plan.base),
        "suitable": not verdict,
        "transfers": [_transfer_json(one) for one in transfers if one.critical],
        "serious_transfers": [_transfer_json(one) for one in transfers if not one.critical],
        "advice": [
            _place_json((one.x, one.y, one.doubles, one.tie))
            | {"before": one.before, "after": one.after}
            for one in found.advice[:_SHOWN]
        ],
        "advice_sets": [
            {
                "points": [_place_json(place) for place in one.places],
                "symmetric": one.symmetric,
                "before": one.before,
                "after": one.after,
            }
            for one in found.sets
        ],
        "base_derived": base_derived,
    }
    page: list[Block] = [
        say("PATTERN {}: redundancy numbers at the points", quoted(title)).of("heading")
    ]
    if plan.ties:
        page.append(say("tie variance {}", solution.tie_variance))
    if base_derived:
        base = say("base {:g} mm: the largest x of the points, as no --base is given", plan.base)
        page.append(base.of("remark"))
    page += [
        BLANK,
        Figure("pattern", (plan, solution, transfers), lambda data: drawing(*data)),
        BLANK,
        say("n {n}   mean r {mean_redn:.3f}   trace Q_gg {trace_q_gg:.2f} (lengths in bases)",
            **answer),
        *_transfers(transfers),
        *([say("{}", verdict).folded(2)] if verdict else ()),
        _advice(found.advice[0]),
        *_sets(found.sets),
    ]  # fmt: skip
    tables = [rows, points]
    for key, part in _parts(solution, planted, matrix):
        answer[key] = part.answer
        page += [BLANK, *part.page]
        tables += part.tables
    return Document(answer, tuple(page), tuple(tables))


def _parts(
    solution: ModelSolution, planted: Sequence[PlantedError], matrix: bool
) -> Iterator[tuple[str, Document]]:
    if planted:
        yield "planted", _planted_document(solution.tested, planted)
    if matrix:
        yield "matrix", matrix_document(solution.tested)


def _planted_document(tested: Tested[Row], planted: Sequence[PlantedError]) -> Document:
    """Return what errors in rows change in all of them (1983, Table 1)."""
    keys = tested.keys
    change = np.zeros(len(keys))
    for one in planted:
        key = (one.where, one.axis)
        if key not in keys:
            known = hint(one.where, [point for point, axis in keys if axis == one.axis])
            raise InputError(f"--plant: no row {quoted(one.where)} {one.axis}{known}")
        change += tested.influence[:, keys.index(key)] * one.um
    rows = table(
        "planted", _CHANGES, ((*key, um) for key, um in zip(keys, change.tolist(), strict=True))
    )
    what = ", ".join(f"{one.where} {one.axis} {one.um:+g} um" for one in planted)
    page = (say("CHANGE OF ALL RESIDUALS by an error: {}", what).of("heading"), rows)
    errors = [{"point": one.where, "axis": one.axis, "um": one.um} for one in planted]
    return Document({"errors": errors, "rows": rows}, page, (rows,))


def _place_json(place: Place) -> Answer:
    return dict(zip(_PLACES, place, strict=True))


def _transfer_json(one: Transfer[Row]) -> Answer:
    return {"source": one.source, "target": one.target, "value": one.value, "share": one.share}


def _transfers(transfers: tuple[Transfer[Row], ...]) -> list[Line]:
    """Return one arrow per transfer, with its value."""
    critical = [one for one in transfers if one.critical]
    serious = [one for one in transfers if not one.critical]
    if not critical:
        lines = [say("no critical transfers")]
    else:
        lines = [
            say("critical transfers (an error in the first shows at least as large in the second)"),
            *(say("  {} ({}) --> {} ({})  {:+.3f}", *one.source, *one.target, one.value)
              for one in critical),
        ]  # fmt: skip
    if not serious:
        return [*lines, say("no serious transfers")]
    return [
        *lines,
        say("serious transfers (the second shows at least {:g} of what the first does)", SERIOUS),
        *(say("  {} ({}) ..> {} ({})  {:+.3f}, {:.2f} of its own {:.3f}", *one.source,
              *one.target, one.value, one.share, one.own)
          for one in serious),
    ]  # fmt: skip


def _advice(best: PointAdvice) -> Line:
    """Return what one further point would do for the weakest redundancy number."""
    if best.after <= best.before + _EQUAL:
        return say(
            "no further point tried raises the weakest redundancy number {:.3f}", best.before
        )
    what = _further((best.x, best.y, best.doubles, best.tie), "one more point at ")
    effect = say(
        "helps the weakest redundancy number most: {:.3f} -> {:.3f}", best.before, best.after
    )
    return say("{}", Names((what, effect), separator=" ")).folded(2)


def _sets(best: tuple[PointSetAdvice, ...]) -> Iterator[Line]:
    """Return what several further points together would do for it."""
    for one in best:
        count = {2: "two", 4: "four"}.get(len(one.places), str(len(one.places)))
        if one.after <= one.before + _EQUAL:
            yield say("no {} points tried do either", count)
            continue
        mirrored = ", symmetric" if one.symmetric else ""
        yield say("the best {} together{}: {:.3f} -> {:.3f}", count, mirrored, one.before,
                  one.after)  # fmt: skip
        yield from (say("  ") + _further(place, "a point at ") for place in one.places)


def _further(place: Place, at: str) -> Line:
    x, y, doubles, tie = place
    what = say("a double of {}", doubles)
    if doubles is None:
        what = say("{}x {:.1f}, y {:.1f} mm", at, x, y)
    return what + (" as a tie" if tie else "")


class PointsOfPattern(NamedTuple):
    """What is planned, and where a further point may lie: the ends of x and y [mm]."""

    plan: PlannedPattern
    x: Span
    y: Span
    base_derived: bool


def points_of_pattern(
    name: str, ties: str | None, base: float | None, d: float | None, c: float
) -> PointsOfPattern:
    """Return the points of a named pattern or of a file; parameters as `planned_pattern` has them.

    Raises
    ------
    InputError
        The name or the file is wrong.
    """
    path = Path(name)
    if not pattern_files(name):
        return _named(name, ties, base, d, c)
    if ties is not None:
        raise InputError("--ties goes with a named pattern; a file says itself which points tie")
    own = read_pattern(path)
    points = own.places
    xs, ys = [x for _, x, _ in points], [y for _, _, y in points]
    used = base
    if used is None:
        used = max(xs)
        if used < _LEAST_BASE:
            raise InputError(f"{place(path)}: which --base? no point lies at an x greater than 0")
    return PointsOfPattern(
        PlannedPattern(points, own.ties, used, c),
        (min(xs), max(xs)) if base is None else (0.0, used),
        (min(ys), max(ys)) if d is None else (-d, d),
        base is None,
    )


def _named(
    name: str, ties: str | None, base: float | None, d: float | None, c: float
) -> PointsOfPattern:
    # Path("") is the folder itself
    if name not in PATTERNS and (not name or os.path.lexists(name)):
        raise InputError(
            f"{quoted(name)} is no point pattern: a name as 13/5, or a .csv or .toml file of points"
        )
    if ties is not None:
        if "/" in name:
            raise InputError(f"--ties {ties}: {quoted(name)} says itself how many tie")
        name = f"{name}/{ties}"
    base = USUAL_BASE if base is None else base
    d = USUAL_D if d is None else d
    return PointsOfPattern(
        from_pattern(named_pattern(name), base, d, c), (0.0, base), (-d, d), base_derived=False
    )


def pattern_files(pattern: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the file that a pattern is read from; a named one is in none."""
    return (Path(pattern),) if is_pattern_file(pattern) else ()


@takes_options(add_pattern_arguments)
def planned_pattern(
    pattern: str | os.PathLike[str],
    *,
    ties: Literal[3, 4, 5, "3", "4", "5"] | None = None,
    base: float | None = None,
    d: float | None = None,
    c: float = 152.0,
    tie_variance: TieVariance = "exact",
    plant: str | Sequence[str] | None = None,
    matrix: bool = False,
) -> Computed[PatternReliability]:
    """Plan a model: redundancy numbers of a point pattern, and the point that would help most.

    Parameters
    ----------
    pattern
        A name, "13" or "13/5", or a file of points.
    ties
        Points shared with the preceding model, where the name does not say it.
    base, d
        Base, and half the model in y [mm]; None: 90 and 100, for a file as its points lie.
    c
        Camera constant [mm].
    tie_variance
        How the ties err.
    plant
        Errors "POINT:AXIS:UM" in rows, of which the changes of all are shown.
    matrix
        Whether the document has Q_vv P whole.

    Returns
    -------
    Computed of PatternReliability
        The ideal model with its tests, and where further points would help.

    Raises
    ------
    InputError
        The pattern's name or file is wrong.
    NotComputableError
        The points do not determine a model.
    """
    planned = points_of_pattern(os.fspath(pattern), None if ties is None else str(ties), base, d, c)
    found = pattern_reliability(planned.plan, planned.x, planned.y, tie_variance)
    title = Path(pattern).name if pattern_files(pattern) else str(pattern)
    document = plan_pattern_document(
        title,
        found,
        base_derived=planned.base_derived,
        planted=planted_errors(plant or ()),
        matrix=matrix,
    )
    return Computed(found, document)
