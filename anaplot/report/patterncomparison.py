"""`anaplot plan pattern` with several patterns: what each is worth, side by side."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from anaplot.errors import InputError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.idealmodel import trace_in_bases
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.block import TieVariance
from anaplot.planning.patternplan import solve
from anaplot.report.computed import Computed
from anaplot.report.document import Document, for_programs, name, number, say, table, whole
from anaplot.report.keywords import takes_options
from anaplot.report.planarguments import add_pattern_arguments
from anaplot.report.planpattern import pattern_files, planned_pattern, points_of_pattern
from anaplot.report.running import run_computation

__all__ = ["compared_patterns", "run_plan_pattern"]

_COLUMNS = (
    name("pattern", "PATTERN", 8),
    whole("n", "ROWS", 6),
    whole("ties", "TIES", 6),
    *for_programs("redundancy"),
    number("least_redn", "LEAST r", 3, 9),
    number("mean_redn", "MEAN r", 3, 8),
    number("trace_q_gg", "TRACE", 2, 8),
    whole("critical", "CRITICAL", 10),
    whole("serious", "SERIOUS", 9),
    name("", "", form=str, head=""),
)


def run_plan_pattern(options: argparse.Namespace) -> int:
    """Say what a pattern is worth, or several side by side.

    Raises
    ------
    AnaplotError
        Bad input, or what cannot be computed; nothing is printed then.
    """
    given = list(options.pattern)
    files = [path for one in given for path in pattern_files(one)]
    if len(given) == 1:
        (options.pattern,) = given
        return run_computation(options, planned_pattern, files)
    if options.plant is not None or options.matrix:
        raise InputError("--plant and --matrix go with one pattern")
    options.patterns = given
    return run_computation(options, compared_patterns, files)


@takes_options(add_pattern_arguments)
def compared_patterns(
    patterns: Sequence[str | os.PathLike[str]],
    *,
    ties: Literal[3, 4, 5, "3", "4", "5"] | None = None,
    base: float | None = None,
    d: float | None = None,
    c: float = 152.0,
    tie_variance: TieVariance = "exact",
) -> Computed[tuple[ModelSolution, ...]]:
    """Say what several patterns of points are worth, side by side (1983, Figures 2, 4 and 7).

    Parameters
    ----------
    patterns
        Names or files, as `planned_pattern` takes them.
    ties, base, d, c, tie_variance
        As `planned_pattern` has them, for all.

    Returns
    -------
    Computed of tuple of ModelSolution
        The ideal model of each.

    Raises
    ------
    InputError
        A pattern's name or file is wrong, or one is given twice.
    NotComputableError
        The points of one do not determine a model.
    """
    titles = [Path(one).name if pattern_files(one) else str(one) for one in patterns]
    twice = next((title for title in titles if titles.count(title) > 1), None)
    if twice is not None:
        raise InputError(f"pattern {twice} is given twice")
    tied = None if ties is None else str(ties)
    models = tuple(
        solve(points_of_pattern(os.fspath(one), tied, base, d, c).plan, tie_variance)
        for one in patterns
    )
    rows = table("patterns", _COLUMNS, map(_row, titles, models))
    page = (say("PATTERNS side by side; trace of Q_gg with lengths in bases").of("heading"), rows)
    return Computed(models, Document({"patterns": rows}, page, (rows,)))


def _row(title: str, model: ModelSolution) -> tuple[object, ...]:
    r = model.tested.r
    transfers = diagnose(model).transfers
    critical = sum(one.critical for one in transfers)
    return (
        title,
        len(r),
        len(model.ties),
        model.redundancy,
        float(np.min(r)),
        float(np.mean(r)),
        trace_in_bases(model, abs(model.base[0])),
        critical,
        len(transfers) - critical,
        "not suitable" if critical else "",
    )
