"""control.csv: ground control and check points."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from anaplot.photogrammetry.block import ControlPoint
from anaplot.textfiles.csvtable import csv_text, read_csv
from anaplot.textfiles.kinds import NAME, NUMBER, Blank, Made, Number, Word

__all__ = ["format_control", "parse_control"]

_XYZ = ("X", "Y", "Z")
_SIGMAS = ("sX", "sY", "sZ")
_SIGMA = Made(Number(0.0), abs)  # no minus zero


def parse_control(path: Path) -> tuple[ControlPoint, ...]:
    """Read a control.csv.

    Parameters
    ----------
    path
        The file, with columns point,X,Y,Z and perhaps sX,sY,sZ,use; metres.

    Returns
    -------
    tuple[ControlPoint, ...]
        The rows in file order. A blank coordinate is not known (None), a blank standard
        deviation the block's default (None), 0 is free of error.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    table = read_csv(
        path,
        {"point": NAME, **dict.fromkeys(_XYZ, Blank(NUMBER))},
        {**dict.fromkeys(_SIGMAS, Blank(_SIGMA)), "use": Word("control", "check", "off")},
    )
    table.refuse_twice("point")
    columns = (table[name] for name in ("point", *_XYZ, *_SIGMAS, "use"))
    return tuple(
        ControlPoint(point, (x, y, z), (sx, sy, sz), use or "control")
        for point, x, y, z, sx, sy, sz, use in zip(*columns, strict=True)
    )


def format_control(control: Iterable[ControlPoint]) -> str:
    """Return control points as the text of a control.csv, shortest digits that read back."""
    rows = ((point.point, *point.xyz, *point.sigma, point.use) for point in control)
    return csv_text(("point", *_XYZ, *_SIGMAS, "use"), rows)
