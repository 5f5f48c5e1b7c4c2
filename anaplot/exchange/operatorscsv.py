"""Who measured which photo: a CSV file with photo,operator."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from anaplot.textfiles.csvtable import read_csv
from anaplot.textfiles.kinds import NAME, KnownName

__all__ = ["read_operators"]


def read_operators(path: Path, photos: Collection[str]) -> dict[str, str]:
    """Read the operators of photos, by photo in file order.

    Parameters
    ----------
    path
        The file: columns photo and operator.
    photos
        Names of the photos there are.

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line.
    """
    table = read_csv(path, {"photo": KnownName("photo", photos), "operator": NAME})
    if not len(table):
        raise table.fail(None, None, "no rows")
    table.refuse_twice("photo")
    return dict(zip(table["photo"], table["operator"], strict=True))
