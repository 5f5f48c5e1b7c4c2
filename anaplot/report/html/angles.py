"""Angles of a report in degrees or gon, as the reader wants them; inside they are radians."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Literal, TypeAlias

from anaplot.report.document import OF_PI, Column, Table
from anaplot.report.html.parts import Captioned, HtmlBlock, Report, with_blocks

__all__ = ["AngleUnit", "with_angles_in"]

AngleUnit: TypeAlias = Literal["deg", "gon"]


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
    if column.unit != "rad" or column.shown_unit != "deg":
        return column
    title = column.title.replace("[deg]", "[gon]")
    return replace(column, scale=OF_PI["gon"] / pi, title=title)
