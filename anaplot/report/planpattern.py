"""The command `anaplot plan pattern`."""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.patternfile import read_pattern
from anaplot.exchange.wording import quoted
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.patterns import pattern, trace_in_bases
from anaplot.orientation.results import ModelSolution
from anaplot.planning.patternplan import Advice, PlannedPattern, advise, from_pattern, grid, solve
from anaplot.report.plantext import advice_lines, drawing, transfer_lines

__all__ = ["pattern_json", "run_plan_pattern"]

_SHOWN = 5
_FILES = (".csv", ".toml")


def pattern_json(
    plan: PlannedPattern, solution: ModelSolution, advice: tuple[Advice, ...]
) -> dict[str, Any]:
    """Return what `--json` prints."""
    redn = [row.redn for row in solution.table]
    return {
        "points": [
            {"label": label, "x_mm": x, "y_mm": y, "tie": label in plan.ties}
            for label, x, y in plan.points
        ],
        "rows": [{"point": r.point, "axis": r.axis, "redn": r.redn} for r in solution.table],
        "n": len(redn),
        "mean_redn": float(np.mean(redn)),
        "trace_q_gg": trace_in_bases(solution, plan.base),
        "transfers": [
            {"source": list(t.source), "target": list(t.target), "value": t.value}
            for t in diagnose(solution).transfers
        ],
        "advice": [
            {"x_mm": a.x, "y_mm": a.y, "doubles": a.doubles, "before": a.before, "after": a.after}
            for a in advice[:_SHOWN]
        ],
    }


def _plan(options: argparse.Namespace) -> PlannedPattern:
    path = Path(options.pattern)
    if path.suffix.lower() not in _FILES:
        name = options.pattern if options.ties is None else f"{options.pattern}/{options.ties}"
        return from_pattern(pattern(name), options.base, options.d, options.c)
    if options.ties is not None:
        raise InputError("--ties goes with a named pattern; a file says itself which points tie")
    points, ties = read_pattern(path)
    return PlannedPattern(points, ties, options.base, options.c)


def run_plan_pattern(options: argparse.Namespace) -> int:
    """Show a point pattern and what would help it most.

    Raises
    ------
    InputError
        The pattern's name or file is wrong.
    NotComputableError
        The points do not determine a model.
    """
    plan = _plan(options)
    solution = solve(plan, options.tie_variance)
    advice = advise(plan, grid(options.base, options.d), options.tie_variance)
    if options.csv is not None:
        at = {label: (x, y) for label, x, y in plan.points}
        with options.csv.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("point", "x_mm", "y_mm", "axis", "redn"))
            writer.writerows((r.point, *at[r.point], r.axis, r.redn) for r in solution.table)
    if options.json:
        print(json.dumps(pattern_json(plan, solution, advice), indent=1, allow_nan=False))
        return 0
    path = Path(options.pattern)
    title = path.name if path.suffix.lower() in _FILES else options.pattern
    redn = [row.redn for row in solution.table]
    print(f"PATTERN {quoted(title)}: redundancy numbers at the points")
    transfers = diagnose(solution).transfers
    print("\n".join(["", *drawing(plan, solution, transfers), ""]))
    print(
        f"n {len(redn)}   mean r {np.mean(redn):.3f}   "
        f"trace Q_gg {trace_in_bases(solution, plan.base):.2f} (lengths in bases)"
    )
    print("\n".join((*transfer_lines(transfers), *advice_lines(advice[0]))))
    return 0
