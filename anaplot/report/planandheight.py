"""Control and check points in plan and height, with their tests: one row each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from anaplot.bundle.hypotheses.blockhypotheses import BlockHypotheses
from anaplot.bundle.hypotheses.givenparts import PartTest
from anaplot.report.document import Column, Table, name, number, table
from anaplot.report.verdicts import probability

__all__ = ["plan_and_height_table"]

_PARTS = ("plan", "height")


def _mark(rejected: bool) -> str:
    return "<< REJECTED" if rejected else "passed"


_COLUMNS = (
    name("point", "POINT", 5),
    name("use", "USE", 7),
    *(
        column
        for part in _PARTS
        for column in (
            number(part, f"{part} [m]", 4, 11, unit="m"),
            number(f"s_{part}", "s", 4, 9, unit="m"),
            Column(f"P_{part}", "P", 9, form=probability),
            name(f"{part}_rejected", form=_mark, none="not tested", look=bool),
        )
    ),
)


def plan_and_height_table(found: BlockHypotheses) -> Table:
    """Return what the photographs make of given points, minus what is given, and the tests.

    Of a plan the length, of a height the difference [m]; s for the a-priori sigma0, of both.
    """
    return table("plan_and_height", _COLUMNS, _rows(found))


def _rows(found: BlockHypotheses) -> Iterator[tuple[Any, ...]]:
    control, check = found.control, found.check
    if control is not None:
        use = "control" if control.against == "photographs" else "given"
        yield from _of(use, control.parts)
    if check is not None:
        yield from _of("check", check.parts)


def _of(use: str, parts: Iterable[PartTest]) -> Iterator[tuple[Any, ...]]:
    by_point: dict[str, dict[str, PartTest]] = {}
    for one in parts:
        by_point.setdefault(one.point, {})[one.part] = one
    for point, found in by_point.items():
        yield point, use, *(cell for part in _PARTS for cell in _cells(found.get(part)))


def _cells(one: PartTest | None) -> tuple[Any, ...]:
    """Return difference, s, P and whether it is rejected; None where there is no test."""
    if one is None:
        return None, None, None, None
    test = None if one.verdict is None else one.verdict.decisive
    p = None if test is None else test.significance
    return one.difference, one.s, p, None if test is None else test.rejected
