"""The command line of `anaplot plan` and its parts; light, `--help` reads it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from anaplot.report.commandparser import CommandParser, Commands
from anaplot.report.planarguments import (
    add_additional_arguments,
    add_block_arguments,
    add_network_arguments,
    add_pattern_arguments,
    add_run_arguments,
    add_series_arguments,
    add_simulate_arguments,
)

if TYPE_CHECKING:
    from anaplot.report.computed import Computed
    from anaplot.report.html.parts import Report

__all__ = ["add_plan_commands"]


def _plan_pattern(options: argparse.Namespace) -> int:
    from anaplot.report.patterncomparison import run_plan_pattern

    return run_plan_pattern(options)


def _plan_simulate(options: argparse.Namespace) -> int:
    from anaplot.report.simulatecommand import run_simulate

    return run_simulate(options)


def _plan_block(options: argparse.Namespace) -> int:
    from anaplot.report.planseries import run_plan_block

    def report(found: Computed[Any]) -> Report:
        from anaplot.report.html.pages.planpage import block_plan_report

        return block_plan_report(found, written=options.to is not None)

    return run_plan_block(options, report)


def _plan_network(options: argparse.Namespace) -> int:
    from anaplot.report.networkcomparison import run_plan_network

    def report(found: Computed[Any]) -> Report:
        from anaplot.report.html.pages.planpage import network_plan_report

        return network_plan_report(found, written=options.to is not None)

    return run_plan_network(options, report)


def _plan_additional(options: argparse.Namespace) -> int:
    from anaplot.report.planadditional import run_plan_additional

    return run_plan_additional(options)


def add_plan_commands(commands: Commands) -> None:
    """Add `plan` and its parts."""
    plan = commands.add(
        "plan",
        None,
        "what a measurement would be worth, before it is made",
        "anaplot plan pattern 13/5",
        "anaplot plan network cube --case A,B",
        description="Planning: reliability from geometry alone.",
    )
    plan.later(_add_parts)


def _add_parts(plan: CommandParser) -> None:
    parts = Commands(plan, "part")
    add_pattern_arguments(
        parts.add(
            "pattern",
            _plan_pattern,
            "redundancy numbers of a point pattern, and the point that would help most",
            "anaplot plan pattern 6 --ties 3",
            "anaplot plan pattern 13 13/5 --c 152 --csv patterns.csv",
        )
    )
    block = parts.add(
        "block",
        _plan_block,
        "a regular aerial block: classes of observations, weak photos, accuracy",
        "anaplot plan block --strips 4 --photos 8 --bridging 3 --twin",
        "anaplot plan block --points 5x5 --stabilize 2 --to planned",
    )
    add_block_arguments(block)
    add_series_arguments(block)
    add_network_arguments(
        parts.add(
            "network",
            _plan_network,
            "camera stations around an object: what they see, check and determine",
            "anaplot plan network cube --case C --point 2",
            "anaplot plan network cube --plant 1:2:x:-30",
        )
    )
    add_additional_arguments(
        parts.add(
            "additional",
            _plan_additional,
            "a set of additional parameters: its terms, and what they have in common",
            "anaplot plan additional gruen",
            "anaplot plan additional ebner:b1,b2 --json",
        )
    )
    simulate = parts.add(
        "simulate",
        _plan_simulate,
        "Monte Carlo: how often errors are found, rightly or wrongly",
        "anaplot plan simulate --list",
        "anaplot plan simulate kratky-1983-6-3 --runs 500",
    )
    add_simulate_arguments(simulate)
    add_run_arguments(simulate)
