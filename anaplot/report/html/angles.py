"""Angles of a report in degrees or gon, as the reader wants them; inside they are radians."""

from __future__ import annotations

from dataclasses import replace
from math import isclose, pi
from typing import Literal, TypeAlias

from anaplot.report.document import Column, Table
from anaplot.report.html.parts import Captioned, HtmlBlock, Report, with_blocks

__all__ = ["AngleUnit", "shown_unit", "with_angles_in"]

AngleUnit: TypeAlias = Literal["deg", "gon"]

_OF_PI = {"deg": 180.0, "gon": 200.0}


def shown_unit(column: Column) -> str:
    """Return the unit of what a person reads in a column, "" where it is not known."""
    if column.scale == 1.0:
        return column.unit
    if column.unit == "rad":
        return next((unit for unit, half in _OF_PI.items() if isclose(column.scale, half / pi)), "")
    return "um" if (column.unit, column.scale) == ("mm", 1e3) else ""


def with_angles_in(report: Report, unit: AngleUnit) -> Report:
    """Return a report whose tables have their angles in a unit."""
    if unit == "deg":
        return report
    return replace(report, sections=with_blocks(report.sections, _block))


def _block(block: HtmlBlock) -> HtmlBlock:
    if isinstance(block, Captioned):
        return replace(block, table=_table(block.table))
    return _table(block) if isinstance(block, Table) else block


def _table(table: Table) -> Table:
    columns = tuple(map(_column, table.columns))
    if columns == table.columns:
        return table
    return replace(table, columns=columns, source=lambda: table.values)


def _column(column: Column) -> Column:
    if column.unit != "rad" or shown_unit(column) != "deg":
        return column
    title = column.title.replace("[deg]", "[gon]")
    return replace(column, scale=_OF_PI["gon"] / pi, title=title)
