"""Results as Parquet: the tables of `csv`, with the types and units of their columns."""

from __future__ import annotations

import io
from importlib import import_module
from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.exchange.formats.door import Exported, Exporting, ResultColumn, ResultTable
from anaplot.exchange.formats.resulttables import result_tables
from anaplot.textfiles.wholefile import create_folder

__all__ = ["write"]

_NAMES = ("photo", "point", "model", "axis", "use")  # what may be empty as a whole


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a folder of tables; what does not exist is null.

    Raises
    ------
    InputError
        pyarrow is missing.
    """
    arrow, parquet = _pyarrow()
    tables, notes = result_tables(exporting)

    def data(table: ResultTable) -> bytes:
        fields = [_field(arrow, column) for column in table.columns]
        arrays = [
            arrow.array(list(column.values), type=field.type)
            for column, field in zip(table.columns, fields, strict=True)
        ]
        held = io.BytesIO()
        parquet.write_table(arrow.Table.from_arrays(arrays, schema=arrow.schema(fields)), held)
        return held.getvalue()

    files = ((f"{table.name}.parquet", data(table)) for table in tables)
    return Exported(create_folder(target, files), notes)


def _field(arrow: Any, column: ResultColumn) -> Any:
    """Return a column's name, type and unit; the same type also where no value is."""
    known = next((value for value in column.values if value is not None), None)
    kind = arrow.string() if column.name in _NAMES or "_at" in column.name else arrow.float64()
    if isinstance(known, bool):
        kind = arrow.bool_()
    elif isinstance(known, int) and not any(isinstance(v, float) for v in column.values):
        kind = arrow.int64()
    elif isinstance(known, str):
        kind = arrow.string()
    elif isinstance(known, list | tuple):
        kind = arrow.list_(arrow.string())
    return arrow.field(column.name, kind, metadata={"unit": column.unit} if column.unit else None)


def _pyarrow() -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise InputError("Parquet needs pyarrow: pip install 'anaplot[parquet]'") from None
