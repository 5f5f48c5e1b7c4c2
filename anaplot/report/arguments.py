"""Options that several commands have, and the numbers in them; light, `--help` reads it."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from anaplot.errors import InputError
from anaplot.report.commandparser import NewPage, NewTarget
from anaplot.shares.address import LOCAL, cluster_address
from anaplot.textfiles.separated import separated

__all__ = [
    "add_matrix",
    "add_on",
    "add_output",
    "add_report_page",
    "add_target",
    "between",
    "correlation",
    "length",
    "lengths",
    "names",
    "none_or_length",
    "none_or_percentage",
    "percentage",
    "planted",
    "positive",
    "positive_or_none",
    "redundancy_number",
    "significance",
    "sizes",
    "versions",
    "whole",
    "wholes",
    "workplace",
]

_LEAST_ALPHA = 1e-12  # below, nobody's noise is normal any more


def add_output(parser: argparse.ArgumentParser, main: str, *, folder: bool = True) -> None:
    """Add how a command shows its document; without `folder` its --to is another one."""
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    parser.add_argument(
        "--all", action="store_true", help="print tables of more than 100 rows, and lists, whole"
    )
    parser.add_argument(
        "--csv", type=Path, action=NewTarget, metavar="FILE", help=f"write {main} as CSV"
    )
    if folder:
        parser.add_argument(
            "--to",
            dest="tables",
            type=Path,
            action=NewTarget,
            metavar="FOLDER",
            help="write every table as CSV, and summary.json, into a new or empty folder",
        )


def add_target(
    parser: argparse.ArgumentParser,
    metavar: str,
    what: str,
    action: type[NewTarget] = NewTarget,
) -> None:
    """Add where a command writes what is new."""
    parser.add_argument(
        "-o", "--output", type=Path, action=action, required=True, metavar=metavar, help=what
    )


def add_on(parser: argparse.ArgumentParser) -> None:
    """Add where a command computes what consists of many shares."""
    parser.add_argument(
        "--on",
        type=workplace,
        default=LOCAL,
        metavar="WHERE",
        help="local (the default), or dask://HOST:PORT, the scheduler of a dask cluster that you "
        "trust",
    )


def add_report_page(parser: argparse.ArgumentParser) -> None:
    """Add the page that a command writes beside what it prints."""
    parser.add_argument(
        "--report",
        type=Path,
        action=NewPage,
        metavar="FILE.html",
        help="write the result as one page that stands by itself: verdict, figures, tables",
    )
    parser.add_argument(
        "--figures",
        type=Path,
        action=NewTarget,
        metavar="FOLDER",
        help="with --report: write every figure of the page as an SVG file too",
    )
    parser.add_argument(
        "--angles",
        choices=("deg", "gon"),
        help="with --report: unit of angles on the page, default deg",
    )


def add_matrix(parser: argparse.ArgumentParser) -> None:
    """Add the matrix Q_vv P of models."""
    parser.add_argument(
        "--matrix",
        action="store_true",
        help="print Q_vv P whole: what an error in each row changes in every other",
    )


def positive(text: str) -> float:
    """Return a number above 0 and below a million."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is no positive number")
    return value


def positive_or_none(text: str) -> float:
    """Return a number above 0 and below a million, or infinity for "none" or "inf"."""
    return math.inf if text in ("none", "inf") else positive(text)


def between(low: float, high: float) -> Callable[[str], float]:
    """Return what reads a number within limits."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no number from {low:g} to {high:g}")
        return value

    return number


# what is planned is computed in double precision: wide enough for any camera and any object
length = between(1e-3, 1e6)
"""Reads a length."""


def lengths(text: str) -> tuple[float, ...]:
    """Return lengths, separated by commas."""
    return tuple(length(part) for part in text.split(","))


def none_or_length(text: str) -> float:
    """Return 0, or a length that is not too small."""
    try:
        if float(text) == 0.0:
            return 0.0
        return between(1e-9, 1e6)(text)
    except (ValueError, argparse.ArgumentTypeError):
        raise argparse.ArgumentTypeError(f"{text!r} is neither 0 nor from 1e-09 to 1e+06") from None


def names(text: str) -> tuple[str, ...]:
    """Return names, `separated` by commas."""
    try:
        return separated(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def planted(text: str) -> tuple[str, ...]:
    """Return errors "WHERE:AXIS:UM", `separated` by commas."""
    parts = names(text)
    for part in parts:
        where, axis, um = ("", *part.rsplit(":", 2))[-3:]
        try:
            size = float(um)
        except ValueError:
            size = math.nan
        if not where or axis not in ("x", "y") or not abs(size) < 1e6:
            raise argparse.ArgumentTypeError(
                f"{part!r} is not a place, x or y, and um, with colons between them"
            )
    return parts


def versions(text: str) -> tuple[str, ...]:
    """Return versions of the cube of 1978, separated by commas, none twice."""
    found = tuple(part.strip() for part in text.split(","))
    for part in found:
        if part not in ("A", "B", "C", "D", "E") or found.count(part) > 1:
            raise argparse.ArgumentTypeError(f"{text!r} is not versions of the cube, A to E")
    return found


def percentage(text: str) -> float:
    """Return a number above 0 and below 100."""
    value = positive(text)
    if value >= 100.0:
        raise argparse.ArgumentTypeError(f"{text!r} must lie below 100")
    return value


def none_or_percentage(text: str) -> float:
    """Return a number from 0 and below 100."""
    try:
        return 0.0 if float(text) == 0.0 else percentage(text)
    except ValueError:
        return percentage(text)


def correlation(text: str) -> float:
    """Return a number above 0 and at most 1."""
    value = positive(text)
    if value > 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is no correlation: above 0, at most 1")
    return value


def redundancy_number(text: str) -> float:
    """Return a number above 0 and below 1."""
    value = positive(text)
    if value >= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is no redundancy number: above 0, below 1")
    return value


def significance(text: str) -> float:
    """Return a probability that a test can have."""
    value = positive(text)
    if not _LEAST_ALPHA <= value <= 0.5:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no significance: at least {_LEAST_ALPHA:g}, at most 0.5"
        )
    return value


def wholes(text: str) -> tuple[int, ...]:
    """Return whole numbers, separated by commas."""
    return tuple(whole(0, 10_000)(part) for part in text.split(","))


def sizes(text: str) -> tuple[float, ...]:
    """Return positive numbers, separated by commas."""
    return tuple(positive(part) for part in text.split(","))


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return what reads a whole number within limits."""

    def number(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number from {low} to {high}")
        return value

    return number


def workplace(text: str) -> str:
    """Return where to compute, as it was said."""
    try:
        cluster_address(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}") from None
    return text
