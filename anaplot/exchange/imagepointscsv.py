"""image_points.csv: measured image points, to and from text."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from pathlib import Path

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.selection import model_name
from anaplot.textfiles.csvtable import CsvTable
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import hint, quoted

__all__ = ["format_image_points", "parse_image_points"]


def parse_image_points(path: Path, block: Block) -> tuple[ImagePoint, ...]:
    """Read an image_points.csv.

    Parameters
    ----------
    path
        The file.
    block
        The block as its block.toml declares it: its photos, cameras and models.

    Returns
    -------
    tuple[ImagePoint, ...]
        The rows in file order, coordinates in mm.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    return _ImagePointReader(path, block).read()


def format_image_points(points: Iterable[ImagePoint]) -> str:
    """Return the text of an image_points.csv.

    Coordinates are written with the fewest digits that are read back as the same number.

    Raises
    ------
    InputError
        A row that could not be read again: a bad name, a number that is none, a row twice.
    """
    rows = list(points)
    has_sigma = any(row.sigma_um is not None for row in rows)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["photo", "point", "x", "y", *(["sigma_um"] if has_sigma else []), "model"])
    seen: set[tuple[str, str, str | None]] = set()
    for row in rows:
        _check_writable(row)
        key = (row.photo, row.point, row.model)
        if key in seen:
            raise _unwritable(row, "stands twice")
        seen.add(key)
        fields = [row.photo, row.point, repr(float(row.x)), repr(float(row.y))]
        if has_sigma:
            fields.append("" if row.sigma_um is None else repr(float(row.sigma_um)))
        writer.writerow([*fields, row.model or ""])
    return text.getvalue()


class _ImagePointReader:
    """The checks of one file: first quickly whether a row is good, then slowly what is wrong."""

    def __init__(self, path: Path, block: Block) -> None:
        self._path = path
        cameras = {camera.id: camera for camera in block.cameras}
        self._camera = {photo.id: cameras[photo.camera] for photo in block.photos}
        self._reach = {photo: camera.reach() for photo, camera in self._camera.items()}
        self._models: dict[str, dict[str, str]] = {photo: {} for photo in self._camera}
        for strip in block.strips:
            for left, right in strip.models():
                model = model_name(left, right)
                self._models[left][model] = self._models[right][model] = model
        # Names come back many times: each is checked once and kept once.
        self._names: dict[str, str] = {photo.id: photo.id for photo in block.photos}

    def read(self) -> tuple[ImagePoint, ...]:
        points: list[ImagePoint] = []
        lines: dict[tuple[str, str, str | None], int] = {}
        names = self._names
        with CsvTable(self._path, ("photo", "point", "x", "y"), ("sigma_um", "model")) as table:
            column = table.columns
            at_photo, at_point, at_x, at_y = (column[n] for n in ("photo", "point", "x", "y"))
            at_sigma, at_model = column.get("sigma_um"), column.get("model")
            for line, row in table:
                photo = row[at_photo]
                reach = self._reach.get(photo)
                if reach is None:
                    raise self._bad_photo(table, line, photo)
                point = row[at_point]
                if point not in names:
                    self._check_point(table, line, point)
                    names[point] = point
                x = table.number(line, "x", row[at_x])
                y = table.number(line, "y", row[at_y])
                if not (-reach[0] <= x <= reach[0] and -reach[1] <= y <= reach[1]):
                    raise self._outside(table, line, photo, x, y)
                sigma: float | None = None
                if at_sigma is not None and row[at_sigma]:
                    sigma = table.number(line, "sigma_um", row[at_sigma])
                    if sigma <= 0.0:
                        raise table.fail(line, f"sigma_um = {sigma:g} must be greater than 0")
                model: str | None = None
                if at_model is not None and row[at_model]:
                    model = self._models[photo].get(row[at_model])
                    if model is None:
                        raise self._bad_model(table, line, photo, row[at_model])
                photo, point = names[photo], names[point]
                key = (photo, point, model)
                first = lines.setdefault(key, line)
                if first != line:
                    raise self._twice(table, line, first, key)
                points.append(ImagePoint(photo, point, x, y, sigma, model))
        return tuple(points)

    def _bad_photo(self, table: CsvTable, line: int, photo: str) -> InputError:
        if not photo:
            return table.fail(line, "photo is empty")
        return table.fail(line, f"unknown photo {quoted(photo)}{hint(photo, self._camera)}")

    def _check_point(self, table: CsvTable, line: int, point: str) -> None:
        if not point:
            raise table.fail(line, "point is empty")
        fault = name_fault(point)
        if fault is not None:
            raise table.fail(line, f"point: the name {quoted(point)} {fault}")

    def _outside(self, table: CsvTable, line: int, photo: str, x: float, y: float) -> InputError:
        reach_x, reach_y = self._reach[photo]
        column, value, reach = ("x", x, reach_x) if abs(x) > reach_x else ("y", y, reach_y)
        camera = self._camera[photo]
        limit = "the format" if camera.format is not None else "4 c"
        return table.fail(
            line,
            f"{column} = {value:g} mm lies outside {limit} of camera {quoted(camera.id)} "
            f"(-{reach:g} to {reach:g} mm)",
        )

    def _bad_model(self, table: CsvTable, line: int, photo: str, model: str) -> InputError:
        title = f"model {quoted(model)}"
        left, slash, right = model.partition("/")
        if not slash or "/" in right or not left or not right:
            return table.fail(line, f"{title} must be of the form left/right")
        for name in (left, right):
            if name not in self._camera:
                return table.fail(
                    line, f"{title}: unknown photo {quoted(name)}{hint(name, self._camera)}"
                )
        if photo not in (left, right):
            return table.fail(line, f"{title} does not contain the row's photo {quoted(photo)}")
        if model_name(right, left) in self._models[photo]:
            turned = quoted(model_name(right, left))
            return table.fail(line, f"{title}: in flight order it is {turned}")
        return table.fail(line, f"{title}: the two photos do not follow each other in a strip")

    def _twice(
        self, table: CsvTable, line: int, first: int, key: tuple[str, str, str | None]
    ) -> InputError:
        photo, point, model = key
        within = f" of model {quoted(model)}" if model else " without a model"
        return table.fail(
            line,
            f"point {quoted(point)} twice in photo {quoted(photo)}{within} (lines {first} and "
            f"{line})",
        )


def _check_writable(row: ImagePoint) -> None:
    for what, name, is_photo in (("photo", row.photo, True), ("point", row.point, False)):
        fault = name_fault(name, photo=is_photo)
        if fault is not None:
            raise _unwritable(row, f"its {what} name {fault}")
    if row.model is not None:
        parts = row.model.split("/")
        if len(parts) != 2 or any(name_fault(part, photo=True) for part in parts):
            raise _unwritable(row, "its model is not of the form left/right")
        if row.photo not in parts:
            raise _unwritable(row, "its model does not contain its photo")
    if not (math.isfinite(row.x) and math.isfinite(row.y)):
        raise _unwritable(row, "its coordinates are not finite")
    if row.sigma_um is not None and not (math.isfinite(row.sigma_um) and row.sigma_um > 0.0):
        raise _unwritable(row, "its sigma_um is not a finite number greater than 0")


def _unwritable(row: ImagePoint, why: str) -> InputError:
    return InputError(
        f"image point {quoted(row.point)} of photo {quoted(row.photo)} cannot be written: {why}"
    )
