"""What `report` takes: what `adjust` takes, and where the page goes; light, `--help` reads it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from anaplot.report.adjustarguments import add_adjust_arguments
from anaplot.report.arguments import add_target, whole
from anaplot.report.commandparser import Commands, NewPage, NewTarget

__all__ = ["add_page_arguments", "add_report_arguments", "add_report_command"]


def add_page_arguments(parser: argparse.ArgumentParser) -> None:
    """Add how a page is written."""
    parser.add_argument(
        "--figures",
        type=Path,
        action=NewTarget,
        metavar="FOLDER",
        help="write every figure of the page as an SVG file too",
    )
    parser.add_argument(
        "--angles",
        choices=("deg", "gon"),
        default="deg",
        help="unit of angles on the page: degrees (the default) or gon",
    )
    parser.add_argument(
        "--rows",
        type=whole(10, 10_000_000),
        default=2500,
        metavar="N",
        help="of a table with more rows the page shows those that need a look, and FILE.tables has "
        "it whole; default 2500",
    )


def add_report_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `report` takes."""
    add_target(parser, "FILE.html", "the page", NewPage)
    parser.add_argument(
        "--fiducials",
        type=Path,
        nargs="+",
        action="extend",
        default=[],
        metavar="FILE",
        help="files of measured fiducials, as inner takes them: their inner orientations stand in "
        "the report",
    )
    add_page_arguments(parser)
    add_adjust_arguments(parser)
    parser.set_defaults(datum=None)  # that of control, or a free one


def add_report_command(commands: Commands, run: Callable[[argparse.Namespace], int]) -> None:
    """Add the command `report`, which a function runs."""
    commands.add(
        "report",
        run,
        "the adjusted block as one page that stands by itself: verdict, figures, tables",
        "anaplot report myblock -o report.html",
        "anaplot report myblock -o search.html --errors search --figures figures",
    ).later(add_report_arguments)
