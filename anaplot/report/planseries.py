"""`anaplot plan block` with several bridging distances: the reliability models of 1980."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.planning.bridgingseries import SeriesClass, bridging_series
from anaplot.report.computed import Computed
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Column,
    Document,
    Table,
    for_programs,
    name,
    number,
    say,
    table,
    whole,
)
from anaplot.report.pageoption import AskedPage, MakesPage
from anaplot.report.planarguments import add_block_arguments
from anaplot.report.planblock import PlannedBlock, plan_lines, planned_block, run_planned
from anaplot.report.running import refuse_with_several, run_side_by_side
from anaplot.report.workplace import place_of
from anaplot.shares.address import LOCAL

__all__ = ["PlannedSeries", "block_series", "run_plan_block"]


class PlannedSeries(NamedTuple):
    """Planned blocks that differ in their bridging distance.

    Attributes
    ----------
    blocks
        In the order given.
    classes
        The classes of Table 2 over all of them.
    """

    blocks: tuple[PlannedBlock, ...]
    classes: tuple[SeriesClass, ...]


def run_plan_block(options: argparse.Namespace, report: MakesPage) -> int:
    """Say what a block is worth, or what it is with several bridging distances.

    Parameters
    ----------
    options
        Of the command line.
    report
        Makes the page that `--report` writes.

    Raises
    ------
    AnaplotError
        Bad input, or what cannot be computed; nothing is printed then.
    """
    distances = options.bridging
    if distances is None or len(distances) == 1:
        if options.on != LOCAL:
            raise InputError("--on goes with several bridging distances: each is a share")
        page = AskedPage.of(options, "plan block", add_block_arguments, tuple, report)
        return run_planned(options, planned_block, page)
    at = None if options.on == LOCAL else place_of(options.on, None, None)
    alone = ("to", "stabilize", "report", "figures", "angles")
    refuse_with_several(options, alone, add_block_arguments, "one bridging distance")
    twice = next((one for one in distances if distances.count(one) > 1), None)
    if twice is not None:
        raise InputError(f"bridging distance {twice:g} is given twice")
    options.stabilize = 0  # of points for weak photos nothing is shown
    return run_side_by_side(options, "bridging", planned_block, block_series, at=at)


def block_series(blocks: Sequence[PlannedBlock]) -> Computed[PlannedSeries]:
    """Put planned blocks side by side that differ in their bridging distance (1980, Table 2).

    Parameters
    ----------
    blocks
        The results of `planned_block`.
    """
    classes = bridging_series([one.plan for one in blocks], [one.block for one in blocks])
    wide = _wide(blocks, classes)
    answer = {
        "bridging": [one.plan.bridging for one in blocks],
        "classes": [_class_json(row) for row in classes],
    }
    page: tuple[Block, ...] = (
        *plan_lines(blocks[0].plan, [one.plan.bridging for one in blocks]),
        BLANK,
        say("CLASSES (Gruen 1980, Table 2): means of sqrt(q_vv) by bridging distance").of(
            "heading"
        ),
        wide,
        say("O, I: outer and inner rays, C: of control; number of rays, 4 for four and more"),
        *_curves(classes),
        *_beyond(classes),
    )
    result = PlannedSeries(tuple(blocks), classes)
    return Computed(result, Document(answer, page, (wide,)))


def _wide(blocks: Sequence[PlannedBlock], classes: Sequence[SeriesClass]) -> Table:
    distances = [one.plan.bridging for one in blocks]
    columns: tuple[Column, ...] = (
        name("class", "CLASS", 6),
        name("axis", "AXIS", 5),
        *(number(f"mean_root_{d:g}", f"i {d:g}", 3, 8) for d in distances),
        number("mean_root", "MEAN", 3, 8),
        number("paper", "PAPER", 2, 8),
        whole("beyond", "BEYOND 25 %", 13),
        *for_programs("number"),
    )
    rows = []
    for row in classes:
        means = {at.bridging: at.mean_root for at in row.at}
        beyond = [at.beyond for at in row.at if at.beyond is not None]
        rows.append(
            (row.name, row.axis, *(means.get(d) for d in distances), row.mean_root, row.paper,
             sum(beyond) if beyond else None, sum(at.number for at in row.at))
        )  # fmt: skip
    return table("series", columns, rows)


def _curves(classes: Sequence[SeriesClass]) -> list[Block]:
    """Say what the paper's curves of control give at these distances (below its Figure 8)."""
    lines: list[Block] = [
        say(
            "{} {}: the paper's curve gives {}",
            row.name,
            row.axis,
            ", ".join(f"{at.curve:.3f}" for at in row.at if at.curve is not None),
        )
        for row in classes
        if any(at.curve is not None for at in row.at)
    ]
    return lines


def _beyond(classes: Sequence[SeriesClass]) -> list[Block]:
    """Say where the paper's tolerance does not cover exact values (its Figure 9)."""
    lines: list[Block] = [
        say(
            "{} {}, i {:g}: {} of {} are more than 25 % from {:.2f}, {:.3f} in the mean",
            row.name,
            row.axis,
            at.bridging,
            at.beyond,
            at.number,
            row.paper,
            at.beyond_root,
        )
        for row in classes
        for at in row.at
        if at.beyond
    ]
    return lines


def _class_json(row: SeriesClass) -> Answer:
    figures = row._asdict()
    return {"class": figures.pop("name"), **figures, "at": [at._asdict() for at in row.at]}
