"""Points measured on plates: a CSV file with photo,point,x,y[,sigma or sigma_um,model,use,reason].

x and y are plate coordinates in the system in which the photo's fiducials were measured, in the
same unit; sigma is in that unit, sigma_um in the image. The other columns are those of
image_points.csv.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from anaplot.exchange.measuredrows import measured_rows
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.plateunits import PLATE_UNITS
from anaplot.textfiles.csvtable import CsvColumns
from anaplot.textfiles.kinds import SIGMA, Blank, Number
from anaplot.textfiles.wording import place, quoted

__all__ = ["PlatePoint", "PlatePoints", "read_plate_points", "refuse_in_two_files"]

_MOST = max(unit.most for unit in PLATE_UNITS.values())


@dataclass(frozen=True, slots=True)
class PlatePoint:
    """A point on a plate.

    Attributes
    ----------
    measured
        The row, its coordinates still those of the plate.
    sigma
        Their standard deviation in the plate's unit, or None.
    row
        In its file, from 0.
    """

    measured: ImagePoint
    sigma: float | None
    row: int


@dataclass(frozen=True, eq=False)
class PlatePoints:
    """A file of points measured on plates.

    Attributes
    ----------
    path
        The file.
    table
        Its columns, which say where something is wrong.
    points
        In file order.
    """

    path: Path
    table: CsvColumns
    points: tuple[PlatePoint, ...]

    def by_photo(self) -> Iterator[tuple[str, list[PlatePoint]]]:
        """Yield photos in the order in which they first stand there, and their points."""
        found: dict[str, list[PlatePoint]] = {}
        for point in self.points:
            found.setdefault(point.measured.photo, []).append(point)
        yield from found.items()


def read_plate_points(path: Path, block: Block) -> PlatePoints:
    """Read a file of points measured on plates.

    Parameters
    ----------
    path
        The file.
    block
        The block that they are to belong to, for the names of its photos and models.

    Raises
    ------
    InputError
        The file is empty, or the first row that is wrong, with file, line and column.
    """
    coordinates = dict.fromkeys(("x", "y"), Number(-_MOST, _MOST))
    table, _ = measured_rows(path, block, [coordinates], {"sigma": Blank(SIGMA)})
    names = ("photo", "point", "x", "y", "sigma_um", "model", "use", "reason")
    rows = [
        ImagePoint(photo, point, x, y, sigma, model, use or "xy", reason)
        for photo, point, x, y, sigma, model, use, reason in zip(
            *(table[name] for name in names), strict=True
        )
    ]
    if not rows:
        raise table.fail(None, None, "no point")
    pairs = list(zip(rows, table["sigma"], strict=True))
    for k, (row, sigma) in enumerate(pairs):
        if sigma is not None and row.sigma_um is not None:
            raise table.fail(k, "sigma", "sigma beside sigma_um: only one of them")
    return PlatePoints(
        path, table, tuple(PlatePoint(row, sigma, k) for k, (row, sigma) in enumerate(pairs))
    )


def refuse_in_two_files(files: Iterable[PlatePoints]) -> None:
    """Refuse a point that two files have in the same photo and model; raises InputError."""
    seen: dict[tuple[str, str, str | None], tuple[PlatePoints, PlatePoint]] = {}
    for file in files:
        for point in file.points:
            row = point.measured
            at, other = seen.setdefault((row.photo, row.point, row.model), (file, point))
            if other is not point:
                where = place(at.path, at.table.line(other.row))
                raise file.table.fail(
                    point.row,
                    None,
                    f"point {quoted(row.point)} of photo {quoted(row.photo)} stands in {where} too",
                )
