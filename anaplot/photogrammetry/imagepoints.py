"""Measured image points: a row each for people and scripts, columns for what handles them all."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from itertools import repeat
from operator import attrgetter
from typing import Any, Generic, Literal, TypeVar, cast, overload

import numpy as np
from numpy.typing import NDArray

from anaplot.aliases import Array, Bools, Index

__all__ = [
    "Coded",
    "ImagePoint",
    "ImagePoints",
    "PointColumns",
    "Use",
    "columns_of",
    "image_points",
    "paired",
    "read_columns",
    "samples",
    "sigma_column",
    "stand_again",
    "stated_sigmas",
    "use_counts",
]

T = TypeVar("T")
S = TypeVar("S")

Use = Literal["xy", "x", "y", "off"]
"""Which coordinates of an image point count."""


def use_counts(use: Use, axis: str) -> bool:
    """Return whether a coordinate, "x" or "y", counts under a use."""
    return use != "off" and axis in use


@dataclass(frozen=True, slots=True)
class ImagePoint:
    """One measured image point.

    Attributes
    ----------
    photo, point
        Names.
    x, y
        Image coordinates [mm], ideal ones: where the camera has a lens, it is taken off.
    sigma_um
        A-priori standard deviation [um] of either coordinate, or None for the block's default.
    model
        "left/right" of the model that lay in the instrument, or None.
    use
        Which of its coordinates count: "xy", "x", "y" or "off".
    reason
        Why, in the words of the person who decided; or None.
    measured
        What stands in the file instead of x, y, where pixels or a lens are between: it is written
        again as it was read, and nothing is computed from it.
    """

    photo: str
    point: str
    x: float
    y: float
    sigma_um: float | None = None
    model: str | None = None
    use: Use = "xy"
    reason: str | None = None
    measured: tuple[float, float] | None = field(default=None, compare=False)

    def counts(self, axis: str) -> bool:
        """Return whether a coordinate, "x" or "y", counts."""
        return use_counts(self.use, axis)

    def use_without(self, axes: Collection[str]) -> Use:
        """Return which of its coordinates count when those of some axes do not."""
        left = "".join(axis for axis in "xy" if self.counts(axis) and axis not in axes)
        return cast("Use", left or "off")


_NAMES = tuple(each.name for each in fields(ImagePoint))
_PUT = tuple(ImagePoint.__dict__[name].__set__ for name in _NAMES)
_LARGEST = 2**62  # of a key of several columns
_NO_SIGMA = -1.0  # um: what is given and is not a number either, beside None, which is NaN


def image_points(*columns: Sequence[Any]) -> tuple[ImagePoint, ...]:
    """Return image points of whole columns, one for each attribute of `ImagePoint`, in order.

    Column by column, as making each by itself takes more than twice the time.
    """
    if len({len(column) for column in columns}) != 1:
        raise ValueError("columns of different lengths")
    rows = tuple(map(object.__new__, repeat(ImagePoint, len(columns[0]))))
    for put, column in zip(_PUT, columns, strict=True):
        deque(map(put, rows, column), maxlen=0)
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class Coded(Generic[T]):
    """A column of which the values come again: each of them once, and which one every row has.

    Attributes
    ----------
    values
        The values.
    index
        (n,) where in `values` that of each row stands; it cannot be written into.
    """

    values: tuple[T, ...]
    index: Index

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", _fixed(self.index))

    def __reduce__(self) -> tuple[Any, ...]:
        return Coded, (self.values, self.index)  # a copy is fixed again

    @classmethod
    def of(cls, column: Sequence[T]) -> Coded[T]:
        """Return a column with its values in the order in which they first stand there."""
        known = {value: k for k, value in enumerate(dict.fromkeys(column))}
        return cls(tuple(known), np.fromiter(map(known.__getitem__, column), np.intp, len(column)))

    @classmethod
    def read(cls, column: tuple[tuple[T, ...], Iterable[int]]) -> Coded[T]:
        """Return a column of its values and, by rows, which of them stand there."""
        values, index = column
        return cls(values, np.array(index, dtype=np.intp))

    @classmethod
    def numbered(cls, column: Index) -> Coded[int]:
        """Return a column of whole numbers, in the order in which they first stand there."""
        found, first, index = np.unique(column, return_index=True, return_inverse=True)
        order = np.argsort(first)
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        return Coded(tuple(found[order].tolist()), place[index])

    @classmethod
    def same(cls, value: T, count: int) -> Coded[T]:
        """Return a column of one value."""
        return cls((value,), np.broadcast_to(np.intp(0), (count,)))

    def __len__(self) -> int:
        return len(self.index)

    def at(self, row: int) -> T:
        """Return the value of a row."""
        return self.values[int(self.index[row])]

    def each(self, function: Callable[[T], S]) -> Coded[S]:
        """Return the column of what a function makes of the values; some may be alike then."""
        return Coded(tuple(map(function, self.values)), self.index)

    def put(self, others: Mapping[int, T]) -> Coded[T]:
        """Return the column with other values in some rows; some may be alike then."""
        if not others:
            return self
        added = Coded.of(list(others.values()))
        index = np.array(self.index)
        index[list(others)] = len(self.values) + added.index
        return Coded(self.values + added.values, index)

    def of_rows(self, rows: Index) -> Coded[T]:
        """Return some rows, their values as `of` has them."""
        numbers = Coded.numbered(self.index[rows])
        # put and each may have made values alike
        again = Coded.of([self.values[k] for k in numbers.values])
        return Coded(again.values, again.index[numbers.index])

    def listed(self, rows: slice | Index = slice(None)) -> list[T]:
        """Return the values of some rows."""
        if len(self.values) == 1:
            return [self.values[0]] * len(self.index[rows])
        return list(map(self.values.__getitem__, self.index[rows].tolist()))


@dataclass(frozen=True, slots=True, eq=False)
class PointColumns:
    """Image points by columns, as `ImagePoint` has them; none can be written into.

    Attributes
    ----------
    photo, point
        Every name once, in the order in which they first stand there.
    xy
        (n, 2) image coordinates [mm].
    sigma_um
        (n,) standard deviations [um], NaN for the block's default; None: for all.
    model, use, reason
        By their values.
    measured
        (n, 2), NaN where nothing else stands in the file; None: nowhere.
    """

    photo: Coded[str]
    point: Coded[str]
    xy: Array
    sigma_um: Array | None
    model: Coded[str | None]
    use: Coded[Use]
    reason: Coded[str | None]
    measured: Array | None = None

    def __post_init__(self) -> None:
        put = partial(object.__setattr__, self)
        put("xy", _fixed(self.xy))
        for name, column in (("sigma_um", self.sigma_um), ("measured", self.measured)):
            if column is not None:
                put(name, None if np.isnan(column).all() else _fixed(column))

    def __reduce__(self) -> tuple[Any, ...]:
        return PointColumns, tuple(getattr(self, each.name) for each in fields(self))

    def __len__(self) -> int:
        return len(self.xy)

    def with_use(self, *uses: Use) -> Index:
        """Return the rows of which that is the use."""
        codes = [k for k, use in enumerate(self.use.values) if use in uses]
        return np.flatnonzero(np.isin(self.use.index, codes))

    @property
    def finite(self) -> bool:
        """Whether all coordinates are numbers."""
        return bool(np.isfinite(self.xy).all())

    @property
    def stated(self) -> Bools:
        """(n,) of which rows something else stands in the file."""
        if self.measured is None:
            return np.zeros(len(self), dtype=bool)
        return ~np.isnan(self.measured[:, 0])

    @property
    def placed(self) -> Array:
        """(n, 2) what stands in the file, where pixels or a lens are between, else x and y."""
        if self.measured is None:
            return self.xy
        return np.where(self.stated[:, None], self.measured, self.xy)

    @classmethod
    def of_rows(cls, rows: Sequence[ImagePoint]) -> PointColumns:
        """Return rows by columns."""
        every: list[Any] = list(zip(*map(attrgetter(*_NAMES), rows), strict=True))
        photo, point, x, y, sigma, model, use, reason, measured = every or [()] * len(_NAMES)
        xy = np.array([x, y], dtype=np.float64).T
        places = None
        if any(measured):
            places = np.array([at or (np.nan, np.nan) for at in measured], dtype=np.float64)
        return cls(
            Coded.of(photo),
            Coded.of(point),
            np.ascontiguousarray(xy.reshape(-1, 2)),
            sigma_column(sigma),
            Coded.of(model),
            Coded.of(use),
            Coded.of(reason),
            places,
        )

    def of(self, rows: Index) -> PointColumns:
        """Return some rows."""
        return PointColumns(
            self.photo.of_rows(rows),
            self.point.of_rows(rows),
            self.xy[rows],
            None if self.sigma_um is None else self.sigma_um[rows],
            self.model.of_rows(rows),
            self.use.of_rows(rows),
            self.reason.of_rows(rows),
            None if self.measured is None else self.measured[rows],
        )

    def rows(self) -> tuple[ImagePoint, ...]:
        """Return a row for each."""
        n = len(self)
        sigma = [None] * n if self.sigma_um is None else stated_sigmas(self.sigma_um)
        return image_points(
            *(self.photo.listed(), self.point.listed(), *(axis.tolist() for axis in self.xy.T)),
            *(sigma, self.model.listed(), self.use.listed(), self.reason.listed()),
            [None] * n if self.measured is None else _pairs(self.measured),
        )

    def row(self, k: int) -> ImagePoint:
        """Return one row."""
        x, y = self.xy[k].tolist()
        sigma = None if self.sigma_um is None else float(self.sigma_um[k])
        at = None if self.measured is None else _pairs(self.measured[k : k + 1])[0]
        return ImagePoint(
            self.photo.at(k),
            self.point.at(k),
            x,
            y,
            None if sigma != sigma else sigma,
            self.model.at(k),
            self.use.at(k),
            self.reason.at(k),
            at,
        )


def read_columns(
    photo: Coded[str],
    point: Coded[str],
    xy: Array,
    sigma_um: Sequence[float] | Array,
    beside: tuple[Coded[str | None], Coded[Use | None], Coded[str | None]],
    measured: Array | None = None,
) -> PointColumns:
    """Return columns as a file has them.

    Parameters
    ----------
    photo, point, xy, measured
        As `PointColumns` has them.
    sigma_um
        NaN for the block's default.
    beside
        Model, use and reason; None as use is "xy".
    """
    model, use, reason = beside
    return PointColumns(
        photo,
        point,
        xy,
        np.array(sigma_um, dtype=np.float64),
        model,
        use.each(lambda one: one or "xy"),
        reason,
        measured,
    )


def stand_again(*columns: Coded[Any]) -> Bools:
    """Return (n,) which rows agree with others in all of some columns; values stand there once."""
    key = np.zeros(len(columns[0]), dtype=np.int64)
    size = 1
    for column in columns:
        if size * len(column.values) > _LARGEST:
            known, key = np.unique(key, return_inverse=True)
            size = len(known)
        key = key * len(column.values) + column.index
        size *= len(column.values)
    ordered = np.sort(key)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    return np.isin(key, twice) if len(twice) else np.zeros(len(key), dtype=bool)


def samples(columns: PointColumns) -> list[int]:
    """Return rows that have all there is: each model in each photo, each use, each reason.

    And the least and the largest standard deviation.
    """
    n = len(columns)
    if n == 0:
        return []
    models = columns.photo.index * len(columns.model.values) + columns.model.index
    firsts = [
        np.unique(index, return_index=True)[1]
        for index in (models, columns.use.index, columns.reason.index)
    ]
    if columns.sigma_um is not None:
        firsts.append(np.array([np.nanargmin(columns.sigma_um), np.nanargmax(columns.sigma_um)]))
    return sorted(set(np.concatenate(firsts).tolist()))


def paired(x: Sequence[float], y: Sequence[float]) -> Array:
    """Return (n, 2) coordinates of two columns."""
    return np.stack((np.array(x, dtype=np.float64), np.array(y, dtype=np.float64)), axis=1)


def stated_sigmas(sigma_um: Array) -> list[float | None]:
    """Return standard deviations as rows have them: None for NaN."""
    return [None if sigma != sigma else sigma for sigma in sigma_um.tolist()]


def sigma_column(stated: Sequence[float | None]) -> Array | None:
    """Return standard deviations as columns have them."""
    if not any(sigma is not None for sigma in stated):
        return None
    given = [np.nan if s is None else _NO_SIGMA if s != s else s for s in stated]
    return np.array(given, dtype=np.float64)


def _fixed(column: NDArray[Any]) -> NDArray[Any]:
    """Return an array that cannot be written into; whoever gave it goes on writing into theirs."""
    view = column.view()
    view.setflags(write=False)
    return view


def _pairs(measured: Array) -> list[tuple[float, float] | None]:
    pairs: list[tuple[float, float] | None] = list(
        zip(*(axis.tolist() for axis in measured.T), strict=True)
    )
    for k in np.flatnonzero(np.isnan(measured[:, 0])).tolist():
        pairs[k] = None
    return pairs


class ImagePoints(Sequence[ImagePoint]):
    """Image points of a block, which never change: as rows, and by columns.

    They are kept as they were given, and made the other way when that is asked for: a block of a
    million rays that is adjusted needs columns alone.

    Parameters
    ----------
    rows
        The rows.
    columns
        Or their columns.

    Raises
    ------
    TypeError
        What is given as rows is no sequence of `ImagePoint`.
    """

    __slots__ = ("_columns", "_rows")

    def __init__(
        self, rows: Iterable[ImagePoint] = (), columns: PointColumns | None = None
    ) -> None:
        self._rows = tuple(rows) if columns is None else None
        self._columns = columns
        for kind in set(map(type, self._rows or ())):
            if not issubclass(kind, ImagePoint):
                raise TypeError(f"a row of image points is an ImagePoint, not {kind.__name__}")

    def __reduce__(self) -> tuple[Any, ...]:
        return ImagePoints, ((), self._columns) if self._rows is None else (self._rows,)

    @property
    def columns(self) -> PointColumns:
        """The columns."""
        if self._columns is None:
            self._columns = PointColumns.of_rows(self._rows or ())
        return self._columns

    @property
    def rows(self) -> tuple[ImagePoint, ...]:
        """The rows."""
        if self._rows is None:
            self._rows = self.columns.rows()
        return self._rows

    def __len__(self) -> int:
        return len(self.columns) if self._rows is None else len(self._rows)

    @overload
    def __getitem__(self, at: int) -> ImagePoint: ...

    @overload
    def __getitem__(self, at: slice) -> tuple[ImagePoint, ...]: ...

    def __getitem__(self, at: int | slice) -> ImagePoint | tuple[ImagePoint, ...]:
        if self._rows is not None or isinstance(at, slice):
            return self.rows[at]
        return self.columns.row(range(len(self))[at])

    def __iter__(self) -> Iterator[ImagePoint]:
        return iter(self.rows)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, ImagePoints | tuple | list):
            return NotImplemented
        return len(self) == len(other) and self.rows == tuple(other)

    def __hash__(self) -> int:
        return hash(self.rows)

    def __add__(self, other: object) -> tuple[ImagePoint, ...]:
        return (*self, *other) if isinstance(other, ImagePoints | tuple) else NotImplemented

    def __radd__(self, other: object) -> tuple[ImagePoint, ...]:
        # a list that is added to takes them one by one
        return (*other, *self) if isinstance(other, tuple) else NotImplemented

    def __repr__(self) -> str:
        return repr(self.rows)


def columns_of(rows: Iterable[ImagePoint]) -> PointColumns:
    """Return image points by columns; those of a block have them, or keep them when asked once."""
    return (rows if isinstance(rows, ImagePoints) else ImagePoints(rows)).columns
