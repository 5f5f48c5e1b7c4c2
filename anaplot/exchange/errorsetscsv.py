"""A file of sets of observations to be tested together."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from anaplot.textfiles.csvtable import read_csv
from anaplot.textfiles.kinds import NAME, NUMBER, PHOTO, Blank, Text, Word
from anaplot.textfiles.wording import place

__all__ = ["SetRow", "read_error_sets"]

_OF_CONDITIONS = ("across", "up", "normal", "length", "distance", "angle")
_AXES = ("x", "y", "X", "Y", "Z", "omega", "phi", "kappa", *_OF_CONDITIONS)


class SetRow(NamedTuple):
    """What a set takes in; what is None is not said, and everything fits.

    Attributes
    ----------
    set
        Name of the set.
    photo, point
        Names; control has no photo, a prior no point.
    axis
        "x" or "y" of an image point, "X", "Y" or "Z" of control or of a prior of a point, an angle
        of that of a photo, or what a row of a condition is.
    condition
        Where a condition between points stands, as "conditions.csv:3".
    share
        How large its errors are against those of the other rows.
    where
        File and line.
    prior
        Whether what is known of a point beforehand is meant, and not its control.
    """

    set: str
    photo: str | None
    point: str | None
    axis: str | None
    condition: str | None
    share: float | None
    where: str
    prior: bool = False


def read_error_sets(path: Path) -> tuple[SetRow, ...]:
    """Read sets of observations.

    Parameters
    ----------
    path
        The file: column set, and of photo, point, axis, use, condition and share what is needed.

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line; a set with shares in some rows only.
    """
    table = read_csv(
        path,
        {"set": NAME},
        {
            "photo": Blank(PHOTO),
            "point": Blank(Text(255)),
            "axis": Blank(Word(*_AXES)),
            "use": Blank(Word("prior")),
            "condition": Blank(Text(255)),
            "share": Blank(NUMBER),
        },
    )
    if not len(table):
        raise table.fail(None, None, "no rows")
    names = ("set", "photo", "point", "axis", "use", "condition", "share")
    shared: dict[str, bool] = {}
    out = []
    for row, (of, photo, point, axis, use, condition, share) in enumerate(
        zip(*(table[name] for name in names), strict=True)
    ):
        prior, where = use is not None, place(path, table.line(row))
        one = SetRow(of, photo, point, axis, condition, share, where, prior)
        if one.photo is None and one.point is None and one.condition is None:
            raise table.fail(row, None, "neither a photo nor a point nor a condition")
        if one.condition is not None and one.photo is not None:
            raise table.fail(row, "photo", "not with a condition")
        if one.condition is None and one.axis in _OF_CONDITIONS:
            raise table.fail(row, "axis", f"{one.axis} is of a condition, and none is given")
        if prior and (one.point is None or one.photo or one.condition):
            raise table.fail(row, "use", "a prior has a point, and neither photo nor condition")
        if prior and one.axis not in (None, *"XYZ"):
            raise table.fail(row, "axis", f"{one.axis} is none of a prior: X, Y or Z")
        with_share = one.share is not None
        if shared.setdefault(one.set, with_share) != with_share:
            raise table.fail(row, "share", f"set {one.set}: in some rows only")
        out.append(one)
    return tuple(out)
