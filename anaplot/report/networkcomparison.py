"""`anaplot plan network` with several versions of the cube: what each is worth, side by side."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from anaplot.bundle.solve.rulesofthumb import rules_of_thumb
from anaplot.report.computed import Computed
from anaplot.report.document import (
    BLANK,
    Document,
    for_programs,
    name,
    number,
    say,
    table,
    whole,
)
from anaplot.report.pageoption import AskedPage, MakesPage
from anaplot.report.planarguments import add_network_arguments
from anaplot.report.planblock import run_planned
from anaplot.report.plannetwork import PlannedNetwork, network_files, planned_network
from anaplot.report.running import refuse_with_several, run_side_by_side

__all__ = ["compared_networks", "run_plan_network"]

_COLUMNS = (
    name("network", "NETWORK", 9),
    whole("photos", "PHOTOS", 7),
    whole("observations", "n", 6),
    whole("unknowns", "u", 5),
    whole("redundancy", "r", 5),
    number("ri_x", "RI x'", 3, 7),
    number("ri_y", "y'", 3, 6),
    number("ri", "both", 3, 6),
    *(number(f"ai_{axis}", f"AI {axis.upper()}", 3, 8, unit="m", scale=1e3) for axis in "xyz"),
    number("ai", "all mm", 3, 8, unit="m", scale=1e3),
)
_TESTS = (
    name("network", "NETWORK", 9),
    name("reliable", "RI >= 0.6", 10, form=lambda met: "met" if met else "not met"),
    whole("in_fewer", "IN FEWER THAN 4 PHOTOS", 23),
    whole("new", "OF NEW", 8),
    number("alpha", "ALPHA", 3, 8),
    number("critical", "LIMIT", 3, 7),
    *for_programs("power"),
)


def run_plan_network(options: argparse.Namespace, report: MakesPage) -> int:
    """Say what a network is worth, or several versions of the cube side by side.

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
    versions = options.case
    if versions is None or len(versions) == 1:
        reads = network_files(options.network)
        page = AskedPage.of(options, "plan network", add_network_arguments, lambda: reads, report)
        return run_planned(options, planned_network, page, reads)
    alone = ("to", "point", "plant", "correlations", "report", "figures", "angles")
    refuse_with_several(options, alone, add_network_arguments, "one version of the cube")
    reads = network_files(options.network)
    return run_side_by_side(options, "case", planned_network, compared_networks, reads)


def compared_networks(
    networks: Sequence[PlannedNetwork],
) -> Computed[tuple[PlannedNetwork, ...]]:
    """Put planned networks side by side (1978, Table 2).

    Parameters
    ----------
    networks
        The results of `planned_network`.
    """
    rows = table("networks", _COLUMNS, map(_worth, networks))
    verdicts = table("verdicts", _TESTS, map(_verdict, networks))
    page = (
        say("NETWORKS side by side: mean redundancy numbers, mean standard deviations").of(
            "heading"
        ),
        rows,
        BLANK,
        say("RULES of 1978 and 1980, and the global test as powerful as the single one").of(
            "heading"
        ),
        verdicts,
    )
    answer = {"networks": rows, "verdicts": verdicts}
    return Computed(tuple(networks), Document(answer, page, (rows, verdicts)))


def _worth(one: PlannedNetwork) -> tuple[object, ...]:
    problem = one.block.problem
    return (
        one.network.name,
        len(problem.photos),
        problem.observations,
        problem.unknowns,
        one.block.redundancy,
        *one.block.indicators(),
    )


def _verdict(one: PlannedNetwork) -> tuple[object, ...]:
    rules, overall = rules_of_thumb(one.block), one.block.global_test()
    tested = (None,) * 3 if overall is None else (overall.alpha, overall.critical, overall.power)
    return one.network.name, rules.reliable, rules.in_fewer, rules.new, *tested
