"""Image points by columns, for what handles them all at once: a block has them by the million."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from operator import attrgetter
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from anaplot.aliases import Array, Bools, Index
from anaplot.photogrammetry.imagepoint import ImagePoint, Use, image_points

__all__ = [
    "Coded",
    "PointColumns",
    "paired",
    "read_columns",
    "samples",
    "sigma_column",
    "stand_again",
    "stated_sigmas",
]

T = TypeVar("T")
S = TypeVar("S")

_NAMES = tuple(each.name for each in fields(ImagePoint))
_LARGEST = 2**62  # of a key of several columns
_NO_SIGMA = -1.0  # um: what is given and is not a number either, beside None, which is NaN


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

    def rays_of_points(self) -> list[int]:
        """Return how many rays that count every point has."""
        counts = np.ones(len(self), dtype=bool)
        counts[self.with_use("off")] = False
        codes = self.point.index[counts]
        found: list[int] = np.bincount(codes, minlength=len(self.point.values)).tolist()
        return found

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
) -> PointColumns:
    """Return columns as a file has them.

    Parameters
    ----------
    photo, point, xy
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
