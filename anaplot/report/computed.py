"""What a command or a call has computed: objects for programs, and the document of them."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from anaplot.errors import InputError
from anaplot.report.astext import line_text, page_text
from anaplot.report.document import Document, Line, Table, Values
from anaplot.textfiles.wording import hint, quoted

if TYPE_CHECKING:
    import pandas

__all__ = ["Computed"]

Result = TypeVar("Result", covariant=True)

_LONGEST = 100  # characters of what stands in a traceback or an interpreter's echo


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Computed(Generic[Result]):
    """A result and its document.

    Attributes
    ----------
    result
        What was computed: a frozen dataclass, with arrays.
    document
        The same as the command shows it.
    flagged
        What the command's `--fail-on-flag` goes by: something is flagged, rejected, has moved.
    """

    result: Result
    document: Document
    flagged: bool = False

    def __repr__(self) -> str:
        lines = (line for line in self.document.page[:2] if isinstance(line, Line))
        head = "; ".join(" ".join(line_text(line).split()) for line in lines)
        text = f"<{type(self.result).__name__}: {head}{', flagged' if self.flagged else ''}>"
        return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]}...>"

    def __str__(self) -> str:
        return self.text()

    def text(self, *, everything: bool = False) -> str:
        """Return what the command prints, with `everything` what it prints with `--all`."""
        return page_text(self.document.page, everything=everything)

    def to_dict(self) -> dict[str, Any]:
        """Return what `--json` prints, as dictionaries and lists; what does not exist is None."""
        found: dict[str, Any] = self.document.to_dict()
        return found

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables, the main one first: those that `--to FOLDER` writes."""
        return tuple(table.key for table in self.document.tables)

    def to_columns(self, table: str | None = None) -> dict[str, NDArray[Any]]:
        """Return a table as arrays, one a column.

        Parameters
        ----------
        table
            One of `tables`; None: the main one.

        Returns
        -------
        dict of str to array
            (n,) by the keys of `--json`, the components of a vector apart ("effect_X"); numbers in
            the units of `--json`, NaN where there is none.

        Raises
        ------
        InputError
            There is no such table.
        """
        return {key: _array(values) for key, values in self._table(table).components()}

    def to_frame(self, table: str | None = None) -> pandas.DataFrame:
        """Return a table as a frame of pandas.

        Parameters, columns, units and errors as `to_columns` has them.

        Raises
        ------
        InputError
            pandas is not installed; anaplot does not need it otherwise.
        """
        columns = self.to_columns(table)
        try:
            frames = importlib.import_module("pandas")
        except ImportError as error:
            raise InputError(
                "to_frame() needs pandas, which is not installed; to_columns() does not"
            ) from error
        return frames.DataFrame(columns)

    def _table(self, key: str | None) -> Table:
        tables = {table.key: table for table in self.document.tables}
        if key is None:
            return self.document.tables[0]
        if key not in tables:
            raise InputError(f"no table {quoted(key)}{hint(key, tables)}")
        return tables[key]


def _array(values: Values) -> NDArray[Any]:
    """Return a column as an array: of numbers, truth values, names, or objects where mixed."""
    if isinstance(values, np.ndarray):
        return values
    kinds = {type(value) for value in values if value is not None}
    if kinds and kinds <= {int, float}:
        return np.array([np.nan if value is None else value for value in values])
    if len(kinds) == 1 and kinds <= {str, bool} and None not in values:
        return np.array(values)
    objects = np.empty(len(values), dtype=object)
    objects[:] = values
    return objects
