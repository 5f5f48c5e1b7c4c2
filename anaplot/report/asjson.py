"""A document as JSON, laid out like `json.dumps(indent=1)`, tables column by column.

Many rows of a column are written at once, which is ten times as quick as a number at a time; the
text of a large table is never there as a whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from json.encoder import encode_basestring_ascii
from math import inf, isinf
from types import NoneType
from typing import TYPE_CHECKING, Any

from anaplot.report.document import Answer, Column, Table, Values, is_array

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["json_parts", "json_text"]

_INFINITE = "infinity does not stand in JSON"
_FINITE = {str, int, bool, NoneType}
_OTHERS = {"nan", "inf", "-inf", "None"}  # what stands for a number that is none
_ROWS = 4096  # of a table that are written at once


def json_text(answer: Answer) -> str:
    """Return an answer as JSON; NaN becomes null.

    Raises
    ------
    ValueError
        A number is infinite.
    """
    return "".join(json_parts(answer))


def json_parts(answer: Answer) -> Iterator[str]:
    """Yield an answer as JSON, part by part.

    Raises
    ------
    ValueError
        A number is infinite; nothing is yielded then.
    """
    _refuse_infinity(answer)
    yield from _parts(answer, 0)


def _refuse_infinity(value: Any) -> None:
    if isinstance(value, float):
        if isinf(value):
            raise ValueError(_INFINITE)
    elif isinstance(value, Table):
        for _, values in value.for_programs():
            _refuse_infinity(values)
    elif isinstance(value, Mapping):
        for inner in value.values():
            _refuse_infinity(inner)
    elif is_array(value):
        if value.dtype.kind != "f":
            _refuse_infinity(value.tolist())
        elif inf in abs(value):
            raise ValueError(_INFINITE)
    elif not isinstance(value, str | int | NoneType):
        kinds = set(map(type, value))
        if kinds <= {float, NoneType}:
            if inf in value or -inf in value:
                raise ValueError(_INFINITE)
        elif not kinds <= _FINITE:
            for inner in value:
                _refuse_infinity(inner)


def _parts(value: Any, level: int) -> Iterator[str]:
    """Yield a value; the entries of a mapping and the rows of a table by themselves."""
    if isinstance(value, Table):
        yield from _table_parts(value, level)
    elif isinstance(value, Mapping) and value:
        before = "{"
        for key, inner in value.items():
            yield f"{before}\n{' ' * (level + 1)}{encode_basestring_ascii(key)}: "
            yield from _parts(inner, level + 1)
            before = ","
        yield "\n" + " " * level + "}"
    else:
        yield _value(value, level)


def _value(value: Any, level: int) -> str:
    if isinstance(value, str):
        return encode_basestring_ascii(value)
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return int.__repr__(value)
    if isinstance(value, float):
        return _float(value)
    if isinstance(value, Table):
        return "".join(_table_parts(value, level))
    if isinstance(value, Mapping):
        cells = [f"{encode_basestring_ascii(k)}: {_value(v, level + 1)}" for k, v in value.items()]
        return _laid_out("{", cells, "}", level)
    return _laid_out("[", _items(value, level + 1), "]", level)


def _float(value: float) -> str:
    if value != value:
        return "null"
    if isinf(value):
        raise ValueError(_INFINITE)
    return float.__repr__(value)


def _laid_out(left: str, cells: list[str], right: str, level: int) -> str:
    if not cells:
        return left + right
    pad = "\n" + " " * (level + 1)
    return left + pad + ("," + pad).join(cells) + "\n" + " " * level + right


def _table_parts(table: Table, level: int) -> Iterator[str]:
    n = len(table)
    if not n:
        yield "[]"
        return
    columns = table.for_programs()
    keys = (encode_basestring_ascii(column.key).replace("%", "%%") for column, _ in columns)
    row = _laid_out("{", [f"{key}: %s" for key in keys], "}", level + 1)
    pad = "\n" + " " * (level + 1)
    before = "["
    for first in range(0, n, _ROWS):
        some = slice(first, first + _ROWS)
        cells = zip(*(_cells(of, values[some], level + 2) for of, values in columns), strict=True)
        yield before + pad + ("," + pad).join(map(row.__mod__, cells))
        before = ","
    yield "\n" + " " * level + "]"


def _cells(column: Column, values: Values, level: int) -> list[str]:
    """Return the cells of a column."""
    if column.parts and is_array(values):
        return _vectors(values, level)
    return _items(values, level)


def _items(values: Values, level: int) -> list[str]:
    """Return values one by one, or all at once where they are of one kind."""
    if is_array(values):
        values = values.tolist()
    kinds = set(map(type, values))
    if kinds == {str}:
        return list(map(encode_basestring_ascii, values))
    if kinds == {int}:
        return list(map(repr, values))
    if kinds <= {float, NoneType}:
        return _numbers(values)
    if kinds == {str, NoneType}:
        return ["null" if v is None else encode_basestring_ascii(v) for v in values]
    if kinds == {bool}:
        return ["true" if v else "false" for v in values]
    return [_value(value, level) for value in values]


def _numbers(values: Iterable[float | None]) -> list[str]:
    """Return numbers, null for NaN and None."""
    cells = list(map(repr, values))
    if _OTHERS.isdisjoint(cells):
        return cells
    if "inf" in cells or "-inf" in cells:
        raise ValueError(_INFINITE)
    return ["null" if cell in _OTHERS else cell for cell in cells]


def _vectors(values: NDArray[Any], level: int) -> list[str]:
    """Return vectors, null for those that do not exist."""
    size = values.shape[1]
    row = _laid_out("[", ["%s"] * size, "]", level)
    numbers = _numbers(values.ravel().tolist())
    cells = list(map(row.__mod__, zip(*[iter(numbers)] * size, strict=True)))
    nothing = row % (("null",) * size)
    return ["null" if cell == nothing else cell for cell in cells]
