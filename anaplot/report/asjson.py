"""A document as JSON, laid out like `json.dumps(indent=1)`, tables column by column.

Whole columns are written at once, which is ten times as quick as a number at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from json.encoder import encode_basestring_ascii
from typing import Any

import numpy as np

from anaplot.report.document import Answer, Table, Values

__all__ = ["json_text"]


def json_text(answer: Answer) -> str:
    """Return an answer as JSON; NaN becomes null.

    Raises
    ------
    ValueError
        A number is infinite.
    """
    return _value(answer, 0)


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
        return _table(value, level)
    if isinstance(value, Mapping):
        cells = [f"{encode_basestring_ascii(k)}: {_value(v, level + 1)}" for k, v in value.items()]
        return _laid_out("{", cells, "}", level)
    if isinstance(value, np.ndarray):
        return _laid_out("[", _column(value, level + 1), "]", level)
    return _laid_out("[", [_value(inner, level + 1) for inner in value], "]", level)


def _float(value: float) -> str:
    if value != value:
        return "null"
    if value in (np.inf, -np.inf):
        raise ValueError("infinity does not stand in JSON")
    return float.__repr__(value)


def _laid_out(left: str, cells: list[str], right: str, level: int) -> str:
    if not cells:
        return left + right
    pad = "\n" + " " * (level + 1)
    return left + pad + ("," + pad).join(cells) + "\n" + " " * level + right


def _table(table: Table, level: int) -> str:
    if not len(table):
        return "[]"
    columns = table.for_programs()
    keys = (encode_basestring_ascii(column.key).replace("%", "%%") for column, _ in columns)
    cells = [f"{key}: %s" for key in keys]
    row = _laid_out("{", cells, "}", level + 1)
    texts = [_column(values, level + 2) for _, values in columns]
    pad = "\n" + " " * (level + 1)
    whole = ("," + pad).join([row] * len(table)) % tuple(
        chain.from_iterable(zip(*texts, strict=True))
    )
    return "[" + pad + whole + "\n" + " " * level + "]"


def _column(values: Values, level: int) -> list[str]:
    """Return the cells of a column as JSON."""
    if not isinstance(values, np.ndarray):
        return [_value(value, level) for value in values]
    if values.ndim > 1 or values.dtype.kind not in "fiub":
        return [_value(value, level) for value in values.tolist()]
    plain = values.tolist()
    if values.dtype.kind == "b":
        return ["true" if value else "false" for value in plain]
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        return [_float(value) for value in plain]
    return list(map(repr, plain))
