"""Which image points belong to a model: a point measured twice counts once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from anaplot.aliases import RowKey
from anaplot.photogrammetry.block import Block, ImagePoint

__all__ = [
    "measured_in_files",
    "measured_once",
    "model_name",
    "model_splits",
    "points_of",
    "rows_by_photo",
    "rows_off",
]


def model_name(left: str, right: str) -> str:
    """Return the name of a model, "left/right"."""
    return f"{left}/{right}"


def model_splits(name: str) -> list[tuple[str, str]]:
    """Return the left and right photos that a model's name can mean: names may hold slashes."""
    at = [k for k, letter in enumerate(name) if letter == "/"]
    return [(name[:k], name[k + 1 :]) for k in at if 0 < k < len(name) - 1]


def rows_by_photo(image_points: Iterable[ImagePoint]) -> dict[str, list[ImagePoint]]:
    """Return the rows of every photo that has any, each in file order."""
    rows: dict[str, list[ImagePoint]] = {}
    for row in image_points:
        rows.setdefault(row.photo, []).append(row)
    return rows


def points_of(image_points: Iterable[ImagePoint], photo: str, model: str) -> dict[str, ImagePoint]:
    """Return the points of one photo in one model.

    A point is taken from the row of its own model, else from the row without a model; rows of
    other models do not count.

    Parameters
    ----------
    image_points
        Rows in file order, of any photos.
    photo
        Name of the photo.
    model
        "left/right".

    Returns
    -------
    dict[str, ImagePoint]
        The selected row of each point, in the file order of the selected rows.
    """
    selected: dict[str, ImagePoint] = {}
    for row in image_points:
        if row.photo != photo:
            continue
        if row.model == model:
            # Out and in again: a dict keeps the place of the first entry, the row has another.
            selected.pop(row.point, None)
            selected[row.point] = row
        elif row.model is None and row.point not in selected:
            selected[row.point] = row
    return selected


def measured_in_files(block: Block) -> frozenset[tuple[str, str]]:
    """Return (left, right) of the models that have points common to both photos in the files."""
    rows = rows_by_photo(block.image_points if block.strips else ())
    found = set()
    for strip in block.strips:
        for left, right in strip.models():
            name = f"{left}/{right}"
            in_left, in_right = (points_of(rows.get(p, ()), p, name) for p in (left, right))
            if not in_left.keys().isdisjoint(in_right):
                found.add((left, right))
    return frozenset(found)


def rows_off(left: Mapping[str, ImagePoint], right: Mapping[str, ImagePoint]) -> frozenset[RowKey]:
    """Return the rows (point, axis) of a model that are switched off.

    The use of the right ray decides; the left one serves as given, unless it is off.

    Parameters
    ----------
    left, right
        Rows of its photos by point, as `points_of` selects them.
    """
    return frozenset(
        (point, axis)
        for point, row in right.items()
        for axis in ("y", "x")
        if not row.counts(axis) or (point in left and left[point].use == "off")
    )


def measured_once(
    before: Mapping[str, ImagePoint], now: Mapping[str, ImagePoint]
) -> frozenset[str]:
    """Return the points of a photo whose row serves two models.

    Parameters
    ----------
    before, now
        Rows of the photo by point, as `points_of` selects them for either model.
    """
    return frozenset(point for point, row in now.items() if before.get(point) is row)
