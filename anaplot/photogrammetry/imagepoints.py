"""Measured image points: a row each for people and scripts, columns for what handles them all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, overload

from anaplot.errors import InputError
from anaplot.photogrammetry.imagepoint import ImagePoint

if TYPE_CHECKING:
    from anaplot.photogrammetry.pointcolumns import PointColumns

__all__ = [
    "LARGEST_MM",
    "ImagePoints",
    "check_coordinates",
    "columns_of",
    "counting_names_of",
    "names_of",
]

LARGEST_MM = 1e7
"""Above all image coordinates and camera constants; their squares are numbers."""


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
            from anaplot.photogrammetry.pointcolumns import PointColumns

            self._columns = PointColumns.of_rows(self._rows or ())
        return self._columns

    @property
    def rows(self) -> tuple[ImagePoint, ...]:
        """The rows."""
        if self._rows is None:
            self._rows = self.columns.rows()
        return self._rows

    @property
    def names(self) -> Iterator[tuple[str, str]]:
        """Photo and point of every row, from what is kept: nothing is made for it."""
        if self._rows is not None or self._columns is None:
            return ((row.photo, row.point) for row in self._rows or ())
        return zip(self._columns.photo.listed(), self._columns.point.listed(), strict=True)

    @property
    def counting(self) -> Iterator[tuple[str, str]]:
        """`names` of the rows that are not off."""
        if self._rows is not None or self._columns is None:
            return ((row.photo, row.point) for row in self._rows or () if row.use != "off")
        uses = self._columns.use.listed()
        return (names for names, use in zip(self.names, uses, strict=True) if use != "off")

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


def names_of(rows: Iterable[ImagePoint]) -> Iterator[tuple[str, str]]:
    """Return photo and point of image points; those of a block are not made rows for it."""
    return (rows if isinstance(rows, ImagePoints) else ImagePoints(rows)).names


def counting_names_of(rows: Iterable[ImagePoint]) -> Iterator[tuple[str, str]]:
    """Return `names_of` those image points that are not off."""
    return (rows if isinstance(rows, ImagePoints) else ImagePoints(rows)).counting


def columns_of(rows: Iterable[ImagePoint]) -> PointColumns:
    """Return image points by columns; those of a block have them, or keep them when asked once."""
    return (rows if isinstance(rows, ImagePoints) else ImagePoints(rows)).columns


def check_coordinates(rows: Iterable[ImagePoint]) -> None:
    """Raise InputError, with point and photo, where an image coordinate is none."""
    rows = rows if isinstance(rows, ImagePoints) else ImagePoints(rows)
    good = (abs(rows.columns.xy) <= LARGEST_MM).all(axis=1)
    if not good.all():
        row = rows[int(good.argmin())]
        where = f"image point {row.point} of photo {row.photo}"
        raise InputError(f"{where}: {row.x:g}, {row.y:g} mm are no coordinates")
