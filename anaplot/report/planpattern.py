"""The command `anaplot plan pattern`."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.patternfile import read_pattern
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.patterns import PATTERNS, pattern, trace_in_bases
from anaplot.orientation.results import ModelSolution
from anaplot.planning.patternplan import (
    USUAL_BASE,
    USUAL_D,
    PlannedPattern,
    PointAdvice,
    PointSetAdvice,
    Span,
    advise_point_sets,
    advise_points,
    from_pattern,
    grid,
    solve,
)
from anaplot.report.csvoutput import check_csv, write_csv
from anaplot.report.plantext import advice_lines, drawing, set_lines, transfer_lines
from anaplot.textfiles.wording import place, quoted

__all__ = ["pattern_json", "run_plan_pattern"]

_SHOWN = 5
_FILES = (".csv", ".toml")
_LEAST_BASE = 1e-3  # mm


def pattern_json(
    plan: PlannedPattern,
    solution: ModelSolution,
    advice: tuple[PointAdvice, ...],
    sets: tuple[PointSetAdvice, ...],
) -> dict[str, Any]:
    """Return what `--json` prints."""
    r = [row.r for row in solution.table]
    return {
        "points": [
            {"label": label, "x_mm": x, "y_mm": y, "tie": label in plan.ties}
            for label, x, y in plan.points
        ],
        "tie_variance": solution.tie_variance,
        "rows": [
            {"point": r.point, "axis": r.axis, "redn": r.r, "expd": max(q, 0.0) ** 0.5}
            for r, q in zip(solution.table, np.diag(solution.q_vv).tolist(), strict=True)
        ],
        "n": len(r),
        "base_mm": plan.base,
        "mean_redn": float(np.mean(r)),
        "trace_q_gg": trace_in_bases(solution, plan.base),
        "transfers": [
            {"source": list(t.source), "target": list(t.target), "value": t.value}
            for t in diagnose(solution).transfers
        ],
        "advice": [
            {
                "x_mm": a.x,
                "y_mm": a.y,
                "doubles": a.doubles,
                "tie": a.tie,
                "before": a.before,
                "after": a.after,
            }
            for a in advice[:_SHOWN]
        ],
        "advice_sets": [
            {
                "points": [
                    {"x_mm": x, "y_mm": y, "doubles": doubles, "tie": tie}
                    for x, y, doubles, tie in one.places
                ],
                "symmetric": one.symmetric,
                "before": one.before,
                "after": one.after,
            }
            for one in sets
        ],
    }


class _Planned(NamedTuple):
    """What is planned, and where a further point may lie: the ends of x and y [mm]."""

    plan: PlannedPattern
    x: Span
    y: Span
    base_derived: bool


def _planned(options: argparse.Namespace) -> _Planned:
    path = Path(options.pattern)
    if path.suffix.lower() not in _FILES:
        return _named(options)
    if options.ties is not None:
        raise InputError("--ties goes with a named pattern; a file says itself which points tie")
    points, ties = read_pattern(path)
    xs, ys = [x for _, x, _ in points], [y for _, _, y in points]
    base = options.base
    if base is None:
        base = max(xs)
        if base < _LEAST_BASE:
            raise InputError(f"{place(path)}: which --base? no point lies at an x greater than 0")
    return _Planned(
        PlannedPattern(points, ties, base, options.c),
        (min(xs), max(xs)) if options.base is None else (0.0, base),
        (min(ys), max(ys)) if options.d is None else (-options.d, options.d),
        options.base is None,
    )


def _named(options: argparse.Namespace) -> _Planned:
    name = options.pattern
    # Path("") is the folder itself
    if name not in PATTERNS and (not name or os.path.lexists(name)):
        raise InputError(
            f"{quoted(name)} is no point pattern: a name as 13/5, or a .csv or .toml file of points"
        )
    if options.ties is not None:
        if "/" in name:
            raise InputError(f"--ties {options.ties}: {quoted(name)} says itself how many tie")
        name = f"{name}/{options.ties}"
    base = USUAL_BASE if options.base is None else options.base
    d = USUAL_D if options.d is None else options.d
    plan = from_pattern(pattern(name), base, d, options.c)
    return _Planned(plan, (0.0, base), (-d, d), base_derived=False)


def run_plan_pattern(options: argparse.Namespace) -> int:
    """Show a point pattern and what would help it most.

    Raises
    ------
    InputError
        The pattern's name or file is wrong.
    NotComputableError
        The points do not determine a model.
    """
    path = Path(options.pattern)
    from_file = path.suffix.lower() in _FILES
    check_csv(options.csv, {"is read": (path,) if from_file else ()})
    planned = _planned(options)
    plan = planned.plan
    solution = solve(plan, options.tie_variance)
    places = grid(planned.x, planned.y)
    advice = advise_points(plan, places, options.tie_variance)
    sets = advise_point_sets(plan, places, options.tie_variance)
    if options.csv is not None:
        at = {label: (x, y) for label, x, y in plan.points}
        write_csv(
            options.csv,
            ("point", "x_mm", "y_mm", "axis", "redn"),
            ((r.point, *at[r.point], r.axis, r.r) for r in solution.table),
        )
    if options.json:
        answer = pattern_json(plan, solution, advice, sets)
        answer["base_derived"] = planned.base_derived
        print(json.dumps(answer, indent=1, allow_nan=False))
        return 0
    title = path.name if from_file else options.pattern
    r = [row.r for row in solution.table]
    print(f"PATTERN {quoted(title)}: redundancy numbers at the points")
    if plan.ties:
        print(f"tie variance {options.tie_variance}")
    if planned.base_derived:
        print(f"base {plan.base:g} mm: the largest x of the points, as no --base is given")
    transfers = diagnose(solution).transfers
    print("\n".join(["", *drawing(plan, solution, transfers), ""]))
    print(
        f"n {len(r)}   mean r {np.mean(r):.3f}   "
        f"trace Q_gg {trace_in_bases(solution, plan.base):.2f} (lengths in bases)"
    )
    print("\n".join((*transfer_lines(transfers), *advice_lines(advice[0]), *set_lines(sets))))
    return 0
