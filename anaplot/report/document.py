"""What a command has found: one document, which renderers show as text, JSON or CSV.

A document holds numbers and names, never their texts: a renderer writes them for its medium and
makes foreign names safe for it. It has two views of the same findings, `answer` for programs and
`page` for people; both may hold the same tables. docs/documents.md shows how a command builds one.
"""

from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import compress
from math import isclose, pi
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeGuard, TypeVar, overload

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "BLANK",
    "OF_PI",
    "Answer",
    "Block",
    "Column",
    "Document",
    "Figure",
    "Later",
    "Line",
    "Listed",
    "Names",
    "Table",
    "Value",
    "Values",
    "for_programs",
    "is_array",
    "name",
    "named",
    "number",
    "plain_values",
    "say",
    "stacked",
    "table",
    "vectors",
    "whole",
]

Answer: TypeAlias = dict[str, Any]
"""What programs read: numbers, names, None, lists, further answers, tables; keys in order."""

Values: TypeAlias = "Sequence[Any] | NDArray[Any]"
Kind: TypeAlias = Literal["text", "heading", "remark", "look"]

T = TypeVar("T")

OF_PI = {"deg": 180.0, "gon": 200.0}
"""Units in which people read angles, and how many of each are half a turn."""

_THOUSANDTHS = {"mm": "um", "kpx": "px"}


@dataclass(frozen=True, slots=True)
class Value:
    """A number or a name within a line.

    Attributes
    ----------
    value
        None where it does not exist.
    form
        How it is written, as in `format`; ".40" of a name leaves out its middle where it has more
        than 40 characters; "9.3c" is a cell of a table: 9 characters, a blank before the number or
        name, at most 3 decimals.
    unit
        Stands behind it.
    none
        Stands for None.
    """

    value: float | str | None
    form: str = ""
    unit: str = ""
    none: str = "-"


@dataclass(frozen=True, slots=True)
class Names:
    """A list within a line.

    Attributes
    ----------
    items
        What is listed.
    most
        How many are shown, unless all is asked for; None: every one.
    more
        What is said of the others, with their number in place of {}.
    separator
        Between two of them.
    """

    items: tuple[Line, ...]
    most: int | None = None
    more: str = " and {} more"
    separator: str = ", "


@dataclass(frozen=True, slots=True)
class Line:
    """A sentence of a page, made by `say`.

    Attributes
    ----------
    parts
        Literal text, and what is written into it.
    kind
        What it is: "heading" of what follows, "remark", or what needs a "look".
    indent
        Blanks before its further lines where it is folded to the width of a page: between two items
        of the list in it, or without one between two words. None: it is never folded.
    """

    parts: tuple[str | Value | Names, ...]
    kind: Kind = "text"
    indent: int | None = None

    def __add__(self, other: Line | str) -> Line:
        added = (other,) if isinstance(other, str) else other.parts
        return replace(self, parts=self.parts + added)

    def of(self, kind: Kind) -> Line:
        """Return this line as one of another kind."""
        return replace(self, kind=kind)

    def folded(self, indent: int = 0) -> Line:
        """Return this line as one that goes on in further lines."""
        return replace(self, indent=indent)


BLANK = Line(())
"""An empty line of a page."""


class Later(Sequence[T]):
    """Values that are made where they are read: of many, few are shown.

    Parameters
    ----------
    count
        How many there are.
    make
        Returns those of some places.

    Attributes
    ----------
    of
        The same.
    """

    def __init__(self, count: int, make: Callable[[Sequence[int]], Sequence[T]]) -> None:
        self._count, self.of = count, make

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, at: int) -> T: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[T]: ...
    def __getitem__(self, at: int | slice) -> T | Sequence[T]:
        found = range(self._count)[at]
        return self.of([found])[0] if isinstance(found, int) else self.of(found)

    def __iter__(self) -> Iterator[T]:
        return iter(self.of(range(self._count)))


@dataclass(frozen=True, slots=True)
class Listed:
    """Lines of one kind, of which the first are shown unless all are asked for.

    Attributes
    ----------
    lines
        One each.
    most
        How many are shown.
    more
        What is said of the others, with their number in place of {}; empty: nothing.
    """

    lines: Sequence[Line]
    most: int
    more: str = "    and {} more"


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    key
        For programs, in JSON and CSV; empty: for people only.
    title
        For people.
    width
        Characters of a cell: of numbers with the blank before it; of names the least, without the
        blanks before them. None: for programs only.
    decimals
        Of a number, or of the length of a vector; a large one has fewer.
    form
        Writes a value, where `decimals` do not.
    unit
        Of the values.
    scale
        What a person reads is a value times this.
    align
        Names stand at the left of their cells, numbers at the right.
    gap
        Blanks before a name.
    none
        Stands for what does not exist.
    head
        The heading where it does not stand above its cells as others do.
    parts
        Names of the components where every value is a vector.
    look
        Says of a value whether its row needs a look: such rows are shown also where a table is too
        long to be shown.
    """

    key: str
    title: str = ""
    width: int | None = None
    decimals: int | None = None
    form: Callable[[Any], str] | None = None
    unit: str = ""
    scale: float = 1.0
    align: Literal["<", ">"] = ">"
    gap: int = 2
    none: str = "-"
    head: str | None = None
    parts: tuple[str, ...] = ()
    look: Callable[[Any], bool] | None = None

    @property
    def shown_unit(self) -> str:
        """Unit of what a person reads, "" where it is not known."""
        if self.scale == 1.0:
            return self.unit
        if self.unit == "rad":
            return next((one for one, half in OF_PI.items() if isclose(self.scale, half / pi)), "")
        return _THOUSANDTHS.get(self.unit, "") if self.scale == 1e3 else ""


def name(
    key: str,
    title: str = "",
    least: int = 0,
    *,
    gap: int = 2,
    form: Callable[[Any], str] | None = None,
    none: str = "-",
    head: str | None = None,
    look: Callable[[Any], bool] | None = None,
) -> Column:
    """Return a column of names or words, as wide as the longest, at the left."""
    return Column(key, title, least, form=form, align="<", gap=gap, none=none, head=head, look=look)


def number(
    key: str, title: str, decimals: int, width: int, *, unit: str = "", scale: float = 1.0
) -> Column:
    """Return a column of numbers with decimals, at the right of cells of a width."""
    return Column(key, title, width, decimals, unit=unit, scale=scale)


def whole(key: str, title: str, width: int) -> Column:
    """Return a column of whole numbers, at the right of cells of a width."""
    return Column(key, title, width)


def for_programs(*keys: str, unit: str = "", parts: tuple[str, ...] = ()) -> tuple[Column, ...]:
    """Return columns that only JSON and CSV have."""
    return tuple(Column(key, unit=unit, parts=parts) for key in keys)


@dataclass(frozen=True, eq=False)
class Table:
    """A table: declared columns and their values, column by column.

    Attributes
    ----------
    key
        Its name, and that of its CSV file.
    columns
        In the order of JSON and CSV.
    source
        Of each column n values: an array (n,) or (n, k), or a sequence. NaN, None, and a vector of
        nothing but NaN: it does not exist. Or a function that returns them: it is called where they
        are shown, once.
    shown
        Keys (or titles, of columns for people only) of what a person reads, in this order; None:
        every column that has a width.
    units
        How units stand in a line of their own under the titles: ">" at their right, "^" in their
        middle; empty: not at all.
    most
        How many rows a person reads, unless all are asked for, where it is not for their columns
        to say: the first are the most important.
    more
        What is said of the others then, with their number in place of {}; empty: nothing.
    group
        Key of the column whose value stands in a line of its own above the rows that have it.
    """

    key: str
    columns: tuple[Column, ...]
    source: tuple[Values, ...] | Callable[[], tuple[Values, ...]]
    shown: tuple[str, ...] | None = None
    units: Literal["", ">", "^"] = ""
    most: int | None = None
    more: str = "    and {} more"
    group: str = ""

    def __post_init__(self) -> None:
        if not callable(self.source):
            _ = self.values

    @cached_property
    def values(self) -> tuple[Values, ...]:
        """The values of each column."""
        values = self.source() if callable(self.source) else self.source
        lengths = {len(each) for each in values}
        if len(values) != len(self.columns) or len(lengths) > 1:
            raise ValueError(f"table {self.key}: {len(self.columns)} columns, values {lengths}")
        return values

    def __len__(self) -> int:
        return len(self.values[0]) if self.values else 0

    def for_people(self) -> list[tuple[Column, Values]]:
        """Return the columns that a person reads, in his order."""
        pairs = list(zip(self.columns, self.values, strict=True))
        if self.shown is None:
            return [pair for pair in pairs if pair[0].width is not None]
        by_name = {pair[0].key or pair[0].title: pair for pair in pairs}
        return [by_name[key] for key in self.shown]

    def marked(self) -> list[int]:
        """Return which rows need a look, in their order."""
        marked: set[int] = set()
        for column, values in zip(self.columns, self.values, strict=True):
            if column.look is not None:
                marked.update(compress(range(len(self)), map(column.look, values)))
        return sorted(marked)

    def for_programs(self) -> list[tuple[Column, Values]]:
        """Return the columns of JSON and CSV."""
        pairs = zip(self.columns, self.values, strict=True)
        return [pair for pair in pairs if pair[0].key]

    def components(self) -> Iterator[tuple[str, Values]]:
        """Yield the columns of JSON and CSV with their keys, the components of vectors apart."""
        for column, values in self.for_programs():
            if not column.parts:
                yield column.key, values
            for k, part in enumerate(column.parts):
                yield f"{column.key}_{part}", _component(values, k)

    def records(self) -> list[Answer]:
        """Return the rows for programs, one mapping each."""
        columns = self.for_programs()
        keys = [column.key for column, _ in columns]
        cells = zip(*(_plain_cells(*pair) for pair in columns), strict=True)
        return [dict(zip(keys, row, strict=True)) for row in cells]


def table(
    key: str,
    columns: Iterable[Column],
    rows: Iterable[Sequence[Any]] | Callable[[], Iterable[Sequence[Any]]],
    *,
    shown: tuple[str, ...] | None = None,
    units: Literal["", ">", "^"] = "",
    most: int | None = None,
    more: str = "    and {} more",
    group: str = "",
) -> Table:
    """Return a table of rows, or of what makes them: each has a value for every column."""
    declared = tuple(columns)

    def transposed(rows: Iterable[Sequence[Any]]) -> tuple[Values, ...]:
        return tuple(zip(*rows, strict=True)) or ((),) * len(declared)

    values = (lambda: transposed(rows())) if callable(rows) else transposed(rows)
    return Table(key, declared, values, shown, units, most, more, group)


def stacked(
    key: str,
    leading: Iterable[Column],
    columns: Iterable[Column],
    parts: Iterable[tuple[Sequence[Any], Table]],
) -> Table:
    """Return one table of several that have the same columns, as one file holds them.

    Parameters
    ----------
    key
        Its name.
    leading
        Columns before theirs: what a table belongs to.
    columns
        Theirs.
    parts
        Of each table the values of the leading columns, and the table.
    """
    several = tuple(parts)

    def rows() -> Iterator[tuple[Any, ...]]:
        for of, one in several:
            yield from ((*of, *cells) for cells in zip(*one.values, strict=True))

    return table(key, (*leading, *columns), rows)


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A drawing.

    Attributes
    ----------
    key
        What is drawn; a renderer that draws better than with characters goes by it.
    data
        What it needs.
    lines
        Draws it with characters, from the data.
    """

    key: str
    data: Any
    lines: Callable[[Any], Sequence[str]]


Block: TypeAlias = Line | Listed | Table | Figure
"""A part of a page."""


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """What a command has found.

    Attributes
    ----------
    answer
        For programs: what `--json` prints; of a part of a document also a list, or None.
    page
        For people: what is printed without `--json`, from top to bottom.
    tables
        What can be written as CSV, the main one first.
    """

    answer: Any
    page: tuple[Block, ...]
    tables: tuple[Table, ...] = ()

    def to_dict(self) -> Any:
        """Return the answer with its tables as lists of rows; NaN becomes None."""
        return plain_value(self.answer)


class _Template(string.Formatter):
    """Parses what `say` is given."""

    def parts(
        self, template: str, values: Sequence[Any], named: Mapping[str, Any]
    ) -> Iterable[Any]:
        unnamed = iter(values)
        for literal, field, spec in _fields(template):
            if literal:
                yield literal
            if field is None:
                continue
            if spec and "{" in spec:
                spec = spec.format(**named)
            if field:
                value, _ = self.get_field(field, values, named)
            else:
                value = next(unnamed)
            if isinstance(value, Line):
                yield from value.parts
            elif isinstance(value, Names):
                yield value
            else:
                form, _, rest = (spec or "").partition("|")
                unit, _, none = rest.partition("|")
                yield Value(value, form, unit, none or "-")


_TEMPLATE = _Template()


@lru_cache(512)
def _fields(template: str) -> tuple[tuple[str, str | None, str | None], ...]:
    """Return what a template is made of: it is said of thousands of rows."""
    return tuple((literal, field, spec) for literal, field, spec, _ in _TEMPLATE.parse(template))


def say(template: str, *values: Any, **named: Any) -> Line:
    """Return a line with values written into it.

    Parameters
    ----------
    template
        As for `str.format`; a field's format may go on with a unit and with what stands for None:
        "sigma0 {sigma0_um:.2f|um|none}". Fields of a mapping are given as {0[key]}.
    values, named
        Numbers, names, None; or lines and lists, which become a part of this one.
    """
    return Line(tuple(_TEMPLATE.parts(template, values, named)))


def named(
    items: Iterable[str | Line],
    most: int | None = None,
    more: str = " and {} more",
    *,
    separator: str = ", ",
) -> Names:
    """Return a list of names or lines that stands within a line."""
    lines = (item if isinstance(item, Line) else Line((Value(item),)) for item in items)
    return Names(tuple(lines), most, more, separator)


def is_array(values: object) -> TypeGuard[NDArray[Any]]:
    """Return whether values are an array of NumPy, which is not loaded for the question.

    Where one is, NumPy is loaded: what needs it then imports it for itself.
    """
    return hasattr(values, "__array__") and hasattr(values, "__len__")


def _component(values: Values, k: int) -> Values:
    if is_array(values):
        component: NDArray[Any] = values[:, k]
        return component
    return [None if v is None else v[k] for v in values]


def vectors(values: NDArray[Any]) -> list[list[float] | None]:
    """Return the vectors of a column (n, k); None for what does not exist."""
    import numpy as np

    there = ~np.isnan(values).all(axis=1)
    return [v if some else None for v, some in zip(values.tolist(), there.tolist(), strict=True)]


def _plain_cells(column: Column, values: Values) -> list[Any]:
    if column.parts and is_array(values):
        return [plain_value(vector) for vector in vectors(values)]
    return plain_values(values)


def plain_values(values: Values) -> list[Any]:
    """Return a column's values as JSON has them."""
    if is_array(values):
        import numpy as np

        if values.dtype.kind == "f" and not np.isfinite(values).all():
            return [plain_value(value) for value in values.tolist()]
        plain: list[Any] = values.tolist()
        return plain
    return [plain_value(value) for value in values]


def plain_value(value: Any) -> Any:
    """Return a value as JSON has it: tables as lists of rows, None for NaN."""
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, float):
        return None if value != value else value
    if isinstance(value, Table):
        return value.records()
    if isinstance(value, Mapping):
        return {key: plain_value(inner) for key, inner in value.items()}
    if is_array(value):
        return plain_values(value)
    return [plain_value(inner) for inner in value]
