"""The matrix Q_vv P of a model, whole (1983, Figures 3 and 5)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from anaplot.adjustment.tested import Tested
from anaplot.orientation.results import Row
from anaplot.report.document import BLANK, Block, Document, Line, for_programs, say, table

__all__ = ["MATRIX", "matrix_document"]

MATRIX = for_programs("point", "axis", "error_point", "error_axis", "value")
"""Columns: the residual of `point` `axis` for a unit error in `error_point` `error_axis`."""

_PER_BLOCK = 8
_NAME = 8


def matrix_document(tested: Tested[Row]) -> Document:
    """Return the document of a model's Q_vv P, redundancy numbers on its diagonal.

    Column j is what a unit error in row j does to every residual.
    """
    keys, matrix = tested.keys, tested.influence.tolist()
    values = table(
        "matrix",
        MATRIX,
        (
            (*row, *error, value)
            for row, line in zip(keys, matrix, strict=True)
            for error, value in zip(keys, line, strict=True)
        ),
    )
    answer = {"rows": [list(key) for key in keys], "values": matrix}
    head = say("  Q_vv P: down each column, what a unit error in its row changes")
    page: list[Block] = [head.of("heading"), *_lines(keys, matrix)]
    return Document(answer, tuple(page), (values,))


def _lines(keys: Sequence[Row], matrix: list[list[float]]) -> Iterator[Line]:
    names = [f"{point} {axis}" for point, axis in keys]
    widest = max(_NAME, *(len(one) for one in names))
    for start in range(0, len(keys), _PER_BLOCK):
        part = slice(start, start + _PER_BLOCK)
        if start:
            yield BLANK
        yield _line("", names[part], widest)
        for one, line in zip(names, matrix, strict=True):
            yield _line(one, [f"{round(value, 3) + 0.0:.3f}" for value in line[part]], widest)


def _line(first: str, cells: list[str], width: int) -> Line:
    out = say("  {:<{width}}", first, width=width)
    for cell in cells:
        out += say(" {:>{width}}", cell, width=_NAME)
    return out
